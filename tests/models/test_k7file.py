"""Recorded links in the K7 format: bursts and rounds, the shipped recording, and files that cannot be used."""

from __future__ import annotations

import csv
import gzip
import json
import random
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from wsnsim.base.errors import RunError, printable
from wsnsim.models.k7file import read_links
from wsnsim.models.link_recording import LinkRecording

GRENOBLE = Path(__file__).parents[2] / "scenarios" / "recorded" / "links" / "grenoble_first_half.k7.gz"
HEADER = '{"tx_length": 100, "interframe_duration": 100, "channels": [11, 26], "node_count": 3}'
COLUMNS = "datetime,src,dst,channel,mean_rssi,pdr,tx_count"


def row(seconds: float, source: object, receiver: object, ratio: object = 0.5, channel: object = 11) -> str:
    minute, second = divmod(int(seconds), 60)
    return (
        f"2020-01-01T{minute // 60:02d}:{minute % 60:02d}:{second:02d},{source},{receiver},{channel},-80.5,{ratio},100"
    )


def written(folder: Path, *rows: str, header: str = HEADER, columns: str = COLUMNS) -> str:
    path = folder / "links.k7"
    path.write_text("\n".join([header, columns, *rows]) + "\n")
    return str(path)


def links(folder: Path, *rows: str, **lines: str) -> LinkRecording:
    return read_links(written(folder, *rows, **lines))


def test_the_shipped_recording_has_ten_rounds_of_seven_channels_and_nine_of_the_others() -> None:
    recording = read_links(str(GRENOBLE))
    assert recording.times.size == 54_586 - 5  # those of the last burst, which may be cut
    assert recording.nodes == tuple(map(str, range(50)))
    rounds = {channel: int(complete.sum()) for channel, complete in recording.complete.items()}
    assert rounds == dict.fromkeys(range(11, 18), 10) | dict.fromkeys(range(18, 27), 9)
    for channel, sent in recording.sent.items():
        assert sent[recording.complete[channel]].all()
        assert np.all(np.abs(np.diff(recording.starts[channel][recording.complete[channel]]) - 9060.0) < 60.0)


@pytest.mark.thorough
def test_times_of_the_shipped_rows_are_those_of_the_first_packet_and_not_of_rounds() -> None:
    """The share of link-channels without a row in some round, and mean ratios, by bursts and by times of rows.

    Bursts are found without our reader: rows that follow one another in the file with the same sender and channel.
    """
    with gzip.open(GRENOBLE, "rt") as file:
        next(file)
        rows = [
            (datetime.fromisoformat(r["datetime"]), int(r["src"]), int(r["dst"]), int(r["channel"]), float(r["pdr"]))
            for r in csv.DictReader(file)
        ]
    senders = np.array([(source, channel) for _, source, _, channel, _ in rows])
    burst = np.concatenate([[0], np.cumsum((np.diff(senders, axis=0) != 0).any(axis=1))])
    times = np.array([(time - rows[0][0]).total_seconds() for time, *_ in rows])
    ratios, receivers = np.array([ratio for *_, ratio in rows]), np.array([receiver for _, _, receiver, *_ in rows])
    late = times - times[np.searchsorted(burst, burst)]
    assert late.max() == 10.0
    assert np.all(ratios <= 1.0 - (late - 1.0) / 10.0 + 1e-9)
    assert len(set(zip(burst.tolist(), receivers.tolist(), strict=True))) == len(rows)

    _, sender = np.unique(senders, axis=0, return_inverse=True)
    link, of_link = np.unique(np.column_stack([sender, receivers]), axis=0, return_inverse=True)
    heard, total = np.bincount(of_link), np.bincount(of_link, weights=ratios)

    def figures(instants: np.ndarray) -> list[float]:
        pairs = np.unique(np.column_stack([sender, instants.astype(np.int64)]), axis=0)
        rounds = np.bincount(pairs[:, 0])[link[:, 0]]
        return [np.mean(heard < rounds), np.mean(total / heard), np.mean(total / rounds)]

    assert len(link) == 6219
    assert figures(times) == pytest.approx([0.814, 0.836, 0.634], abs=5e-4)
    assert figures(burst) == pytest.approx([0.143, 0.836, 0.810], abs=5e-4)


