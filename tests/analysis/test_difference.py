"""Two results part where a hand has made them part, and nowhere else."""

from __future__ import annotations

import itertools
import json

import numpy as np
import pytest

from tests.helpers.thorough import thorough
from wsnsim.analysis import difference
from wsnsim.analysis.difference import as_json, differ, text
from wsnsim.recording import ResultFile

NAN = float("nan")
TABLES = ("runs", "nodes", "truth", "estimates", "events")
WORDS = ("", "reading", "join")


@pytest.fixture
def made(tmp_path, states, rows_of):
    """made(name, change=..., settings=...) -> a result of two replicates; `change(tables)` alters its rows first."""

    def make(name, change=lambda tables: None, settings=None, words=WORDS, tables=TABLES, replicates=(0, 1)):
        path = tmp_path / f"{name}.h5"
        with ResultFile(path, states, dict.fromkeys(tables, True), position=(0, 2)) as file:
            file.set_text("scenario/resolved_json", json.dumps(settings or {"name": "toy", "mac": {"kind": "ideal"}}))
            for word in words:
                file.words.code(word)
            rows = {(table, number): _rows(rows_of, table, number) for table in tables for number in replicates}
            change(rows)
            for (table, _), columns in rows.items():
                if table == "events":
                    columns["what"] = [file.words.code(WORDS[code]) for code in columns["what"]]
                file.write(table, columns)
        return path

    return make


def _rows(rows_of, table, replicate):
    count = {"runs": 1, "events": 40}.get(table, 9)
    columns = rows_of(table, count, seed=replicate) | {"replicate": np.full(count, replicate)}
    if table in ("truth", "estimates"):
        columns |= {"step": np.arange(count) // 3 + 1, "target": np.arange(count) % 3}
    if table == "events":
        columns["what"] = columns["what"] % len(WORDS)
    return columns


def put(table, replicate, column, row, value):
    """A change of one value."""

    def change(tables):
        tables[table, replicate][column][row] = value

    return change


@pytest.mark.thorough
def test_equal_results_are_the_same_and_nan_equals_nan(made):
    nan = put("estimates", 1, "error", 4, NAN)
    found = differ(made("a", nan), made("b", nan))
    assert found.same
    assert [one.tables for one in found.replicates] == [dict.fromkeys(TABLES, True)] * 2
    assert "are equal bit for bit" in " ".join(text(found).split())


@pytest.mark.thorough
def test_the_last_bit_counts(made):
    def nudge(tables):
        values = tables["truth", 0]["px"]
        values[3] = np.nextafter(values[3], np.inf)

    found = differ(made("a"), made("b", nudge))
    assert not found.same
    assert [one.truth for one in found.replicates] == [False, True]
    assert " differ " in " ".join(text(found).split())


PAIRS = [(0, 1 << 22), (13, 1), (39, 260)]
OTHERS = [pair for pair in itertools.product((0, 13, 39), (1, 260, 1 << 22)) if pair not in PAIRS]


@pytest.mark.thorough
@pytest.mark.parametrize("pair", [*PAIRS, *thorough(OTHERS)])
def test_events_part_at_the_first_that_differs_whatever_the_blocks(made, monkeypatch, pair):
    row, block = pair
    monkeypatch.setattr(difference, "BLOCK", block)

    def change(tables):
        for at in range(row, 40, 5):
            tables["events", 1]["node"][at] = 777

    found = differ(made("a"), made("b", change))
    first, second = found.replicates
    assert first.event is None and second.event is not None
    number, one, other = second.event
    assert number == row
    assert other[2].startswith("node 777: ") and one[2].partition(": ")[2] == other[2].partition(": ")[2]
    assert one[:2] == other[:2] and text(found).count(f"first differing event: number {row + 1} of the run") == 1


@pytest.mark.thorough
def test_events_that_end_early_part_at_their_end(made):
    def cut(tables):
        tables["events", 0] = {name: values[:25] for name, values in tables["events", 0].items()}

    event = differ(made("a"), made("b", cut)).replicates[0].event
    assert event is not None and event[0] == 25 and event[1] is not None and event[2] is None


@pytest.mark.thorough
def test_words_are_compared_and_not_their_codes(made):
    assert differ(made("a"), made("b", words=("", "join", "reading"))).same


@pytest.mark.thorough
def test_the_first_estimate_that_differs_is_that_of_the_earliest_step_and_says_how_far_apart(made):
    def change(tables):
        columns = tables["estimates", 0]
        columns["px"][7] += 1e6
        columns["px"][5] += 3.0
        columns["py"][5] += 4.0

    first = differ(made("a"), made("b", change)).replicates[0].estimate
    assert first is not None and (first["step"], first["target"]) == (2, 2)
    assert first["apart"] == pytest.approx(5.0)
    assert first["columns"] == ["px", "py"]


@pytest.mark.thorough
def test_an_estimate_that_one_did_not_issue_is_said_so(made):
    def skip(tables):
        for name in ("px", "py", "error"):
            tables["estimates", 0][name][5] = NAN

    assert "first differing estimate: step 2 of target 2: B issued none" in text(differ(made("a"), made("b", skip)))


@pytest.mark.thorough
def test_truth_and_network_say_whether_the_comparison_is_fair(made):
    found = differ(made("a"), made("b", put("nodes", 0, "x", 2, 1.0)))
    assert [(one.truth, one.network) for one in found.replicates] == [(True, False), (True, True)]
    spent = differ(made("a"), made("c", put("nodes", 0, "energy_left", 2, 1.0)))
    assert spent.replicates[0].network and not spent.same
    assert "same ground truth, DIFFERENT network" in text(found)


@pytest.mark.thorough
def test_settings_that_differ_have_dotted_paths_and_both_values(made):
    one = {"name": "toy", "mac": {"kind": "ideal", "rate": None}, "faults": [{"at": 1.0}], "sd": [1, 2]}
    other = {"name": "toy", "mac": {"kind": "csma"}, "faults": [{"at": 2.0}], "sd": [1, 3]}
    found = differ(made("a", settings=one), made("b", settings=other))
    assert found.settings == {
        "mac.kind": ("ideal", "csma"),
        "mac.rate": (None, "(absent)"),
        "faults.0.at": (1.0, 2.0),
        "sd": ([1, 2], [1, 3]),
    }
    assert found.same, "what was simulated is what is compared"


@pytest.mark.thorough
def test_what_only_one_holds_is_named_and_the_two_are_not_the_same(made):
    found = differ(made("a", tables=("runs", "truth")), made("b", tables=("runs", "nodes"), replicates=(0, 1, 2)))
    assert found.lacking == ["only A holds table truth", "only B holds table nodes", "only B holds replicate 2"]
    assert not found.same


@pytest.mark.thorough
def test_processor_time_is_shown_and_not_compared(made):
    found = differ(made("a"), made("b", put("runs", 0, "cpu_seconds", 0, 99.0)))
    assert found.same and found.replicates[0].figures["cpu_seconds"][1] == 99.0


@pytest.mark.thorough
def test_figures_stand_side_by_side_with_their_difference(made):
    change, before = put("runs", 0, "rmse", 0, 7.5), put("runs", 0, "rmse", 0, 2.25)
    lines = text(differ(made("a", before), made("b", change))).splitlines()
    (row,) = [line.split() for line in lines if line.split()[:1] == ["rmse"]]
    assert row == ["rmse", "2.25", "7.5", "+5.25"]
    assert json.loads(json.dumps(as_json(differ(made("c", before), made("d", change)))))["same"] is False
