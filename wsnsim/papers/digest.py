"""The main rows of the reproductions as a table of Markdown, as the README shows it.

markdown(rows, lines) -> str
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

from wsnsim.papers.reproduction import Row
from wsnsim.papers.table import HEADS, cells, legend


class Main(NamedTuple):
    """Rows to show of an experiment: those of a quantity, of the variants named or of all."""

    paper: str
    experiment: str
    quantity: str
    variants: tuple[str, ...] = ()

    def has(self, row: Row) -> bool:
        """Whether a row is one of these."""
        mine = (row.paper, row.experiment, row.quantity) == (self.paper, self.experiment, self.quantity)
        return mine and (not self.variants or row.variant in self.variants)


REPAIRED: Final = ("pso_mhpf, all readings", "ppf, noise x100", "ekf", "central_pf, noise x100")
SEARCHES: Final = ("cs_pf, 100, resample first", "cs_pf, 100, metropolis", "ics_pf, 100, metropolis")
MAIN: Final = (
    Main("jiang2013", "figures_4_to_9", "RMSE, m (figure 9)"),
    Main("jiang2013", "figures_4_to_9", "RMSE, m", REPAIRED),
    Main("jiang2013", "figures_4_to_9", "RMSE of a run, median, m", ("pso_mhpf", "ipf", "ppf", *REPAIRED)),
    Main("jiang2013", "figures_4_to_9", "RMSE of a run below that of ppf (figure 9)", ("pso_mhpf",)),
    Main("jiang2013", "figures_4_to_9", "RMSE of a run below that of ppf, noise x100 (figure 9, fair)"),
    Main("jiang2013", "figures_4_to_9", "network energy, J (figure 8)"),
    Main("jiang2013", "figures_4_to_9", "network energy, J", REPAIRED),
    Main("jiang2013", "figures_4_to_9", "clusters (figure 6)"),
    Main("jiang2013", "figures_4_to_9", "least step energy of a cluster, J (figure 6)"),
    Main("jiang2013", "figures_4_to_9", "largest step energy of a cluster, J (figure 6)"),
    Main("jiang2013", "figure_3", "RMSE over that of 1600 particles ('almost a decade', figure 3)"),
    Main("liu2012", "figures_1_to_4", "position RMSE of a run below that of rkf (figure 1)"),
    Main("liu2012", "figures_1_to_4", "velocity RMSE of a run over that of RKF, median (about equal, figure 2)"),
    Main("liu2012", "figures_1_to_4", "position RMSE of a run, median, m (figure 1)"),
    Main("liu2012", "figures_1_to_4", "operations over those of RKF (table 1)"),
    *(Main("wei2022", "table_1", f"RMSE of x, N = {count} (table 1)") for count in (30, 100)),
    Main("wei2022", "table_1", "RMSE of x (repaired)", SEARCHES),
    Main("wei2022", "table_1", "RMSE of x (reference)"),
    Main("wei2022", "table_2", "RMSE of px (table 2)"),
    Main("wei2022", "table_2", "RMSE of px (reference)", ("ekf",)),
    Main("wei2022", "table_2_start_drawn", "RMSE of px (table 2)"),
    Main("wei2022", "four_anchors", "RMSE of px (reference)", ("pf", "ics_pf", "ekf")),
    Main("ruan2020", "table_1", "RMSE, m (table 1)"),
    Main("ruan2020", "table_1", "RMSE, m (reference)", (
        *(f"gsa_gpf, {count}, greedy" for count in (50, 100, 200)), "pf, 5000", "ekf", "trilateration")),
    Main("li2012", "every_10_s", "share of steps tracked by one reading or more (figure 3)",
         ("gmtt, 400", "tsstp, 400", "cluster, 400")),
    *(Main("li2012", "every_10_s", f"share of steps tracked by {readings} or more below that of gmtt, 200 (figure 3)",
           ("tsstp, 200",))
      for readings in ("one reading", "three readings")),
    *(main
      for experiment in ("every_10_s", "figures_3_6")
      for main in (
          Main("li2012", experiment, "mean error of steps 1 to 20, m (figure 4)", ("cluster, 300", "tsstp, 300")),
          Main("li2012", experiment, "mean error of steps 6 to 20, m (figure 4)", ("gmtt, 300", "gmtt, repaired, 300")),
          Main("li2012", experiment, "nodes told in vain in 20 steps below that of tsstp, 300 (figure 6)",
               ("gmtt, 300", "cluster, 300")))),
    *(Main("li2012", "every_10_s", f"{end} delay at the main node of the first 20, s (figure 5)",
           ("tsstp, 300", "gmtt, 300", "cluster, 300"))
      for end in ("least", "greatest")),
)  # fmt: skip
"""In the order in which they stand [our choice]."""


def markdown(rows: Sequence[Row], lines: Sequence[str] = ()) -> str:
    """A table: a line a main row, the experiment before what the terminal shows of it; beneath, marks and `lines`."""
    chosen = [row for main in MAIN for row in rows if main.has(row)]
    if not chosen and not lines:
        return "No main row is among what was asked for."
    head = [("paper, experiment", *HEADS, "why"), ("---",) * (2 + len(HEADS))] if chosen else []
    table = [*head, *((f"{row.paper}, {row.experiment}", *cells(row), row.reason) for row in chosen)]
    said = ["| " + " | ".join(map(_plain, line)) + " |" for line in table]
    return "\n".join([*said, *_beneath(chosen), *(f"- {line}" for line in lines)])


def _beneath(chosen: Sequence[Row]) -> Iterator[str]:
    """What verdicts and marks among the rows mean."""
    if chosen:
        yield from ("", "Verdicts and bounds:")
        yield from (f"- {_plain(line.strip())}" for line in legend(chosen))
        cautions: dict[str, dict[str, None]] = {}
        for row in chosen:
            for caution in filter(None, row.caution.split("; ")):
                cautions.setdefault(caution, {})[f"{row.paper}, {row.experiment}"] = None
        yield from (f"- of the bound ({_plain('; '.join(where))}): {caution}" for caution, where in cautions.items())


def _plain(cell: str) -> str:
    """A cell that Markdown does not take for anything else."""
    return cell.replace("|", "\\|").replace("~", "\\~").replace("_", "\\_").replace("*", "\\*")