def test_the_reader_finds_the_same_bursts_in_any_order_of_rows(tmp_path: Path) -> None:
    with gzip.open(GRENOBLE, "rt") as file:
        header, columns, *rows = [next(file).rstrip("\n") for _ in range(3000)]
    in_order = links(tmp_path, *rows, header=header, columns=columns)
    senders = np.column_stack([in_order.sources, in_order.channels])
    follow = np.concatenate([[0], np.cumsum((np.diff(senders, axis=0) != 0).any(axis=1))])
    pairs = set(zip(follow.tolist(), in_order.rounds.tolist(), strict=True))
    assert len(pairs) == follow[-1] + 1
    random.Random(3).shuffle(rows)
    shuffled = links(tmp_path, *rows, header=header, columns=columns)

    def content(found: LinkRecording) -> list[tuple[float, ...]]:
        return sorted(
            zip(found.channels, found.rounds, found.sources, found.receivers, found.ratios, found.times, strict=True)
        )

    assert content(in_order) == content(shuffled)


def test_a_sender_that_nobody_hears_is_missing_in_its_round(tmp_path: Path) -> None:
    times = {0: 0, 1: 20, 2: 40}
    rows = [
        row(1000 * number + times[source], source, (source + 1) % 3)
        for number in range(4)
        for source in times
        if (number, source) not in ((1, 0), (2, 2))
    ]
    found = links(tmp_path, *rows)
    assert found.rounds.tolist() == [0, 0, 0, 1, 1, 2, 2, 3, 3, 3]
    assert found.sent[11].tolist() == [[True] * 3, [False, True, True], [True, True, False], [True] * 3]
    assert found.complete[11].all()
    assert found.starts[11].tolist() == [0.0, 1020.0, 2000.0, 3000.0]


def test_a_first_and_a_last_round_without_a_sender_of_the_next_are_incomplete(tmp_path: Path) -> None:
    whole = [row(1000 * number + 20 * source, source, 0 if source else 1) for number in range(3) for source in range(3)]
    found = links(tmp_path, *whole[1:-1])
    assert found.complete[11].tolist() == [False, True, False]
    assert links(tmp_path, *whole).complete[11].all()
    assert links(tmp_path, *whole[:2]).complete[11].tolist() == [True]


DATED = HEADER[:-1] + ', "start_date": "2020-01-01T00:00:00.0", "stop_date": "2020-01-01T00:34:00.0"}'
"""From the first row of `three_rounds_of_three` to the last one's burst."""


def three_rounds_of_three() -> list[str]:
    """Both receivers of each burst have a row: the second of them 5 s after the first."""
    return [
        row(1000 * number + 20 * source + 5 * i, source, (source + 1 + i) % 3)
        for number in range(3)
        for source in range(3)
        for i in range(2)
    ]


def test_only_a_burst_that_may_be_cut_by_the_beginning_or_end_of_the_file_is_left_out(
    tmp_path: Path,
) -> None:
    rows = three_rounds_of_three()
    assert links(tmp_path, *rows, header=DATED).complete[11].tolist() == [True, True, True]
    assert links(tmp_path, *rows[1:-1], header=DATED).complete[11].tolist() == [True, True, True]
    late, early, both = (links(tmp_path, *part, header=DATED) for part in (rows[7:], rows[:-7], rows[7:11]))
    for found, number, sent in (
        (late, 0, [False, True, True]),
        (early, 1, [True, True, False]),
        (both, 0, [False, True, False]),
    ):
        assert found.complete[11].all() and found.sent[11][number].tolist() == sent
        assert len(found.left_out(11)) == 3 - sum(sent) and "may be cut" in found.left_out(11)[0]
    assert (len(late.times), len(early.times), len(both.times)) == (10, 10, 2)
    whole = links(tmp_path, *rows[7:-7], header=HEADER)
    assert whole.complete[11].tolist() == [True] and not whole.left_out(11)


def test_a_round_in_which_senders_are_missing_is_said_to_be_left_out(tmp_path: Path) -> None:
    found = links(tmp_path, *three_rounds_of_three()[4:])
    assert found.left_out(11) == ["round 0 of channel 11 was recorded in part, with 1 of 3 senders: left out"]


