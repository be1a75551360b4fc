"""The fuzz test of `make fuzz`: new cases of every kind for hours, each in a process of its own with a time limit.

    python -m tests.fuzz.long --hours 0.1 [--seed N] [--kinds run,plugin]
    python -m tests.fuzz.long --kinds run --seed N --number M      one case again

Seed and position are kept in `results/fuzz.json`: the next call goes on where the last one ended, `--seed` starts
anew. A case that fails is written to `tests/fuzz/corpus/`, which `make thorough` replays: mend what it shows, or note
in its `known` why it has to stay. The exit code is 1 if a case failed.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import multiprocessing
import os
import resource
import sys
import tempfile
import time
from collections import Counter
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Final

from tests.fuzz.cases import KINDS, case
from tests.fuzz.hdf5_session import MEMORY
from tests.fuzz.judge import PROPERTIES, Case, faults
from tests.fuzz.properties import made
from wsnsim.base.errors import ScenarioError

HOME: Final = Path(__file__).parents[2]
STATE: Final = HOME / "results" / "fuzz.json"
CORPUS: Final = Path(__file__).parent / "corpus"
LIMIT: Final = 120.0
"""Seconds after which a case is said to hang. Most take a tenth of one."""
TALKS: Final = 60.0
"""Seconds between two lines on the terminal."""


def main(words: list[str] | None = None) -> int:
    """Try cases until the time is over; the number of the exit code says whether one failed."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz.long", description=__doc__.splitlines()[0])
    parser.add_argument("--hours", type=float, default=1.0, help="how long to try cases (default: 1)")
    parser.add_argument("--seed", type=int, help="start anew with this seed")
    parser.add_argument("--number", type=int, help="try only the cases with this number; print what is wrong with them")
    parser.add_argument("--kinds", default=",".join(KINDS), help="kinds of cases, by default all")
    parser.add_argument("--state", type=Path, default=STATE, help="file of seed and position")
    parser.add_argument("--corpus", type=Path, default=CORPUS, help="folder of cases that failed")
    options = parser.parse_args(words)
    kinds = [kind for kind in options.kinds.split(",") if kind]
    if unknown := [kind for kind in kinds if kind not in KINDS]:
        parser.error(f"unknown kinds {', '.join(unknown)} (known: {', '.join(KINDS)})")
    if options.number is not None:
        found = [fault for kind in kinds for fault in judged_apart(case(kind, options.number, options.seed or 0))[0]]
        print("\n".join(found) or "passed")
        return int(bool(found))
    state = read_state(options.state, options.seed)
    return 1 if explored(kinds, state, options.hours * 3600.0, options.state, options.corpus) else 0


def read_state(path: Path, seed: int | None) -> dict[str, Any]:
    """Seed, position and counts of the last call; new ones with another seed, or if there was none."""
    if seed is None:
        with contextlib.suppress(OSError, ValueError):
            found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
            return found
    return {"seed": seed or 0, "next": 0, "tried": {}, "failed": {}, "refused": 0, "seconds": 0.0}


def write_state(path: Path, state: dict[str, Any]) -> None:
    """Replace the file of seed and position at once."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(f".{os.getpid()}.part")
    part.write_text(json.dumps(state, indent=1) + "\n", encoding="utf-8")
    part.replace(path)


def explored(kinds: list[str], state: dict[str, Any], seconds: float, path: Path, corpus: Path) -> int:
    """Try cases of each kind in turn for so many seconds; return how many failed."""
    begin = said = last = time.monotonic()
    tried, failed = Counter(state["tried"]), Counter(state["failed"])
    before = failed.total()
    while time.monotonic() - begin < seconds:
        for kind in kinds:
            one = case(kind, state["next"], state["seed"])
            found, refused = judged_apart(one)
            tried[kind] += 1
            state["refused"] += refused
            if found:
                failed[kind] += 1
                print(f"{kept(one, corpus)}: {'; '.join(found)[:500]}")
                print(f"  to repeat it: {repeating(kind, state['next'], state['seed'])}")
        now = time.monotonic()
        state.update(next=state["next"] + 1, tried=dict(tried), failed=dict(failed))
        state["seconds"], last = state["seconds"] + now - last, now
        write_state(path, state)
        if now - said > TALKS:
            said = now
            print(report(state), flush=True)
    print(report(state))
    return failed.total() - before


def repeating(kind: str, number: int, seed: int = 0) -> str:
    """The command that tries a case again."""
    return f"python -m tests.fuzz.long --kinds {kind} --seed {seed} --number {number}"


def report(state: dict[str, Any]) -> str:
    """The counts in a line."""
    tried = ", ".join(f"{count} {kind}" for kind, count in state["tried"].items())
    failed = sum(state["failed"].values())
    hours = state["seconds"] / 3600.0
    return f"seed {state['seed']}, {hours:.2f} h: {tried}; {state['refused']} scenarios refused; {failed} failed"


def kept(one: Case, corpus: Path) -> Path:
    """Write a case that failed to the corpus; returns its file."""
    corpus.mkdir(parents=True, exist_ok=True)
    path = corpus / f"{one.name}.json"
    path.write_text(one.text(), encoding="utf-8")
    return path


def judged_apart(one: Case, limit: float = LIMIT) -> tuple[list[str], bool]:
    """What is wrong with a case, judged in a process of its own, and whether a scenario was refused."""
    context = multiprocessing.get_context("fork")  # a copy has compiled what this process has
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_judged, args=(one, sender))
    process.start()
    sender.close()
    answer: tuple[list[str], bool] = ([], False)
    try:
        if receiver.poll(limit):
            with contextlib.suppress(EOFError):
                answer = receiver.recv()
                process.join(limit)
                return answer
            process.join(limit)
            code = process.exitcode or 0
            return ([] if one.fragile and code < 0 else [f"the process ended with code {code}"]), False
        return [f"no end after {limit:g} s"], False
    finally:
        if process.is_alive():
            process.kill()
        process.join()
        receiver.close()


def _judged(one: Case, sender: Connection) -> None:
    with tempfile.TemporaryDirectory() as folder, open(os.devnull, "r+") as nothing:  # noqa: PTH123
        for stream in (0, 1, 2):
            os.dup2(nothing.fileno(), stream)
        if one.fragile:
            resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        found = faults(one, Path(folder))
        sender.send((found, _is_refused(one)))


def _is_refused(one: Case) -> bool:
    """Whether the parts of a sampled scenario refuse each other. Such cases are counted, not failed."""
    if one.arguments != (PROPERTIES,):
        return False
    from wsnsim import scenario

    try:
        scenario.build(scenario.load(json.loads(one.files["x.json"])))
    except ScenarioError:
        return True
    return False


if __name__ == "__main__":
    for number in range(20):  # what these compile, every process has
        with contextlib.suppress(Exception):
            made(json.loads(case("run", number).files["x.json"]))
    sys.exit(main())
