"""The README's five results and openings of pages: sentences whose figures come from the tables and rows in docs/."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from operator import itemgetter
from pathlib import Path
from textwrap import fill
from typing import Any

import pandas as pd

from wsnsim.papers.counts import KINDS
from wsnsim.papers.table import OUT_OF_REACH

DOCS = Path(__file__).parents[1] / "docs"
COUNTED = DOCS / "papers/counted.txt"
PAPERS = ("jiang2013", "liu2012", "wei2022", "ruan2020", "li2012")
OUTCOMES = ("reproduced", "contradicted", "undecided", "dependent")
"""The first words of the outcomes of claims."""
WORDS = {"dependent": "dependent on the reading"}
OUTCOME = re.compile(rf"(\d+) ({'|'.join(OUTCOMES)})[a-z ]*(?:\((\d+) out of reach)?")
SLEEPING = "[radios that sleep](docs/duty_cycles.md)"
COUNT_LINE = r"^- {}: (\d+ (?:printed|in words|derived).*); (\d+) readings? counted at most$"


def results() -> str:
    """A Markdown list of the results."""
    found = (reproduction(), fairness(), listening(rows("duty_cycles")["li"]), information(), recordings())
    return "\n".join(
        fill(each, 118, initial_indent="- ", subsequent_indent="  ", break_on_hyphens=False) for each in found
    )


def counted_lines() -> str:
    """A line for each paper: how many of its claims have each outcome, as `wsnsim reproduce` says."""
    return COUNTED.read_text(encoding="utf-8")


def rows(name: str) -> Any:
    """The rows behind a page of docs."""
    return json.loads((DOCS / f"{name}.json").read_text(encoding="utf-8"))


def counted(name: str) -> dict[str, Counter[str]]:
    """The claims of a paper by kind and outcome; without any where all its claims are reconstructions.

    'never undecided' are those of them that are out of reach.
    """
    found = re.search(COUNT_LINE.format(name), counted_lines(), re.MULTILINE)
    counts: dict[str, Counter[str]] = {kind: Counter() for kind in KINDS}
    for part in found[1].split("; ") if found else ():
        kind = next(kind for kind in KINDS if f" {kind.removesuffix('s')}" in part)
        for number, word, never in OUTCOME.findall(part):
            counts[kind] += Counter({word: int(number), f"never {word}": int(never or 0)})
    return counts


def readings(name: str) -> int:
    """The most readings of the paper that count for a claim."""
    found = re.search(COUNT_LINE.format(name), counted_lines(), re.MULTILINE)
    return int(found[2]) if found else 1


def total(outcomes: Counter[str]) -> int:
    """The number of claims, each of which has one outcome."""
    return sum(outcomes[word] for word in OUTCOMES)


def opening(name: str) -> str:
    """How many of a paper's printed numbers, and of what it states in words, have each outcome."""
    numbers, words, _ = (counted(name)[kind] for kind in KINDS)
    named = {"printed numbers": numbers, "statements in words": words}
    parts = [f"of {total(found)} {what}, {_outcomes(found)}" for what, found in named.items() if total(found)]
    said = f"**Outcome:** {'; '.join(parts) or 'nothing is counted'}."
    said += " Claims on what we had to choose or rebuild are not counted. [The rule](../verdicts.md#what-is-counted)."
    return fill(said, 140, break_on_hyphens=False)


def _outcomes(found: Counter[str], reach: bool = True) -> str:
    """The outcomes of claims in words; with `reach`, how many of each no number of our runs could have reproduced."""
    never = {
        word: f" ({found[f'never {word}']} {OUT_OF_REACH})" for word in OUTCOMES if reach and found[f"never {word}"]
    }
    return ", ".join(
        f"{found[word]} {WORDS.get(word, word)}{never.get(word, '')}" for word in filter(found.get, OUTCOMES)
    )