def test_the_only_round_of_a_channel_at_the_end_of_a_file_is_incomplete_without_a_sender_of_another_channel(
    tmp_path: Path,
) -> None:
    rows = three_rounds_of_three()
    assert links(tmp_path, *rows, row(2060, 0, 1, channel=26)).complete[26].tolist() == [False]
    assert links(tmp_path, row(0, 0, 1, channel=26), *rows[6:]).complete[26].tolist() == [False]
    assert links(tmp_path, *rows[:6], row(60, 0, 1, channel=26), *rows[6:]).complete[26].tolist() == [True]
    all_sent = [row(2060 + 20 * source, source, (source + 1) % 3, channel=26) for source in range(3)]
    assert links(tmp_path, *rows, *all_sent).complete[26].tolist() == [True]


@pytest.mark.thorough
def test_a_shipped_round_that_begins_within_a_burst_lacks_only_this_burst(tmp_path: Path) -> None:
    """The file of the later rows has two of the eight rows of node 0's burst on channel 18 in its first round."""
    with gzip.open(GRENOBLE, "rt") as file:
        header, columns, *rows = file.read().splitlines()
    of_burst = [i for i, cells in enumerate(line.split(",") for line in rows) if cells[1] == "0" and cells[3] == "18"]
    second = next(i for i, j in enumerate(of_burst) if j - of_burst[0] > i)
    last = of_burst[second - 1]
    later = links(tmp_path, *rows[last - 1 :], header=header, columns=columns)
    assert np.flatnonzero(~later.sent[18][0]).tolist() == [0]
    assert [int(complete.sum()) for complete in later.complete.values()] == [9] * 16
    assert later.complete[18].tolist() == [*[True] * 9, False]


@pytest.mark.parametrize("name", ["start_date", "stop_date"])
def test_a_date_of_the_first_line_that_is_no_time_is_refused(name: str, tmp_path: Path) -> None:
    path = written(tmp_path, row(0, 0, 1), header=HEADER[:-1] + f', "{name}": "soon"}}')
    with pytest.raises(RunError, match=f":1: {name} must be a time such as 2018-01-11T16:32:22, is 'soon'$"):
        read_links(path)
    assert links(tmp_path, row(0, 0, 1), header=HEADER[:-1] + f', "{name}": null}}').complete[11].all()


def test_rows_of_one_burst_may_be_as_far_apart_as_it_lasts(tmp_path: Path) -> None:
    found = links(tmp_path, row(0, 0, 1), row(11, 0, 2, 0.01), row(60, 0, 1), row(60, 0, 2))
    assert found.rounds.tolist() == [0, 0, 1, 1]


def test_nodes_may_be_named_by_texts_and_columns_stand_in_any_order(tmp_path: Path) -> None:
    found = links(
        tmp_path, "26,b-2,7,0.25,2020-01-01 00:00:00,-91,x",
        header='{"tx_length": 50, "interframe_duration": 10}', columns="channel,src,dst,pdr,datetime,mean_rssi,more",
    )  # fmt: skip
    assert found.nodes == ("7", "b-2")
    assert (found.sources.tolist(), found.receivers.tolist(), found.packets.tolist()) == ([1], [0], [50])
    assert (found.channels.tolist(), found.ratios.tolist(), found.powers.tolist()) == ([26], [0.25], [-91.0])


def test_a_ratio_of_zero_needs_no_power(tmp_path: Path) -> None:
    found = links(tmp_path, "2020-01-01T00:00:00,0,1,11,,0.0,100", row(0, 0, 2))
    assert np.isnan(found.powers).tolist() == [True, False]


