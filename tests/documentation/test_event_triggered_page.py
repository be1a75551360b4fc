"""docs/how-to/event_triggered.md shows the rows of its CSV file, and says of them what they say."""

from __future__ import annotations

from tests.bench.page import spliced
from tests.papers import trigger_curve as curve

TEXT = curve.PAGE.read_text(encoding="utf-8")
ROWS = curve.read()


def point(**chosen):
    """The row with these values."""
    rows = ROWS
    for name, value in chosen.items():
        rows = rows[rows[name] == value]
    (row,) = rows.to_dict("records")
    return row


def test_the_page_is_made_from_its_rows():
    assert spliced(TEXT, "curve", curve.table(ROWS)) == TEXT, "python -m tests.papers.trigger_curve writes it"


def test_what_the_page_says_of_its_rows_holds():
    for value in ("0.5", "1.0", "2.0"):
        used, ignored = (
            point(loss=0.0, trigger="event", value=value, silence=each, shared_every="") for each in ("used", "ignored")
        )
        assert used["rmse_m"] < ignored["rmse_m"] and used["sent_a_run"] < ignored["sent_a_run"]
    trusted, aware = (point(loss=0.2, trigger="event", p=p) for p in ("", "0.2"))
    assert trusted["rmse_m"] == ROWS[ROWS["loss"] == 0.2]["rmse_m"].max()
    assert trusted["nees_median"] > 2.0 * aware["nees_median"]
    energy = {every: point(loss=0.0, trigger="event", value="0.5", silence="used", shared_every=every)
              ["energy_mj_a_run"] for every in ("", "4", "10")}  # fmt: skip
    always = point(loss=0.0, trigger="always")["energy_mj_a_run"]
    assert energy["10"] < energy["4"] < energy[""] and energy[""] > 2.0 * always
    diffusion = [point(trigger="diffusion", value=value)["energy_mj_a_run"] for value in ("0.0", "0.25", "0.5", "1.0")]
    assert diffusion == sorted(diffusion, reverse=True)
