"""A run has the instants 0, step, ..., duration - step, and consumes for exactly its duration (ADR 12).

A time of a file that is that of an instant belongs to it, however great times are and however they are written.
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import wsnsim
from tests.helpers.thorough import thorough
from wsnsim.base.arrays import first_steps, since
from wsnsim.base.errors import ScenarioError
from wsnsim.base.initial_conditions import present_at
from wsnsim.interop import field_data, sumo, traces, trajectories
from wsnsim.interop.conventions import Conventions
from wsnsim.models.k7file import read_links
from wsnsim.models.ranging import Range
from wsnsim.models.recorded_readings import RecordedSensor
from wsnsim.models.recorded_track import RecordedTrack
from wsnsim.models.visits import Visits
from wsnsim.models.waypoints import Waypoints
from wsnsim.network.faults import FaultSchedule

LISTENING = 0.062
"""Watts of a CC2420 that listens, to 0.1 %."""
NODES: dict[str, Any] = {
    "name": "idle", "seed": 5, "deploy": {"kind": "anchors", "places": [[0, 0], [20, 0], [0, 20]]},
    "energy": {"kind": "states", "radio": "cc2420", "processor": "msp430f1611"}, "link": {"kind": "disk", "reach": 50},
    "mac": {"kind": "csma"},
}  # fmt: skip
TRACKING: dict[str, Any] = {
    "prior": {"sd": [5, 1, 5, 1]}, "motion": {"kind": "waypoints", "points": [[0, 5000, 5000], [1, 5000, 5000]]},
    "sensor": {"kind": "range", "sd": 1.0, "reach": 30.0}, "tracker": {"kind": "ekf"},
}  # fmt: skip
"""A target that nobody senses."""
WORKLOAD: dict[str, Any] = {"workload": {"kind": "beacons", "period": 1e6}}
"""Beacons that fall into no run: their phases are uniform over the period."""


def joules(**changes: Any) -> np.ndarray:
    """(3,) what each node consumes in a run."""
    nodes = wsnsim.simulate(NODES | changes).table("nodes")
    return (nodes.energy_initial - nodes.energy_left).to_numpy()


@pytest.mark.parametrize(("duration", "step"), [(20, 0.5), (20, 2), (20, 10), (40, 20)])
def test_nodes_that_only_listen_consume_for_the_duration_at_every_step(duration: float, step: float) -> None:
    energy = wsnsim.simulate(NODES | TRACKING, duration=duration, step=step).energy
    idle = energy[energy.cause == "idle"].groupby("node").joules.sum().to_numpy()
    assert idle == pytest.approx([LISTENING * duration] * 3, rel=1e-3)


@pytest.mark.parametrize(
    "change",
    [
        {"mac": {"kind": "xmac"}},
        {"sleep": {"kind": "duty_cycle", "period": 3, "awake_share": 0.3}},
        *thorough(
            [
                {},
                {"mac": {"kind": "contikimac"}},
                {"mac": {"kind": "tsch"}},
                {"sleep": {"kind": "ris", "period": 4, "probability": 0.5}, "clock": {"kind": "drift", "sd": "50 ppm"}},
            ]
        ),
    ],
    ids=str,
)
def test_a_network_whose_target_nobody_senses_consumes_what_a_workload_without_frames_does(change: Any) -> None:
    lasts = {"duration": 20, "step": 2}
    assert joules(**TRACKING, **lasts, **change) == pytest.approx(joules(**WORKLOAD, **lasts, **change), rel=1e-9)


@pytest.mark.parametrize("network", [TRACKING, WORKLOAD], ids=["target", "workload"])
def test_a_battery_for_25_seconds_lives_through_20_and_not_through_30(network: dict[str, Any]) -> None:
    battery = {"energy": NODES["energy"] | {"battery": LISTENING * 25}}
    alive, dead = (
        wsnsim.simulate(NODES | network | battery, duration=seconds, step=10).runs.first_death[0]
        for seconds in (20, 30)
    )
    assert np.isnan(alive) and dead == pytest.approx(25.0, rel=1e-3)


@pytest.mark.parametrize("change", [{}, {"network": "none"}, {"network": "none", "replicates": 2}], ids=str)
def test_instants_begin_at_0_and_end_a_step_before_the_end(change: dict[str, Any]) -> None:
    seen = wsnsim.run("liu_network", duration=10, step=2, keep=["truth", "estimates", "energy_steps"], **change)
    for number in range(change.get("replicates", 1)):
        truth, estimates = (t[t.replicate == number] for t in (seen.table("truth"), seen.estimates))
        assert truth.time.tolist() == [0, 2, 4, 6, 8] and estimates.time.tolist() == [2, 4, 6, 8]
    assert set(seen.runs.steps) == {4}
    if not change:
        assert sorted(set(seen.table("energy_steps").step)) == [0, 1, 2, 3, 4]


def test_a_run_that_tracks_has_at_least_two_steps() -> None:
    for change in ({}, {"network": "none"}):
        with pytest.raises(ScenarioError, match=r"duration: error: 2 s is one step of 2 s.* give at least 4 s"):
            wsnsim.simulate("liu_network", duration=2, step=2, **change)
        assert len(wsnsim.simulate("liu_network", duration=4, step=2, **change).estimates) == 1
    assert joules(**WORKLOAD, duration=20, step=20) == pytest.approx(joules(**WORKLOAD, duration=20, step=2), rel=1e-9)


BEFORE = {
    "rkf": (10, 1, 0.381765508511109, np.nan),
    "pso_mhpf": (0.4, 0.04, 5.263423282245251, 0.02082692371004319),
    "li_xmac": (20, 2, 2.422844558768886, 3.7121639139255427),
    "information_driven_asleep": (0.4, 0.04, np.nan, 0.09621508695784164),
    "two_targets": (0.4, 0.04, 3.8443840331146326, 0.04823430172967803),
    "recorded_network": (5, 0.5, 1.8201274235004965, 4.091311571219375),
}
"""(duration, step, RMSE, joules) of scenarios, as wsnsim 0.2.0 gave them; the joules of `li_xmac` (there 3.7085) as
they are since a radio that was turned off takes its time to start."""


@pytest.mark.parametrize("name", BEFORE)
def test_a_run_of_version_0_2_is_one_that_lasts_a_step_longer(name: str) -> None:
    duration, step, rmse, energy = BEFORE[name]
    run = wsnsim.simulate(name, duration=round(duration + step, 9)).runs.iloc[0]
    assert run.steps == round(duration / step)
    assert [run.rmse, run.energy] == pytest.approx([rmse, energy], rel=1e-6, nan_ok=True)


BEGIN = pd.Timestamp("2026-05-12T14:03:20Z")
SINCE_1970 = int(BEGIN.timestamp())
STEPS = np.array([0, 1, 2, 3, 6, 7, 11, 57, 58, 297, 298, 899])
OFF = 5e-7
"""s: as much as seconds since 1970 are wrong by, once a unit has been converted and an origin subtracted."""


def exact(step: float) -> list[Fraction]:
    """The times (s) of `STEPS`."""
    return [int(k) * Fraction(str(step)) for k in STEPS]


def unix(step: float) -> list[str]:
    return [f"{float(SINCE_1970 + time):.6f}" for time in exact(step)]


def dates(step: float) -> list[str]:
    return [f"{BEGIN + pd.Timedelta(microseconds=round(1e6 * time)):%Y-%m-%dT%H:%M:%S.%fZ}" for time in exact(step)]


def played(path: Path, times: list[str], step: float, origin: float) -> list[int]:
    """The steps in which a node has a reading, of the file with a reading at each of the times."""
    path.write_text("time,node,reading\n" + "".join(f"{time},a,{k}\n" for time, k in zip(times, STEPS, strict=True)))
    model = RecordedSensor(path=str(path), law=Range(), time_origin=origin)
    (recording,) = model.recordings(["a"], 1, int(STEPS[-1]), step)
    there = np.flatnonzero(recording.counts[:, 0])
    assert there.tolist() == recording.readings[there, 0].tolist()
    return there.tolist()


def imported(path: Path, times: list[str], step: float, origin: str, form: str = "") -> list[int]:
    path.write_text("time,node,range\n" + "".join(f"{time},a,{k}\n" for time, k in zip(times, STEPS, strict=True)))
    found = field_data.readings([str(path)], Conventions(time_origin=origin, time_format=form))
    path.write_text(found.text())
    written = [line.split(",")[0] for line in found.text().splitlines()[1:]]
    assert max(map(len, written)) <= len("1778594600.123456"), "no digits of rounding are written"
    return played(path, written, step, 0.0 if origin else SINCE_1970)


def multiples(step: float, size: int) -> list[str]:
    return [str(int(size * (SINCE_1970 + time))) for time in exact(step)]


def recorded_track(path: Path, step: float) -> list[int]:
    """The steps from which on a velocity holds that begins at a row, for tracks of one leg that begins there."""
    found = []
    for k in STEPS.tolist():
        times = [float(SINCE_1970) + each * step for each in (k, k + 1, k + 2)]
        path.write_text("time,x,y\n" + "".join(f"{time:.6f},{x},0\n" for time, x in zip(times, (0, 1, 3), strict=True)))
        track = RecordedTrack(path=str(path), time_origin=SINCE_1970, gap=1.5 * step)
        states = track.truth(k + 3, step, np.random.default_rng(0))
        assert np.flatnonzero(np.isfinite(states[:, 0])).tolist() == [k, k + 1, k + 2]
        assert states[k : k + 3, 1] == pytest.approx([1 / step, 2 / step, 0.0])
        found.append(k)
    return found


def waypoints(step: float) -> list[int]:
    """The first step at which each leg's velocity holds; times are a rounding error later than steps."""
    legs = Waypoints(points=tuple((k * step + OFF, float(i % 2), 0.0) for i, k in enumerate(STEPS.tolist())))
    velocity = legs.truth(int(STEPS[-1]), step, np.random.default_rng(0))[:, 1]
    return [*(np.flatnonzero(np.diff(velocity, prepend=0.0))).tolist()]