BAD_ROWS = {
    "a ratio above 1": (row(0, 0, 1, 1.01), "pdr must be a number from 0 to 1, is '1.01'"),
    "a ratio that is not a number": (row(0, 0, 1, "nan"), "pdr must be a number from 0 to 1, is 'nan'"),
    "no ratio": (row(0, 0, 1, ""), "pdr must be a number from 0 to 1, is ''"),
    "a channel that the first line lacks": (
        row(0, 0, 1, channel=12), "channel must be one of those of the first line, 11, 26, is '12'",
    ),
    "half a channel": (
        row(0, 0, 1, channel=11.5), "channel must be one of those of the first line, 11, 26, is '11.5'",
    ),
    "a node that hears itself": (row(0, 2, 2), "src and dst must name two nodes, are '2' and '2'"),
    "no receiver": (row(0, 2, ""), "src and dst must name two nodes, are '2' and ''"),
    "a positive power": (
        "2020-01-01T00:00:00,0,1,11,80.5,0.5,100", "mean_rssi must be a number from -150 to 30, is '80.5'",
    ),
    "no time": ("yesterday,0,1,11,-80,0.5,100", "datetime must be a time such as 2018-01-11T16:32:22, is 'yesterday'"),
    "no packets": ("2020-01-01T00:00:00,0,1,11,-80,0.5,0", "tx_count must be a number from 1 to 1e+09, is '0'"),
    "too few columns": ("2020-01-01T00:00:00,0,1", "channel must be one of those of the first line, 11, 26, is ''"),
    "a second row of one burst": (
        row(5, 0, 2, 0.9),
        "a burst has one row for each receiver, but line 3 has what 2 heard of 0 on channel 11 less than 12 s before",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD_ROWS)
def test_a_row_that_cannot_be_used_is_named_with_its_line_or_skipped(name: str, tmp_path: Path) -> None:
    bad, said = BAD_ROWS[name]
    good = [row(0, 0, 2), row(20, 1, 2)]
    path = written(tmp_path, good[0], good[1], "", bad)
    with pytest.raises(RunError) as raised:
        read_links(path)
    assert str(raised.value) == f"{path}: 1 of 3 rows cannot be used:\n  links.k7:6: {said}"
    found = read_links(path, skip_bad_rows=True)
    assert [(each.line, each.reason) for each in found.bad] == [(6, said)]
    assert found.times.tolist() == [0.0, 20.0]


@pytest.mark.parametrize(
    ("header", "columns", "said"),
    [
        ("{", COLUMNS, ":1: the first line must be JSON"),
        ("[1, 2]", COLUMNS, ":1: the first line must be JSON"),
        ('{"tx_length": 100}', COLUMNS, "interframe_duration is missing"),
        ('{"tx_length": 0, "interframe_duration": 100}', COLUMNS, "must be positive, are 0 and 100"),
        ('{"tx_length": 1, "interframe_duration": NaN}', COLUMNS, "must be positive, are 1 and nan"),
        (f'{{"tx_length": 1{"0" * 400}, "interframe_duration": 1}}', COLUMNS, "a burst lasts 1e+09 s at most"),
        ('{"tx_length": 1, "interframe_duration": 1, "channels": 3}', COLUMNS, ":1: the first line must be JSON"),
        (HEADER, COLUMNS.replace(",", ";"), ":2: the header must name the columns src, dst, datetime"),
        (
            HEADER,
            "datetime,src,dst,channel,pdr",
            "for example 'src,dst,datetime,channel,mean_rssi,pdr', is 'datetime,src,dst,channel,pdr'",
        ),
    ],
)
def test_a_file_whose_first_lines_are_wrong_is_refused(header: str, columns: str, said: str, tmp_path: Path) -> None:
    path = written(tmp_path, row(0, 0, 1), header=header, columns=columns)
    with pytest.raises(RunError) as raised:
        read_links(path)
    assert str(raised.value).startswith(path) and said in str(raised.value)


def test_a_file_that_cannot_be_read_is_one_sentence(tmp_path: Path) -> None:
    empty, damaged, no_rows = tmp_path / "empty.k7", tmp_path / "damaged.k7.gz", tmp_path / "no_rows.k7"
    empty.write_text("")
    damaged.write_bytes(GRENOBLE.read_bytes()[:5000])
    no_rows.write_text(f"{HEADER}\n{COLUMNS}\n")
    for path in (empty, damaged, no_rows, tmp_path / "missing.k7", tmp_path, tmp_path / "a\0b"):
        with pytest.raises(RunError) as raised:
            read_links(str(path))
        assert str(raised.value).startswith(printable(f"{path}")) and "\n" not in str(raised.value)
    with pytest.raises(RunError, match="contains no row that can be used"):
        read_links(written(tmp_path, row(0, 0, 0)), skip_bad_rows=True)


def test_a_file_is_read_again_only_when_it_has_changed(tmp_path: Path) -> None:
    path = written(tmp_path, row(0, 0, 1))
    assert read_links(path) is read_links(path)
    before = read_links(path)
    written(tmp_path, row(0, 0, 1), row(0, 0, 2))
    assert read_links(path).times.size == before.times.size + 1


def test_the_first_line_of_the_shipped_file_says_how_long_a_burst_lasts() -> None:
    with gzip.open(GRENOBLE, "rt") as file:
        said = json.loads(next(file))
    assert said["tx_length"] * said["interframe_duration"] == 10_000
