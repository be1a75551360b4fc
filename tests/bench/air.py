"""The radio alone: nodes that broadcast beacons, in broadcasts a CPU second, against bare SimPy timeouts and ns-3.

`python -m tests.bench.air NODES METRES SECONDS TURNS`: one setting in a process of its own, as JSON (see `measured`).
The way is the real one: a scenario is built, a replicate run, its events and all other wanted rows put into a file.
"""

from __future__ import annotations

import gc
import json
import math
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from tests.bench.timing import peak_megabytes, row

REACH, PLOT, SECONDS = 75.0, 1600.0, 20
"""m, m2 a node, s: the workload of network.md."""
LEAST_BROADCASTS, MOST_BROADCASTS = 32_000, 200_000
"""In one turn: a small network is simulated for more seconds, so that files weigh as little; a large one for fewer."""
SIZES = (100, 400, 1600, 100_000)
NS3_TURNS = {100: (20, 3), 400: (20, 2), 1600: (5, 1)}
"""Nodes: simulated seconds and turns of ns-3, which takes long for many nodes."""
SOURCE = Path(__file__).with_name("ns3") / "beacons.cc"
LIBRARIES = ("lr-wpan", "spectrum", "propagation", "mobility", "network", "core")
RATE, FALL, DENSE = 20_000, 1.05, 37
FITS, FITS_MANY = 52, 34
"""Timeouts in the time of one of 20,000 broadcasts, at 1.04 M (100 processes) and 0.68 M (10,000) a second: the figures
of the machine on which the bound was set. This ratio is what says whether it is kept on another."""
NOISE = "at most 1 wanted, 5 % allowed for noise"


class Setting(NamedTuple):
    """So many nodes on a square of side `metres` for so many simulated seconds."""

    nodes: int
    metres: float
    seconds: int


def radio_rows(repeats: int) -> Iterator[dict[str, Any]]:
    """Broadcasts a CPU second, what of them is delivered, what they cost in memory; and the same from ns-3."""
    found = {}
    for nodes in SIZES:
        found[nodes] = _asked(_setting(nodes), 1 if nodes > 10_000 else repeats)
        yield from _size_rows(f"beacons N={nodes}", found[nodes])
        if nodes > SIZES[0]:
            fall = found[nodes]["timeouts"] / found[SIZES[0]]["timeouts"]
            yield row(f"beacons: fall from N=100 to N={nodes} / that of bare timeouts", fall, "", FALL, note=NOISE)
    yield from _size_rows(f"beacons N=400, {DENSE} neighbours", _asked(_dense(400), repeats))
    yield row("beacons N=400: delivered of what was in range", found[400]["delivered"], "%", 99.5, 97.0)
    yield row("beacons N=1600: construction, CPU", found[1600]["construct"], "s", 1.0)
    yield row("beacons N=100000: construction, CPU", found[100_000]["construct"], "s", 10.0)
    alone = _asked(_setting(1600), 1, warm=False)
    yield row("beacons N=1600: memory above the imports", alone["megabytes"], "MB", 60.0)
    yield from _ns3_rows()


def _size_rows(name: str, found: dict[str, Any]) -> Iterator[dict[str, Any]]:
    note = f"{found['neighbours']:.1f} neighbours, {found['delivered']:.2f} % delivered, best of {len(found['rates'])}"
    yield row(f"{name}: broadcasts a CPU second", max(found["rates"]), "1/s", at_least=RATE, note=note)
    yield row(f"{name}: bare SimPy timeouts a CPU second, as many processes", max(found["bare"]), "1/s")
    fits = FITS_MANY if found["nodes"] > 10_000 else FITS
    yield row(f"{name}: timeouts a broadcast", found["timeouts"], "", fits, note=f"{RATE:,}/s on the reference machine")


def _setting(nodes: int) -> Setting:
    return Setting(nodes, math.sqrt(nodes * PLOT), _seconds(nodes))