def fleeting(folder: Path, step: float) -> list[str]:
    """The times that an imported trace of SUMO has."""
    (folder / "s.csv").write_text("t;id;x;y\n" + "".join(f"{time};v;{i};0\n" for i, time in enumerate(unix(step))))
    trace = traces.read(str(folder / "s.csv"), sumo)
    placed = trajectories.placed(trace, trajectories.Placement(time_origin=SINCE_1970, sampled=True))
    return [line.split(",")[0] for line in trajectories.csv_text("v", placed.tracks["v"]).splitlines()[1:]]


def visits(step: float) -> list[int]:
    begins = tuple(float(4 * k * step + OFF) for k in STEPS)
    found = Visits(times=begins, lasting=step, of=Waypoints(points=((0.0, 0.0, 0.0), (1.0, 1.0, 0.0))))
    there = np.isfinite(found.truth(4 * int(STEPS[-1]), step, np.random.default_rng(0))[:, 0])
    return [int(k) // 4 for k in np.flatnonzero(np.diff(there, prepend=False) & there)]


def faults(step: float) -> list[int]:
    site: Any = SimpleNamespace(nodes=SimpleNamespace(size=1))
    schedule = FaultSchedule([], site, 0, step)
    assert all(schedule.snapped(k * step + off) == k * step for k in STEPS for off in (-OFF, OFF))
    assert schedule.snapped(0.99 * step) == 0.99 * step
    return STEPS.tolist()


def presence(step: float) -> list[int]:
    instants = np.arange(STEPS[-1] + 2) * step
    found = [np.flatnonzero(present_at(instants, ((k * step + OFF, (k + 1) * step - OFF),))) for k in STEPS.tolist()]
    assert all(len(each) == 2 for each in found)
    return [int(each[0]) for each in found]


SIBLINGS: dict[str, Callable[[Path, float], list[int]]] = {
    "readings at run time": lambda folder, step: played(folder / "r.csv", unix(step), step, SINCE_1970),
    "imported dates": lambda folder, step: imported(folder / "r.csv", dates(step), step, str(BEGIN)),
    "imported dates without an origin": lambda folder, step: imported(folder / "r.csv", dates(step), step, ""),
    "imported seconds": lambda folder, step: imported(folder / "r.csv", unix(step), step, str(SINCE_1970)),
    "imported ms": lambda folder, step: imported(folder / "r.csv", multiples(step, 10**3), step,
                                                 f"{SINCE_1970}000", "ms"),
    "imported ns": lambda folder, step: imported(folder / "r.csv", multiples(step, 10**9), step,
                                                 f"{SINCE_1970}{0:09}", "ns"),
    "an imported trace": lambda folder, step: played(folder / "r.csv", fleeting(folder, step), step, 0.0),
    "a recorded track": lambda folder, step: recorded_track(folder / "w.csv", step),
    "waypoints": lambda _, step: waypoints(step),
    "visits": lambda _, step: visits(step),
    "faults": lambda _, step: faults(step),
    "presence": lambda _, step: presence(step),
}  # fmt: skip


@pytest.mark.parametrize("step", [0.2, 0.1, 0.04, 0.125])
@pytest.mark.parametrize("sibling", SIBLINGS)
def test_a_time_that_is_that_of_an_instant_belongs_to_it(sibling: str, step: float, tmp_path: Path) -> None:
    assert SIBLINGS[sibling](tmp_path, step) == STEPS.tolist()


def test_a_run_may_last_as_long_as_the_rounds_of_recorded_links(tmp_path: Path) -> None:
    """Rounds begin every 10.2 s, at times since 1970."""
    rows = "".join(f"{time},{a},{b},26,-60,1,1\n" for time in dates(10.2)[:4] for a, b in ("12", "21"))
    header = '{"tx_length": 1, "interframe_duration": 1, "channels": [26], "node_count": 2}'
    (tmp_path / "l.k7").write_text(f"{header}\ndatetime,src,dst,channel,mean_rssi,pdr,tx_count\n{rows}")
    found = read_links(str(tmp_path / "l.k7"))
    assert found.starts[26].tolist() == [0.0, 10.2, 20.4, 30.6]


@settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.integers(0, 10**6), st.sampled_from([0.001, 0.01, 1 / 30, 0.2, 1.0, 60.0]), st.integers(0, 2 * 10**9))
def test_times_from_another_origin_are_those_of_decimals_to_a_microsecond(k: int, step: float, origin: int) -> None:
    time = origin + round(k * step, 6)
    assert since(time, origin) == pytest.approx(k * step, abs=5.1e-7)
    assert first_steps(since(np.array([time]), origin), step).tolist() == [k]
    late = since(np.array([time + 0.02 * step]), origin)
    assert first_steps(late, step).tolist() == [k + 1], "a reading of the future is never used"