def outcome_table() -> str:
    """A row per paper: its printed numbers and what it states in words, by outcome."""
    heads = ["paper", "printed numbers", "reproduced", "contradicted (out of reach)",
             "undecided (out of reach)",
             "dependent on the reading", "in words", "reproduced", "contradicted", "undecided",
             "dependent on the reading", "readings counted"]  # fmt: skip
    rows = [heads, ["---"] * len(heads)]
    for name in PAPERS:
        numbers, words, _ = (counted(name)[kind] for kind in KINDS)
        both = [f"{numbers[word]} ({numbers[f'never {word}']})" for word in ("contradicted", "undecided")]
        values = [total(numbers), numbers["reproduced"], *both, numbers["dependent"], total(words),
                  *(words[word] for word in OUTCOMES), readings(name)]  # fmt: skip
        rows.append([f"[{_titled(name)}]({name}.md)", *map(str, values)])
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def _titled(name: str) -> str:
    """A paper as it is cited."""
    return f"{name[:-4].capitalize()} {name[-4:]}"


def rows_of(name: str) -> Path:
    """The file with all rows of a paper."""
    return DOCS / f"papers/{name}.csv"


def measured(name: str, quantity: str) -> dict[str, float]:
    """{variant: the first measured value} of a quantity in a paper's rows."""
    table = pd.read_csv(rows_of(name))
    these = table[table["quantity"].str.partition(" (")[0] == quantity].drop_duplicates("variant")
    return dict(zip(these["variant"], these["measured"], strict=True))


def reproduction() -> str:
    """How many printed numbers, and statements in words, of all papers come out."""
    numbers, words = (sum((counted(name)[kind] for name in PAPERS), Counter()) for kind in KINDS[:2])
    return (
        f"**Published figures rarely come out.** Of the {total(numbers)} printed numbers of {len(PAPERS)} papers that "
        f'can be judged, {_in_words(numbers)}. Of {total(words)} statements such as "A is more accurate than B", '
        f"{_in_words(words)}: [paper by paper](docs/papers/index.md)."
    )


def _in_words(found: Counter[str]) -> str:
    """How many claims have each outcome; outcomes of none but 'reproduced' are left out."""
    said = {**dict.fromkeys(OUTCOMES), "dependent": "dependent on how the paper is read"}
    parts = [f"{found[word] or 'none'} {'are' if found[word] > 1 else 'is'} {said[word] or word}"
             for word in OUTCOMES if found[word] or word == OUTCOMES[0]]  # fmt: skip
    return ", ".join(parts)


def fairness() -> str:
    """Jiang's comparison as printed, and with a process noise that suits the rival."""
    rmse = measured("jiang2013", "RMSE, m")
    return (
        f"**Settings decide more than methods.** As printed in [Jiang 2013](docs/papers/jiang2013.md), the filter "
        f"PSO-MHPF has an RMSE of {rmse['pso_mhpf']:.2f} m, its rivals PPF and IPF {rmse['ppf']:.1f} m and "
        f"{rmse['ipf']:.1f} m. If it assumes a hundred times the process noise, PPF has "
        f"{rmse['ppf, noise x100']:.2f} m."
    )


def listening(li: Mapping[str, Any]) -> str:
    """What Li's field pays and gets on CSMA and at the best intervals: energy, latency, deliveries and error."""
    found, points = li["rows"], li["best_points"]
    spent = _range([found[name]["energy, J"][0] for name in dict.fromkeys(one["csma"] for one in points)], ".0f")
    pairs = [(found[one["point"]], found[one["csma"]]) for one in points if one["point"]]
    unusable = len(points) - len(pairs)
    none = f"; {unusable} of {len(points)} pairs of tracker and MAC have no usable interval" if unusable else ""
    said = (
        f"**Listening costs more than tracking.** On radios that always listen, trackers of one field spend {spent} J; "
    )
    if not pairs:
        return f"{said}no interval of X-MAC, ContikiMAC and TSCH is usable there: {SLEEPING}."
    later = [one["latency at the head, s"][0] - other["latency at the head, s"][0] for one, other in pairs]
    fewer = [100.0 * (other["delivered"][0] - one["delivered"][0]) for one, other in pairs]
    errors = [one["RMSE of a run, m"][0] / other["RMSE of a run, m"][0] for one, other in pairs]
    return (
        f"{said}on X-MAC, ContikiMAC and TSCH at their best intervals "
        f"{_range([one['energy, J'][0] for one, _ in pairs], '.0f')} J. There, estimates come {_range(later, '.1f')} s "
        f"later, {_range(fewer, '.0f')} percentage points fewer reports arrive, and the median RMSE is "
        f"{_range(errors, '.2f')} times as large{none}: {SLEEPING}."
    )


