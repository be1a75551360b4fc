"""Recorded links as a component: rounds in simulated time, the mapping of nodes, and what `check` refuses."""

from __future__ import annotations

import gzip
import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.models.test_k7file import GRENOBLE, row, written
from wsnsim.base.errors import ScenarioError
from wsnsim.models.deploy import Anchors, Grid
from wsnsim.models.recorded_links import RecordedLinks
from wsnsim.scenario import build, load


def three_rounds(folder: Path) -> str:
    """Three nodes and three rounds, 1000 s and 2000 s apart: who hears whom differs from round to round."""
    return written(
        folder,
        row(0, 0, 1, 0.1), row(0, 0, 2, 0.2), row(20, 1, 0, 0.3), row(40, 2, 0, 0.4),
        row(1000, 0, 1, 0.5), row(1020, 1, 2, 0.6), row(1040, 2, 1, 0.7),
        row(3000, 0, 2, 0.8), row(3020, 1, 0, 0.0), row(3040, 2, 1, 0.9), row(3040, 2, 0, 0.95),
        row(60, 0, 1, 1.0, channel=26),
    )  # fmt: skip


def second_half(folder: Path) -> str:
    """The second half of the rows of the shipped file, with its first two lines."""
    with gzip.open(GRENOBLE, "rt") as file:
        header, columns, *rows = file.read().splitlines()
    return written(folder, *rows[len(rows) // 2 :], header=header, columns=columns)


def setup(nodes: int = 3, duration: float = 100.0) -> Any:
    return SimpleNamespace(deploy=Grid(nodes=nodes, width=10.0, height=10.0), duration=duration)


def ratios(link: RecordedLinks, number: int, source: int) -> dict[int, float]:
    ids, powers, values = link.heard(number, source)
    assert powers.tolist() == [-80.5] * ids.size
    return dict(zip(ids.tolist(), values.tolist(), strict=True))


def issues(link: RecordedLinks, made: Any) -> list[tuple[Any, str]]:
    return [(issue.path, issue.message) for issue in link.check(made)]


def test_a_link_without_a_row_in_a_round_is_not_heard_in_it(tmp_path: Path) -> None:
    link = RecordedLinks(path=three_rounds(tmp_path), channel=11)
    assert [ratios(link, number, 0) for number in range(3)] == [{1: 0.1, 2: 0.2}, {1: 0.5}, {2: 0.8}]
    assert [ratios(link, number, 1) for number in range(3)] == [{0: 0.3}, {2: 0.6}, {}]
    assert [ratios(link, number, 2) for number in range(3)] == [{0: 0.4}, {1: 0.7}, {0: 0.95, 1: 0.9}]
    assert ratios(RecordedLinks(path=link.path, channel=26), 0, 0) == {1: 1.0}


def test_a_round_lasts_until_the_next_one_was_recorded_and_the_last_one_until_the_end(tmp_path: Path) -> None:
    path = three_rounds(tmp_path)
    link = RecordedLinks(path=path, channel=11)
    assert [link.round_end(number) for number in range(3)] == [1000.0, 3000.0, math.inf]
    later = RecordedLinks(path=path, channel=11, start=1)
    assert [later.round_end(number) for number in range(2)] == [2000.0, math.inf]
    assert ratios(later, 0, 0) == {1: 0.5}
    played = RecordedLinks(path=path, channel=11, round_length=7.0)
    assert [played.round_end(number) for number in range(3)] == [7.0, 14.0, math.inf]


def test_a_recording_that_wraps_begins_again_with_its_first_round(tmp_path: Path) -> None:
    link = RecordedLinks(path=three_rounds(tmp_path), channel=11, start=1, wrap=True)
    assert [link.round_end(number) for number in range(5)] == [2000.0, 3500.0, 4500.0, 6500.0, 8000.0]
    assert [ratios(link, number, 0) for number in range(4)] == [{1: 0.5}, {2: 0.8}, {1: 0.1, 2: 0.2}, {1: 0.5}]


def test_nodes_are_mapped_in_the_order_of_the_list(tmp_path: Path) -> None:
    link = RecordedLinks(path=three_rounds(tmp_path), channel=11, map=(2, "0"))
    assert (ratios(link, 0, 0), ratios(link, 0, 1)) == ({1: 0.4}, {0: 0.2})
    assert (ratios(link, 2, 0), ratios(link, 2, 1)) == ({1: 0.95}, {0: 0.8})
    assert issues(link, setup(nodes=2)) == []


def test_only_rounds_that_were_recorded_as_a_whole_are_played(tmp_path: Path) -> None:
    whole = [row(1000 * number + 20 * i, i, 0 if i else 1, 0.1 + 0.2 * number) for number in range(4) for i in range(3)]
    link = RecordedLinks(path=written(tmp_path, *whole[1:-2]), channel=11, start=1)
    assert ratios(link, 0, 1) == {0: pytest.approx(0.5)}
    assert link.round_end(0) == math.inf
    assert issues(link, setup(duration=1000.0)) == []
    assert [path for path, _ in issues(link, setup(duration=1001.0))] == [("link", "wrap")]


@pytest.mark.thorough
def test_of_the_second_half_of_a_recording_the_rounds_are_the_same(tmp_path: Path) -> None:
    """The shipped file cut within a burst: each channel has the later rounds, of which the first may be incomplete."""
    path = second_half(tmp_path)
    for channel in (11, 17, 18, 26):
        whole, later = RecordedLinks(path=str(GRENOBLE), channel=channel), RecordedLinks(path=path, channel=channel)
        left_out = 5 if channel < 15 else 4
        last = int(whole.recording.complete[channel].sum()) - 1
        first = last - int(later.recording.complete[channel].sum()) + 1
        assert first in (left_out, left_out + 1)
        for number in (first, last):
            for source in range(50):
                assert ratios_of(whole, number, source) == ratios_of(later, number - first, source)


def test_a_channel_without_a_round_that_was_recorded_as_a_whole_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path, row(0, 0, 1), row(20, 1, 0), row(40, 0, 1, channel=26))
    link = RecordedLinks(path=path, channel=26)
    assert issues(link, setup(nodes=3)) == [(("link", "channel"), f"{path} has no whole round of channel 26")]


def ratios_of(link: RecordedLinks, number: int, source: int) -> list[tuple[int, float, float]]:
    return [*zip(*(column.tolist() for column in link.heard(number, source)), strict=True)]


def test_a_scenario_that_the_recording_does_not_fit_is_refused(tmp_path: Path) -> None:
    path = three_rounds(tmp_path)

    def said(made: Any, **values: Any) -> list[tuple[Any, str]]:
        return issues(RecordedLinks(**{"path": path, "channel": 11, **values}), made)

    assert said(setup()) == said(setup(duration=4500.0)) == said(setup(duration=1e6), wrap=True) == []
    assert said(setup(), channel=12) == [(("link", "channel"), f"{path} has no channel 12; it has 11, 26")]
    assert said(setup(), start=3) == [
        (("link", "start"), "must be less than the 3 rounds of channel 11, is 3"),
    ]
    assert said(setup(duration=4501.0)) == [
        (
            ("link", "wrap"),
            "the run of 4501 s is longer than the 3 rounds from link.start on, which last 4500 s; give wrap: true, or "
            "a longer round_length",
        )
    ]
    assert said(setup(nodes=4)) == [
        (("link", "map"), f"{path} has 3 nodes, but the scenario 4: say which, in their order"),
    ]
    assert said(setup(nodes=3), map=(0, 1)) == [(("link", "map"), "names 2 nodes, but the scenario has 3")]
    assert said(setup(nodes=2), map=(0, 7)) == [
        (("link", "map", 1), f"{path} has no node 7 (known: 0, 1, 2)"),
    ]
    assert said(setup(), path=str(tmp_path / "none.k7"))[0][0] == ("link", "path")
    made = SimpleNamespace(deploy=Anchors(places=((0.0, 0.0),)), duration=1.0)
    assert [path for path, _ in said(made)] == [("link", "map")]


def test_links_are_joined_to_the_nodes_of_a_file_by_name_whatever_their_order(tmp_path: Path) -> None:
    path = written(tmp_path, row(0, "m1", "m7", 0.1), row(20, "m7", "m1", 0.3), row(40, "m9", "m1", 0.4))
    for names in (("m9", "m1", "m7"), ("m7", "m9", "m1")):
        (tmp_path / "n.csv").write_text("id,x,y\n" + "".join(f"{name},{i},{i}\n" for i, name in enumerate(names)))
        changes = ["duration=1 s", "step=1 s", f"link={{kind: recorded, path: {path}, channel: 11, round_length: 1 s}}"]
        file = f"{{kind: file, path: {tmp_path}/n.csv, fit: true, cover: false}}"
        made: Any = build(load("recorded_links", [*changes, f"deploy={file}"]))
        assert ratios(made.link, 0, names.index("m7")) == {names.index("m1"): 0.3}
    with pytest.raises(ScenarioError, match="have no name of a node in common: 0, 1, 2; m1, m7, m9; name the rec"):
        build(load("recorded_links", [*changes, "deploy={kind: grid, nodes: 3, cover: false}"]))
    (tmp_path / "n.csv").write_text("mote,x,y\nm1,0,0\nm7,1,1\nm9,2,2\n")
    with pytest.raises(ScenarioError, match=r"the column 'mote' looks like names: columns: \{id: mote\}"):
        build(load("recorded_links", [*changes, f"deploy={file}"]))


def test_values_that_make_no_sense_together_are_refused() -> None:
    with pytest.raises(ValueError, match="bad must be less than good"):
        RecordedLinks(path="x", good=0.5, bad=0.5)
    with pytest.raises(ValueError, match="map must name each node of the recording once, 3 stands there more often"):
        RecordedLinks(path="x", map=(3, 1, "3"))


def test_no_link_follows_from_a_distance() -> None:
    link = RecordedLinks(path="x")
    keys = np.zeros(2, dtype=np.uint64)
    assert link.powers(np.array([0.0, 1.0]), keys, keys).tolist() == [-np.inf, -np.inf]
    assert not link.perfect and math.isinf(link.audible)


def test_rows_that_are_left_out_are_listed_and_a_changed_file_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path, row(0, 0, 1), row(0, 0, 2, 1.5), row(20, 1, 2))
    link = RecordedLinks(path=path, channel=11, skip_bad_rows=True)
    assert link.skipped_rows(setup()) == ["links.k7:4: pdr must be a number from 0 to 1, is '1.5'"]
    assert [(where, said.count("links.k7:4:")) for where, said in issues(RecordedLinks(path=path), setup())] == [
        (("link", "path"), 1)
    ]
    (said,) = issues(RecordedLinks(path=path, channel=11, skip_bad_rows=True, digest="0" * 16), setup())
    assert said[0] == ("link", "path") and "the file has changed" in said[1]