def _seconds(nodes: int) -> int:
    return max(min(max(SECONDS, LEAST_BROADCASTS // nodes), MOST_BROADCASTS // nodes), 1)


def _dense(nodes: int) -> Setting:
    """The side at which the nodes have DENSE neighbours on average: they move together as it shrinks."""
    low, high = REACH, math.sqrt(nodes * PLOT)
    while high - low > 1e-3:
        metres = (low + high) / 2
        if _neighbours(_built(Setting(nodes, metres, 1))) > DENSE:
            low = metres
        else:
            high = metres
    return Setting(nodes, high, _seconds(nodes))


def _asked(setting: Setting, turns: int, warm: bool = True) -> dict[str, Any]:
    command = [sys.executable, "-m", "tests.bench.air", *map(str, setting), str(turns), *(() if warm else ("cold",))]
    answer = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    found: dict[str, Any] = json.loads(answer.splitlines()[-1])
    return found


def _built(setting: Setting) -> Any:
    """The scenario's parts."""
    from wsnsim import scenario

    metres = f"{setting.metres!r} m"
    return scenario.build(scenario.load({
        "name": "air", "seed": 1, "duration": f"{setting.seconds} s", "step": "1 s",
        "workload": {"kind": "beacons", "period": "1 s", "bits": 96},
        "deploy": {"kind": "uniform", "nodes": setting.nodes, "width": metres, "height": metres, "cover": False},
        "energy": {"kind": "first_order", "battery": "2 J"},
        "link": {"kind": "disk", "reach": f"{REACH} m"},
        "mac": {"kind": "csma"},
        "record": {"events": True},
    }))  # fmt: skip


def _neighbours(parts: Any) -> float:
    """How many nodes a node has within reach, on average."""
    from scipy.spatial import KDTree

    from wsnsim.base.rng import Streams

    tree = KDTree(parts.deploy.draw(REACH, Streams(parts.seed, 0)("deploy")))
    return float(tree.count_neighbors(tree, REACH) / tree.n - 1.0)


def measured(setting: Setting, turns: int, warm: bool) -> dict[str, Any]:
    """Figures of one setting, beacons and bare timeouts in turn.

    {"nodes": of the setting, "rates": broadcasts a CPU second of each turn, "bare": timeouts, "timeouts": median of
    bare / rate of a turn,
    "construct": least CPU seconds, "delivered": %, "neighbours": on average, "megabytes": above imports if not warm}
    """
    from wsnsim import experiment, recording  # noqa: F401

    if warm:
        _one_turn(_built(_setting(100)))
    before = peak_megabytes()
    parts = _built(setting)
    runs, bare = [], []
    for turn in range(turns):
        runs.append(_one_turn(parts))
        if turn == 0:
            megabytes = peak_megabytes() - before
        bare.append(_bare_rate(setting.nodes, setting.seconds))
    rates = [run["sent"] / run["seconds"] for run in runs]
    return {
        "nodes": setting.nodes,
        "rates": rates,
        "bare": bare,
        "timeouts": statistics.median(b / r for b, r in zip(bare, rates, strict=True)),
        "construct": min(run["construct"] for run in runs),
        "delivered": runs[0]["delivered"],
        "neighbours": _neighbours(parts),
        "megabytes": megabytes,
    }


def _one_turn(parts: Any) -> dict[str, float]:
    """A replicate into a file that is closed. Construction ends where the world first tells the time."""
    from wsnsim import experiment, recording

    told: list[float] = []
    gc.collect()
    with tempfile.TemporaryDirectory() as folder:
        began = time.process_time()
        with recording.ResultFile(Path(folder) / "air.h5", (), parts.record) as file:
            tell = lambda _: told.append(time.process_time())  # noqa: E731
            run = experiment.replicate_of(parts, 0, file, tell).run
        ended = time.process_time()
    share = 100.0 * run["delivered"] / run["in_range"]
    return {"sent": run["frames_sent"], "delivered": share, "construct": told[0] - began, "seconds": ended - told[0]}


def _bare_rate(processes: int, seconds: int) -> float:
    """SimPy alone: timeouts a CPU second of processes that do nothing but wait, each from a phase of its own."""
    import numpy as np
    import simpy

    gc.collect()
    env = simpy.Environment()
    fired, lasts = 0, max(seconds, MOST_BROADCASTS // processes)

    def waiter(phase: float) -> Any:
        nonlocal fired
        yield env.timeout(phase)
        while True:
            fired += 1
            yield env.timeout(1.0)

    for phase in np.random.default_rng(1).random(processes).tolist():
        env.process(waiter(phase))
    began = time.process_time()
    env.run(until=lasts)
    return fired / (time.process_time() - began)


def _ns3_rows() -> Iterator[dict[str, Any]]:
    """The same workload on ns-3's lr-wpan, in turn with ours; its channel leaves out who is too far (MaxLossDb)."""
    with ns3_program() as program:
        if program is None:
            yield row("ns-3: broadcasts a CPU second", math.nan, "1/s", note="ns-3 is not installed")
            return
        for nodes, (seconds, turns) in NS3_TURNS.items():
            command = [str(program), str(nodes), str(math.sqrt(nodes * PLOT)), str(seconds), "culled"]
            found, ratios = [], []
            for _ in range(turns):
                found.append(json.loads(subprocess.check_output(command, text=True)))
                ours = max(_asked(_setting(nodes), 1)["rates"])
                ratios.append(ours * found[-1]["cpu"] / found[-1]["sent"])
            rate = max(one["sent"] / one["cpu"] for one in found)
            note = f"{seconds} s simulated, best of {turns}, {found[0]['bytes']} B a frame"
            yield row(f"ns-3 N={nodes}: broadcasts a CPU second", rate, "1/s", note=note)
            yield row(f"beacons N={nodes}: ours / ns-3's broadcasts a CPU second", statistics.median(ratios), "")
            if nodes == 400:
                share = 100.0 * found[0]["delivered"] / found[0]["in_range"]
                note = f"{found[0]['delivered']} of {found[0]['in_range']}; overlapping frames may survive there"
                yield row("ns-3 N=400: delivered of what was in range", share, "%", note=note)


@contextmanager
def ns3_program() -> Iterator[Path | None]:
    """beacons.cc compiled; None where there is no g++ or no ns-3."""
    if shutil.which("g++") is None or not _compiles("#include <ns3/lr-wpan-module.h>\n"):
        yield None
        return
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / "beacons"
        libraries = [f"-lns3-{name}" for name in LIBRARIES]
        subprocess.run(["g++", "-O2", "-o", program, SOURCE, "-Wl,--no-as-needed", *libraries], check=True)
        yield program


def _compiles(source: str) -> bool:
    """Whether g++ finds what a text includes."""
    command = ["g++", "-E", "-x", "c++", "-"]
    return subprocess.run(command, input=source.encode(), capture_output=True, check=False).returncode == 0


if __name__ == "__main__":
    nodes, metres, seconds, turns, *cold = sys.argv[1:]
    print(json.dumps(measured(Setting(int(nodes), float(metres), int(seconds)), int(turns), not cold)))
