"""docs/performance.md and .csv hold what docs/performance.json says. Timings themselves are never tested."""

from __future__ import annotations

import json

import pytest

from tests.bench import page


def row(name: str, value: float, bound: float | None = None, at_least: float | None = None, within=None, group="lossy"):
    return {"group": group, "name": name, "value": value, "unit": "s", "bound": bound, "at_least": at_least,
            "within": within, "note": "a note", "before": None}  # fmt: skip


def test_the_page_is_made_from_its_rows() -> None:
    document, text = json.loads(page.ROWS.read_text()), page.PAGE.read_text()
    for name, block in page.blocks(document).items():
        assert page.spliced(text, name, block) == text, "python -m tests.bench.page writes it anew"
    assert page.TABLE.read_text() == page.table(document["rows"])
    assert {row["name"] for row in document["rows"]} >= set(page.SHOWN)


def test_rows_are_matched_with_those_of_an_older_tree_by_name() -> None:
    first, second = page.merged([row("a", 1.0), row("b", 2.0)], [row("b", 4.0), row("gone", 5.0)])
    assert (first["before"], second["before"]) == (None, 4.0)


def test_a_missed_bound_is_said() -> None:
    rows = [row("slow", 3.0, bound=2.0, within=False), row("fast", 1.0, bound=2.0, within=True), row("free", 9.0)]
    first, *_, last = page.bounded(rows).splitlines()
    assert first == "Of 2 bounds, 1 are kept. These are missed:"
    assert last == "| slow, s | - | 3 | ≤ 2 |"


@pytest.mark.parametrize(
    ("value", "text"), [(None, "-"), (0.123456, "0.123"), (12.34, "12.3"), (383_210.4, "383,210"), (31.6, "31.6")]
)
def test_a_number_has_three_digits_or_commas(value, text) -> None:
    assert page.number(value) == text


def test_the_figure_has_a_point_a_radio_and_size(tmp_path) -> None:
    names = [
        f"beacons, {radio}, N={size}: CPU a reception in range, timeouts"
        for radio in ("a disk", "log-normal")
        for size in (400, 100)
    ]
    rows = [row(name, 2.0 + i) | {"before": 5.0} for i, name in enumerate(names)]
    assert page.curves(rows) == {"a disk": [(100, 3.0), (400, 2.0)], "log-normal": [(100, 5.0), (400, 4.0)]}
    page.draw(rows, tmp_path / "x.png")
    assert (tmp_path / "x.png").read_bytes().startswith(b"\x89PNG")


def test_a_page_without_the_block_is_refused() -> None:
    with pytest.raises(ValueError, match="0 blocks called bounds"):
        page.spliced("nothing", "bounds", "x")
