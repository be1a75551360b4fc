"""The fuzz test of the suite: random files, plug-ins and command lines, random runs, and the corpus.

A failing test names the kind and the number of its case: `case(kind, number)` makes it again, and a command tries it.
"""

from __future__ import annotations

import contextlib
import copy
import dataclasses
import itertools
import os
import re
import signal
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import Phase, example, given, settings
from hypothesis import strategies as st

from tests.fuzz import long
from tests.fuzz.cases import KINDS, case
from tests.fuzz.fates import fates, packets_in_are_packets_out_and_lost
from tests.fuzz.judge import Case, case_of, faults
from tests.fuzz.plugins import RIGHT, WRONG
from tests.fuzz.properties import OF_ALL, OF_NETWORKS, Run, broken, made
from tests.fuzz.random_scenarios import MOSTLY_OFF, sampled
from tests.helpers.thorough import THOROUGH
from wsnsim.base.errors import RunError, ScenarioError
from wsnsim.base.tables import KIND
from wsnsim.scenario.registry import ROLES

CORPUS = sorted((Path(__file__).parent / "corpus").glob("*.json"))
NUMBERS = st.integers(0, 2**32)
HANGS = 300.0
"""S of processor time, compilation included, after which a run counts as one that hangs."""
EXAMPLES = {"scenario": 150, "sweep": 150, "csv": 100, "command": 150, "hdf5": 100, "plugin": 100, "run": 60}
"""Examples per kind in `make thorough`; the fast tier tries five."""


def tried(examples: int) -> settings:
    """So many examples in `make thorough`; the fast tier tries five. A smaller number is no simpler case."""
    return settings(max_examples=examples if THOROUGH else 5, phases=(Phase.explicit, Phase.generate))


def faults_of(one: Case) -> list[str]:
    """What is wrong with what a command does with a case."""
    with tempfile.TemporaryDirectory() as folder:
        return faults(one, Path(folder))


def assert_behaves(kind: str, number: int) -> None:
    found = faults_of(case(kind, number))
    assert not found, (long.repeating(kind, number), found)


def _replayed(path: Path) -> object:
    known = case_of(path.read_text(encoding="utf-8")).known
    return pytest.param(path, id=path.stem, marks=pytest.mark.xfail(strict=True, reason=known) if known else ())


@pytest.mark.thorough(fast=["properties-27749e0b39", "properties-fdf8371f05"])
@pytest.mark.parametrize("path", list(map(_replayed, CORPUS)))
def test_what_once_failed_does_not_fail_again(path: Path) -> None:
    assert faults_of(case_of(path.read_text(encoding="utf-8"))) == []


@tried(EXAMPLES["scenario"])
@given(NUMBERS)
def test_a_mutated_scenario_is_checked_or_refused_in_words(number: int) -> None:
    assert_behaves("scenario", number)


@tried(EXAMPLES["sweep"])
@given(NUMBERS)
def test_a_mutated_sweep_is_planned_or_refused_in_words(number: int) -> None:
    assert_behaves("sweep", number)


@pytest.mark.thorough
@tried(EXAMPLES["csv"])
@given(NUMBERS)
def test_mutated_positions_and_waypoints_are_run_or_refused_in_words(number: int) -> None:
    assert_behaves("csv", number)


@pytest.mark.thorough
@tried(EXAMPLES["command"])
@given(NUMBERS)
def test_a_random_command_line_is_answered_or_refused_in_words(number: int) -> None:
    assert_behaves("command", number)


@pytest.mark.thorough
@tried(EXAMPLES["hdf5"])
@given(NUMBERS)
def test_a_damaged_result_is_read_or_refused_in_words(number: int) -> None:
    assert_behaves("hdf5", number)


@pytest.mark.thorough
@tried(EXAMPLES["plugin"])
@given(NUMBERS)
def test_a_faulty_plug_in_is_named_and_nothing_is_left(number: int) -> None:
    assert_behaves("plugin", number)


@pytest.mark.thorough
@tried(EXAMPLES["run"])
@given(NUMBERS)
@example(1153)  # a node that consumes in one span more than its battery gives
def test_every_run_of_a_random_scenario_has_the_properties_of_all_runs(number: int) -> None:
    try:
        run = made(sampled(number))
    except ScenarioError:
        return  # a combination that the parts refuse; `make fuzz` counts them
    except RunError as error:
        assert "Error: " not in str(error), (number, error)
        return
    assert not broken(run), (number, broken(run))


@pytest.mark.thorough
@tried(40)
@given(NUMBERS)
def test_so_has_every_run_over_radios_that_are_off_most_of_the_time(number: int) -> None:
    """The next valid scenario from a number on in which something is sent, within a limit of processor time."""
    run, tried_numbers = None, itertools.count(number)
    while run is None or not run.radios.frames:
        number = next(tried_numbers)
        if not is_mostly_off(sampled(number)):
            continue
        with processor_time(HANGS, f"scenario {number}"):
            try:
                run = made(sampled(number))
            except ScenarioError:
                continue
            except RunError as error:
                assert "Error: " not in str(error), (number, error)
                continue
    assert not broken(run), (number, broken(run))


