"""The curve of docs/how-to/event_triggered.md: readings that are not sent, against the error that this costs.

python -m tests.papers.trigger_curve --new    make the runs, write docs/how-to/event_triggered.csv, then the page
python -m tests.papers.trigger_curve          write the page from the file
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import wsnsim
from tests.bench.page import write_blocks

PAGE = Path(__file__).parents[2] / "docs/how-to/event_triggered.md"
ROWS = PAGE.with_suffix(".csv")
RUNS = 40
LOSSY = {"kind": "disk", "reach": "200 m", "loss": 0.2}
WITHOUT = [{"kind": "always"}, *({"kind": "periodic", "every": every} for every in (2, 4, 8)),
           *({"kind": "random", "probability": chance} for chance in (0.5, 0.25, 0.125))]  # fmt: skip
EVENTS = [{"kind": "event", "threshold": each} for each in (0.25, 0.5, 1.0, 2.0, 4.0)]
DRAWN = [{"kind": "stochastic", "width": each} for each in (0.5, 1.0, 2.0, 4.0)]
IGNORED = [{**each, "silence": "ignored"} for each in (*EVENTS[1:4], DRAWN[2])]
SELDOM = [{**EVENTS[1], "shared_every": every} for every in (4, 10)]
TRUSTED = [{**EVENTS[2], "shared_every": 10}, {**EVENTS[2], "shared_every": 10, "loss": 0.2}]
"""Where frames are lost: silence taken as information, and with the loss as it is."""


DIFFUSION = [{"kind": "diffusion", "threshold": each} for each in (0.0, 0.25, 0.5, 1.0, 2.0)]
HEADLESS = {"clusters": {"kind": "none"}, "link": {"kind": "disk", "reach": "40 m"}}


SHOWN = [("periodic", "4"), ("random", "0.25"), ("event", "0.5"), ("event", "1.0"), ("event", "2.0"),
         ("stochastic", "1.0"), ("stochastic", "2.0"), ("diffusion", "0.5"), ("diffusion", "1.0")]  # fmt: skip
"""What the page shows; the file has all."""


def measured(trigger: dict[str, Any], loss: bool) -> dict[str, Any]:
    """The figures of one trigger, or of diffusion without a head, over the runs of the scenario."""
    tracker, changes = {"kind": "ekf", "trigger": trigger}, {"link": LOSSY} if loss else {}
    if trigger["kind"] == "diffusion":
        tracker, changes = trigger, HEADLESS
    result = wsnsim.run("event_triggered", tracker=tracker, replicates=RUNS, progress=False, **changes)
    events, estimates = result.table("events"), result.table("estimates")
    sent = events[(events["kind"] == "send") & events["what"].isin(["reading", "information", "estimate"])]
    return {
        "loss": LOSSY["loss"] if loss else 0.0, "trigger": trigger["kind"],
        "value": next((trigger[key] for key in ("threshold", "width", "every", "probability") if key in trigger), ""),
        "silence": trigger.get("silence", "used") if trigger["kind"] in ("event", "stochastic") else "",
        "shared_every": trigger.get("shared_every", ""), "p": trigger.get("loss", ""),
        "sent_a_run": len(sent) / RUNS,
        "rmse_m": float(np.sqrt((estimates["error"] ** 2).mean())),
        "nees_median": float(estimates["nees"].median()),
        "energy_mj_a_run": float(result.table("runs")["energy"].mean() * 1e3),
    }  # fmt: skip


def table(rows: pd.DataFrame) -> str:
    """The rows of the page: what is saved of the readings, and the error, both over those of sending always."""
    lines = ["| loss | trigger | not sent | error | energy | NEES |", "| --- | --- | --- | --- | --- | --- |"]
    always = rows[rows["trigger"] == "always"].set_index("loss")
    headless = rows[(rows["trigger"] == "diffusion") & (rows["value"] == "0.0")].iloc[0]
    chosen = pd.MultiIndex.from_frame(rows[["trigger", "value"]]).isin(SHOWN) & rows["shared_every"].ne("4")
    shown = rows[chosen & ~(rows["silence"].eq("ignored") & rows["value"].ne("1.0"))]
    for row in shown.to_dict("records"):
        base = headless if row["trigger"] == "diffusion" else always.loc[row["loss"]]
        words = [row["trigger"], row["value"], *(["silence ignored"] if row["silence"] == "ignored" else [])]
        words += [f"shared every {row['shared_every']}"] if row["shared_every"] else []
        words += [f"p = {row['p'] or 0}"] if row["loss"] and row["silence"] else []
        saved = 1.0 - row["sent_a_run"] / base["sent_a_run"]
        lines.append(
            f"| {row['loss']:.0%} | {' '.join(words)} | {saved:.0%}"
            f" | × {row['rmse_m'] / base['rmse_m']:.2f} | × {row['energy_mj_a_run'] / base['energy_mj_a_run']:.2f}"
            f" | {row['nees_median']:.2f} |".replace("nan", "")
        )
    return "\n".join(lines)


def read() -> pd.DataFrame:
    """The rows of the file; words and settings as texts."""
    texts = dict.fromkeys(("trigger", "value", "silence", "shared_every", "p"), str)
    rows = pd.read_csv(ROWS, dtype=texts, keep_default_na=False)
    return rows.assign(nees_median=pd.to_numeric(rows["nees_median"]))


def main() -> None:
    """Write the file if asked to, then the table of the page."""
    if "--new" in sys.argv[1:]:
        points = [(trigger, False) for trigger in (*WITHOUT, *EVENTS, *SELDOM, *DRAWN, *IGNORED)]
        points += [(trigger, True) for trigger in (WITHOUT[0], WITHOUT[2], *TRUSTED)]
        points += [(trigger, False) for trigger in DIFFUSION]
        pd.DataFrame([measured(*point) for point in points]).to_csv(ROWS, index=False, float_format="%.6g")
    write_blocks(PAGE, {"curve": table(read())})


if __name__ == "__main__":
    main()
