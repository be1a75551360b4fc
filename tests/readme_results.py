"""The README's five results, as sentences whose figures come from the tables and rows behind the pages in docs/."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterator
from operator import itemgetter
from pathlib import Path
from textwrap import fill
from typing import Any, NamedTuple

DOCS = Path(__file__).parents[1] / "docs"
PAPERS = ("jiang2013", "liu2012", "wei2022", "ruan2020", "li2012")
BEST_LINE = re.compile(r"(\w+) on (\w+): best interval ([\d.]+) s")


def results() -> str:
    """A Markdown list of the results."""
    found = (reproduction(), fairness(), listening(), information(), recordings())
    return "\n".join(
        fill(each, 118, initial_indent="- ", subsequent_indent="  ", break_on_hyphens=False) for each in found
    )


def page(name: str) -> str:
    """The text of a page of docs/papers."""
    return (DOCS / "papers" / f"{name}.md").read_text(encoding="utf-8")


def rows(name: str) -> Any:
    """The rows behind a page of docs."""
    return json.loads((DOCS / f"{name}.json").read_text(encoding="utf-8"))


def counted(name: str) -> Counter[str]:
    """The verdicts on the claims of a paper that are counted; none where all its claims are reconstructions."""
    found = re.search(rf"^- {name}: \d+ claims: (.*)$", page(name), re.MULTILINE)
    parts = (part.split(" x ") for part in found[1].split(", ")) if found else ()
    return Counter({verdict: int(number) for number, verdict in parts})


class ShownRow(NamedTuple):
    """A row of a paper's page: its experiment and quantity, and its cells by heading."""

    experiment: str
    quantity: str
    cells: dict[str, str]


def shown_rows(name: str) -> Iterator[ShownRow]:
    """Yield the rows of a paper's tables."""
    experiment, quantity, heads = "", "", []
    _, _, block = page(name).partition(f"<!-- {name}: made by make readme -->")
    for line in block.replace("\\", "").splitlines():
        if found := re.match(rf"### {name}, (\S+)$", line):
            experiment = found[1]
        elif found := re.match(r"\*\*(.+)\*\*$", line):
            quantity, heads = found[1], []
        elif line.startswith("| ") and not line.startswith("| ---"):
            cells = line.strip("| ").split(" | ")
            if heads:
                yield ShownRow(experiment, quantity, dict(zip(heads, cells, strict=True)))
            heads = heads or cells


def measured(name: str, quantity: str) -> dict[str, float]:
    """{variant: the first measured value} of a quantity in a paper's tables."""
    found: dict[str, float] = {}
    for row in shown_rows(name):
        if row.quantity.partition(" (")[0] == quantity:
            found.setdefault(row.cells["variant"], float(row.cells["measured [95 %]"].split(" ")[0]))
    return found


def best_of(line: str) -> tuple[str, str, str]:
    """Tracker, MAC and interval of a line on a best interval."""
    tracker, mac, interval = BEST_LINE.match(line).groups()
    return tracker, mac, interval


def reproduction() -> str:
    """How many claims of the papers reproduce."""
    total = sum((counted(name) for name in PAPERS), Counter())
    return (
        f"**Published figures rarely come out.** Of {total.total()} claims of five papers (those on methods that we "
        f"had to reconstruct are not counted) {total['reproduces']} reproduce, {total['compatible']} are compatible, "
        f"{total['within a factor of two']} are within a factor of two, {total['does not reproduce']} do not "
        f"reproduce, and {total['undecided']} are undecided: [the papers](docs/papers/index.md)."
    )


def fairness() -> str:
    """Jiang's comparison as printed, and with a process noise that suits the rival."""
    rmse = measured("jiang2013", "RMSE, m")
    return (
        f"**Settings decide more than methods.** As printed, PSO-MHPF has the lowest RMSE of Jiang's filters: "
        f"{rmse['pso_mhpf']:.2f} m, PPF {rmse['ppf']:.1f} m, IPF {rmse['ipf']:.1f} m. With a hundred times the process "
        f"noise in the filter PPF has {rmse['ppf, noise x100']:.2f} m: [Jiang 2013](docs/papers/jiang2013.md)."
    )


def listening() -> str:
    """Energies of Li's field on CSMA and at the best intervals of the duty-cycled MACs, and the latency added."""
    li = rows("duty_cycles")["li"]
    csma = {name.partition(",")[0]: row for name, row in li["rows"].items() if name.endswith(", csma")}
    best = {tracker + mac: li["rows"][f"{tracker}, {mac} {float(interval) * (100 if mac == 'tsch' else 1000):g}"]
            for tracker, mac, interval in map(best_of, li["best"])}  # fmt: skip
    spent = [[row["energy, J"][0] for row in some.values()] for some in (csma, best)]
    later = [row["latency at the head, s"][0] - csma[tracker]["latency at the head, s"][0]
             for key, row in best.items() for tracker in csma if key.startswith(tracker)]  # fmt: skip
    return (
        f"**Listening costs more than tracking.** On radios that always listen, four trackers of one field spend "
        f"{min(spent[0]):.0f} to {max(spent[0]):.0f} J; on X-MAC, ContikiMAC and TSCH at their best intervals "
        f"{min(spent[1]):.0f} to {max(spent[1]):.0f} J, and estimates come {min(later):.1f} to {max(later):.1f} s "
        "later: [radios that sleep](docs/duty_cycles.md)."
    )


def information() -> str:
    """The accuracy and energy of `information_driven` on the ideal radio, beside the cheapest of the others."""
    part = rows("frontier")["frontier"]
    strategies = {row["variant"]: row for row in part["strategies"]}
    ours = strategies["ideal: information_driven"]
    others = [
        row for name, row in strategies.items()
        if name.startswith("ideal: ") and "information_driven" not in name and row["in_time"] >= 0.9
        and row["rmse"] <= 1.5 * ours["rmse"]
    ]  # fmt: skip
    none, one = (min((row for row in others if round(row["lost"] * row["runs"]) <= most), key=itemgetter("energy"))
                 for most in (0, 1))  # fmt: skip
    return (
        f"**Ask only for readings that are worth their energy.** On an ideal radio, `information_driven` has an error "
        f"of {ours['rmse']:.2f} m, {ours['rmse'] / part['bound']:.2f} times the bound, for {ours['energy']:.2f} J. "
        f"Of the other strategies within 1.5 times that error, the cheapest that lost none of {ours['runs']} runs "
        f"({_named(none)}) needs {none['energy']:.2f} J, the cheapest that lost at most one ({_named(one)}) "
        f"{one['energy']:.2f} J: [error against energy](docs/frontier.md)."
    )


def _named(row: Any) -> str:
    """A strategy and its error."""
    return f"`{row['variant'].removeprefix('ideal: ')}`, {row['rmse']:.2f} m"


def recordings() -> str:
    """The particle filter on recorded readings beside simulated ones."""
    answers = rows("reality")["answers"]
    ratio, gap = answers[0]["found"][0], answers[1]["found"][0]
    return (
        f"**Simulated readings flatter.** On a recorded Bluetooth track a particle filter errs {ratio[0]:.1f} "
        f"[{ratio[1]:.1f}, {ratio[2]:.1f}] times as much as on the same track with simulated readings; known gains of "
        f"the receivers recover {100 * gap[0]:.0f} % of the gap: [recorded readings](docs/reality.md)."
    )