@contextlib.contextmanager
def processor_time(seconds: float, what: str) -> Iterator[None]:
    """Fail if the block takes more seconds of this process's time: a run that hangs would block the whole suite."""

    def fail(*_: object) -> None:
        pytest.fail(f"{what} takes more than {seconds:g} s of processor time")

    before = signal.signal(signal.SIGVTALRM, fail)
    signal.setitimer(signal.ITIMER_VIRTUAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
        signal.signal(signal.SIGVTALRM, before)


def test_a_block_that_hangs_is_ended() -> None:
    with pytest.raises(pytest.fail.Exception, match="a loop takes more than"), processor_time(0.05, "a loop"):
        while True:
            pass


@pytest.mark.thorough
def test_most_random_scenarios_are_valid_and_all_kinds_of_cases_differ_by_their_number() -> None:
    refused = 0
    for number in range(20):
        try:
            made_setup(number)
        except ScenarioError:
            refused += 1
    assert refused <= 8
    for kind in KINDS:
        assert case(kind, 1).text() == case(kind, 1).text() == case_of(case(kind, 1).text()).text()
        assert len({case(kind, number).text() for number in range(10)}) > 3


LISTS = {"motion": "targets", "fault": "faults"}


@pytest.mark.thorough
def test_every_kind_of_every_role_occurs_in_the_random_scenarios() -> None:
    missing = {(name, info.kind) for name, role in ROLES.items() for info in role.kinds}
    for number in range(400):
        values = sampled(number)
        found = {name: values.get(LISTS.get(name, name), []) for name in ROLES}
        found |= {inner: values.get("tracker", {}).get(inner, []) for inner in ("management", "trigger")}
        parts = ((name, part) for name, held in found.items() for part in (held if isinstance(held, list) else [held]))
        missing -= {(name, part.get("kind")) for name, part in parts}
        if not missing:
            break
    assert not missing


def is_mostly_off(values: dict[str, Any]) -> bool:
    """Whether the scenario has a network whose MAC turns radios off."""
    return values.get("network") != "none" and values["mac"]["kind"] in MOSTLY_OFF


def made_setup(number: int) -> object:
    from wsnsim import scenario

    return scenario.build(scenario.load(sampled(number)))


def test_every_fault_of_plug_ins_is_one_that_the_plug_in_without_faults_lacks() -> None:
    assert len({RIGHT.replace(before, after, 1) for before, after in WRONG} - {RIGHT}) == len(WRONG)


@pytest.fixture(scope="module")
def sound() -> Run:
    """A network with sleeping nodes, deaths, losses and reports, in which every property holds."""
    values = {
        "name": "sound", "seed": 3, "step": 0.2, "duration": 2.0,
        "deploy": {"kind": "grid", "nodes": 16, "width": 100.0, "height": 100.0, "cover": False},
        "motion": {"kind": "constant_velocity", "start": [-20.0, 10.0, 3.0, 1.0]},
        "sensor": {"kind": "range", "reach": 40.0},
        "energy": {"kind": "first_order", "battery": 0.02, "idle": 1e-3},
        "link": {"kind": "disk", "reach": 60.0, "loss": 0.2}, "mac": {"kind": "csma"},
        "sleep": {"kind": "duty_cycle", "period": 0.4, "awake_share": 0.6},
        "sink": {"kind": "node", "every": 0.2}, "tracker": {"kind": "ekf"},
        "faults": [{"kind": "drain", "at": 1.1, "nodes": [5], "share": 1.0}],
    }  # fmt: skip
    return made(values)


def doctored(run: Run, table: str, column: str, change: object) -> Run:
    """The run with the values of a column changed."""
    other = dataclasses.replace(run, memory=copy.deepcopy(run.memory))
    values = other.memory.table(table)
    values[column] = np.array(change(values), dtype=values[column].dtype)  # type: ignore[operator]
    other.memory._pieces[table] = [values]
    return other


def where_kind(values: dict[str, np.ndarray], kind: str, name: str, value: float) -> np.ndarray:
    """A column of events with a value in its rows of one kind."""
    return np.where(values["kind"] == KIND[kind], value, values[name])


DOCTORED = {
    "estimates_are_finite": ("estimates", "error", lambda t: t["error"] * np.nan),
    "estimates_follow_their_step": ("estimates", "issued", lambda t: t["issued"] - 1.0),
    "the_ledger_closes": ("energy", "joules", lambda t: t["joules"] * 1.0001),
    "nobody_spends_more_than_its_battery": ("nodes", "energy_left", lambda t: t["energy_left"] - 0.02),
    "nothing_happens_before_its_cause": ("events", "time", lambda t: where_kind(t, "receive", "time", 0.001)),
    "nobody_acts_while_down": ("events", "node", lambda t: where_kind(t, "send", "node", 5)),
    "nobody_hears_while_asleep": ("events", "node", lambda t: where_kind(t, "receive", "node", 2)),
    "packets_are_received_or_lost": ("events", "packets", lambda t: where_kind(t, "receive", "packets", 99)),
    "packets_in_are_packets_out_and_lost": ("events", "kind", lambda t: relabelled(t, "receive", "overhear")),
    "estimates_use_what_arrived": ("estimates", "readings", lambda t: t["readings"] + 9),
}


def relabelled(values: dict[str, np.ndarray], kind: str, other: str) -> np.ndarray:
    """The kinds of events with those of packets of one kind turned into another."""
    return np.where((values["kind"] == KIND[kind]) & (values["packets"] > 0), KIND[other], values["kind"])


@pytest.mark.thorough
def test_each_packet_has_one_fate_and_a_missing_or_a_second_one_is_noticed(
    sound: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = sum(one.packets * len(one.receivers) for one in sound.frames.given)
    assert fates(sound).total() == given and fates(sound)[""] == 0, "packets in = packets out + lost + on their way"
    assert all(fates(sound)[name] for name in ("received", "collided", "dropped", "asleep"))
    for kind in ("receive", "collide", "drop"):
        missing = doctored(sound, "events", "kind", lambda t, kind=kind: relabelled(t, kind, "overhear"))
        assert packets_in(missing), kind
        second = doctored(sound, "events", "kind", lambda t, kind=kind: relabelled(t, "overhear", kind))
        assert packets_in(second), kind
    for name in ("frames_sent", "packets_sent", "delivered", "collided"):
        summary = dataclasses.replace(sound.summary, run={**sound.summary.run, name: sound.summary.run[name] + 1})
        assert any(f"the run's {name} is" in found for found in packets_in(dataclasses.replace(sound, summary=summary)))
    monkeypatch.setattr(sound.frames.given[0], "reported", None)
    assert any("overtook" in found for found in packets_in(sound))


def packets_in(run: Run) -> list[str]:
    """What the equality of packets says of a run."""
    return list(packets_in_are_packets_out_and_lost(run))


@pytest.mark.thorough
def test_each_property_notices_a_table_in_which_it_is_broken(sound: Run) -> None:
    assert broken(sound) == []
    assert {*DOCTORED, "nobody_hears_with_the_radio_off"} == {rule.__name__ for rule in (*OF_ALL, *OF_NETWORKS)}
    for name, change in DOCTORED.items():
        assert any(found.startswith(f"{name}: ") for found in broken(doctored(sound, *change))), name


@pytest.mark.thorough(fast=["tsch"])
@pytest.mark.parametrize("mac", MOSTLY_OFF)
def test_a_radio_that_hears_while_it_is_off_is_noticed(mac: str) -> None:
    values = {
        "name": "off", "seed": 3, "step": 1.0, "duration": 6.0,
        "deploy": {"kind": "grid", "nodes": 9, "width": 40.0, "height": 40.0, "cover": False},
        "workload": {"kind": "beacons", "period": 3.0, "bits": 96}, "link": {"kind": "disk", "reach": 60.0},
        "energy": {"kind": "first_order", "idle": 1e-3}, "mac": {"kind": mac},
    }  # fmt: skip
    run = made(values)
    assert not broken(run) and run.summary.run["radio_on"] > 0.0
    events = run.events
    heard = int(events["frame"][run.rows("receive")[0]])
    frame = run.radios.frames[heard]
    frame.start, frame.end = frame.start - 0.02, frame.end - 0.02  # before the radios were turned on for it
    frame.local = {node: time - 0.02 for node, time in frame.local.items()}
    assert any(found.startswith("nobody_hears_with_the_radio_off") for found in broken(run))


def test_a_mutant_may_end_the_process_that_reads_it_and_other_cases_may_not(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(long, "faults", lambda one, folder: os.kill(os.getpid(), signal.SIGKILL))
    assert long.judged_apart(case("mutant", 3)) == ([], False)
    assert long.judged_apart(case("hdf5", 3)) == ([f"the process ended with code {-signal.SIGKILL}"], False)


def test_the_fuzz_test_goes_on_where_it_ended_keeps_what_failed_and_says_how_to_repeat_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    seen: list[str] = []

    def judged(one: Case) -> tuple[list[str], bool]:
        seen.append(one.text())
        return (["a fault"] if len(seen) == 2 else []), False

    monkeypatch.setattr(long, "judged_apart", judged)
    monkeypatch.setattr(long.time, "monotonic", iter(np.arange(0.0, 100.0, 0.5)).__next__)
    words = [
        "--kinds",
        "sweep",
        "--hours",
        "0.001",
        "--state",
        str(tmp_path / "f.json"),
        "--corpus",
        str(tmp_path / "c"),
    ]
    assert long.main(words) == 1
    first = len(seen)
    assert long.main(words) == 0 and len(seen) > first
    assert seen == [case("sweep", number).text() for number in range(len(seen))]
    (kept,) = (tmp_path / "c").iterdir()
    said = capsys.readouterr().out
    assert kept.read_text(encoding="utf-8") == seen[1] and "1 failed" in said
    (command,) = re.findall(r"to repeat it: python -m tests\.fuzz\.long (.*)", said)
    monkeypatch.setattr(long, "judged_apart", lambda one: ([one.text()], False))
    assert long.main(command.split()) == 1 and seen[1] in capsys.readouterr().out