def _range(values: Sequence[float], form: str) -> str:
    """The least and the largest value in words."""
    return f"{min(values):{form}} to {max(values):{form}}"


def at_the_bound() -> dict[str, Any]:
    """The row of most runs of `information_driven` on the ideal radio."""
    return max(rows("frontier")["at_the_bound"]["rows"].values(), key=itemgetter("runs"))


def frontier_opening() -> str:
    """The accuracy and energy of `information_driven` on the ideal radio, and shares in time on the real one."""
    ours, real = at_the_bound(), rows("frontier").get("real_radio", {"rows": {}})["rows"]
    shares = {
        name: sorted(row["in_time"][0] for key, row in real.items() if key.startswith(f"kept: {name},"))
        for name in dict.fromkeys(key.partition(": ")[2].partition(",")[0] for key in real)
    }
    said = ", ".join(f"`{name}` {each[0]:.1%} to {each[-1]:.1%}" for name, each in shares.items())
    return fill(
        f"On the ideal radio `information_driven` has a median RMSE of {_of(ours['rmse'])} m, {_of(ours['medians'])} "
        f"times the median bound (pooled over runs and steps: {_of(ours['pooled'])}), for {_of(ours['energy'])} J. "
        f"Of {ours['runs']} runs, {ours['lost']} lost the target. On the CC2420 with kept slots, estimates in time "
        f"on three seeds: {said}.", 140, break_on_hyphens=False,
    )  # fmt: skip


def _of(found: Sequence[float]) -> str:
    """A value with its interval."""
    return "{:.2f} [{:.2f}, {:.2f}]".format(*found)


def information() -> str:
    """The accuracy and energy of `information_driven` on the ideal radio, beside the cheapest rivals near it."""
    ours = at_the_bound()
    strategies = {row["variant"]: row for row in rows("frontier")["frontier"]["strategies"]}
    others = [
        row for name, row in strategies.items()
        if name.startswith("ideal: ") and "information_driven" not in name and row["in_time"] >= 0.9
        and row["rmse"] <= 1.5 * ours["rmse"][0]
    ]  # fmt: skip
    cheapest = (
        min((row for row in others if round(row["lost"] * row["runs"]) <= most), key=itemgetter("energy"))
        for most in (0, 1)
    )
    near = [_rival(row) for row in {row["variant"]: row for row in cheapest}.values()]
    return (
        f"**Ask only for readings that are worth their energy.** The tracker `information_driven` does: on an ideal "
        f"radio its error is {ours['rmse'][0]:.2f} m, {_of(ours['medians'])} times the bound, for "
        f"{ours['energy'][0]:.2f} J. {'Two rivals come' if len(near) > 1 else 'One rival comes'} near: "
        f"{'; '.join(near)}: [error against energy](docs/frontier.md)."
    )


def _rival(row: Any) -> str:
    """A strategy with its error, its energy and the runs in which it lost its target."""
    lost = round(row["lost"] * row["runs"])
    but = f", but lost its target in {lost} of {row['runs']} runs" if lost else ""
    return f"`{row['variant'].removeprefix('ideal: ')}` has {row['rmse']:.2f} m for {row['energy']:.2f} J{but}"


def recordings() -> str:
    """The particle filter on recorded readings beside simulated ones."""
    answers = rows("reality")["answers"]
    ratio, gap = answers[0]["found"][0], answers[1]["found"][0]
    return (
        f"**Simulated readings flatter.** On a recorded Bluetooth track the error of a particle filter is "
        f"{ratio[0]:.1f} [{ratio[1]:.1f}, {ratio[2]:.1f}] times that on the same track with simulated readings. A "
        f"filter that knows the gains of the receivers closes {100 * gap[0]:.0f} % of the gap: "
        "[recorded readings](docs/reality.md)."
    )
