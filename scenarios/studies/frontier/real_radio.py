"""The frontier on the real radio: who tracks on a CC2420 whose idle slots are kept, and at which margin of members.

    variants(study, _) -> {"variants": ...}         every strategy on every seed, each at its chosen margin
    margins(study, _) -> {"variants": ...}          every strategy at every margin, on a seed of its own
    answers(data) -> [Answer, ...]                  18 to 21
    choices(data) -> [line, ...]                    the margins that the rule of `settings` chooses

'kept: ukf, margin 0 m, seed 1' is a variant. Thresholds stand in study.yaml (`registered`), strategies and margins in
`published`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import compress
from typing import Any, Final, NamedTuple

import numpy as np
import scipy.special

from wsnsim.papers.toolkit import Answer, Data, Interval, Study, both, campaigns, interval, word

from .bound import of_medians, resampled, squares
from .settings import chosen
from .strategies import DIVERGED, OURS, Strategy, front, strategies

TAIL: Final = 0.025


class OnASeed(NamedTuple):
    """A strategy on one seed: share of steps in time, (runs lost, runs), error over the bound, and its totals."""

    in_time: Interval
    lost: tuple[int, int]
    over_bound: Interval
    total: Strategy


def variants(study: Study, _: Any) -> dict[str, Any]:
    """Every strategy at its chosen margin on every seed."""
    given = study.published["real_radio"]
    return {
        "variants": {
            f"kept: {name}, margin {margin} m, seed {seed}": [*_scenario(study, name, margin), f"seed={seed}"]
            for seed in given["seeds"]
            for name, margin in given["chosen"].items()
        }
    }


def margins(study: Study, _: Any) -> dict[str, Any]:
    """Every strategy at every margin."""
    given = study.published["real_radio"]
    return {
        "variants": {
            f"kept: {name}, margin {margin} m": _scenario(study, name, margin)
            for name in given["strategies"]
            for margin in given["margins"]
        }
    }


def _scenario(study: Study, name: str, margin: int) -> list[str]:
    given = study.published["real_radio"]
    return [*given["scenario"], *given["strategies"][name], f"clusters={{kind: appointed, margin: {margin} m}}"]


def strategy_of(variant: str) -> str:
    """'kept: ukf, margin 0 m, seed 1' -> 'ukf'."""
    return variant.partition(": ")[2].partition(", ")[0]


def choices(data: Data) -> list[str]:
    """A line per strategy: its fair margin by the rule, which `published.real_radio.chosen` must have before runs."""
    found, lines = strategies(data), []
    for name in dict.fromkeys(strategy_of(one.variant) for one in found):
        fair = chosen([one for one in found if strategy_of(one.variant) == name]).fair
        lines.append(f"{name}: {fair.rpartition(', ')[2]} is fair; the real radio has "
                     f"margin {data.published['real_radio']['chosen'][name]} m")  # fmt: skip
    return lines


def clopper_pearson(happened: int, count: int) -> Interval:
    """The share of runs in which something happened, with its exact interval (Clopper, Pearson 1934)."""
    low = scipy.special.betaincinv(happened, count - happened + 1, TAIL) if happened else 0.0
    high = scipy.special.betaincinv(happened + 1, count - happened, 1.0 - TAIL) if happened < count else 1.0
    return Interval(happened / count, float(low), float(high))


def on_a_seed(data: Data, variant: str, total: Strategy) -> OnASeed:
    """The figures of one variant."""
    runs = data.of(variant, "runs")
    timely = runs["tracked"].to_numpy(dtype=np.float64)
    lost = (campaigns.ever_lost(runs) | ~(runs["rmse"] <= DIVERGED)).to_numpy()
    share = interval(resampled(len(timely)) @ timely / len(timely))
    return OnASeed(share, (int(np.count_nonzero(lost)), len(lost)), of_medians(squares(data, variant)), total)


def figures(data: Data) -> dict[str, OnASeed]:
    """The figures of all variants."""
    return {one.variant: on_a_seed(data, one.variant, one) for one in strategies(data)}


def answers(data: Data) -> list[Answer]:
    """18 to 20 of each strategy, over the seeds, and 21."""
    return of_figures(figures(data), data.registered["real_radio"])


def of_figures(found: dict[str, OnASeed], wanted: dict[str, float]) -> list[Answer]:
    """The answers that follow from the figures of the strategies on each seed."""
    questions: tuple[tuple[str, Callable[[OnASeed], Interval], Callable[[Interval], bool | None]], ...] = (
        (f"18 ({{}}): >= {wanted['in_time']:.0%} of the estimates in time", lambda one: one.in_time,
         lambda value: value.above(wanted["in_time"])),
        (f"19 ({{}}): at most {wanted['lost']:.0%} of the runs lost", lambda one: clopper_pearson(*one.lost),
         lambda value: value.below(wanted["lost"])),
        (f"20 ({{}}): median error <= {wanted['over_bound']:g} x the median bound", lambda one: one.over_bound,
         lambda value: value.below(wanted["over_bound"])),
    )  # fmt: skip
    names = list(dict.fromkeys(map(strategy_of, found)))
    answers = []
    for words, of, holds in questions:
        for name in names:
            each = [of(one) for variant, one in found.items() if strategy_of(variant) == name]
            answers.append(Answer(words.format(name), tuple(each), word(_all([holds(value) for value in each]))))
        if words.startswith("19"):
            answers += [_lost_of_all_seeds(found, name, wanted["lost"]) for name in names]
    return [*answers, _on_the_front(found)]


def _lost_of_all_seeds(found: dict[str, OnASeed], name: str, most: float) -> Answer:
    """19 of the runs on all seeds together, whose interval is narrow enough for a yes."""
    lost, runs = (sum(numbers) for numbers in zip(*(one.lost for key, one in found.items() if strategy_of(key) == name),
                                                  strict=True))  # fmt: skip
    share = clopper_pearson(lost, runs)
    return Answer(f"19 ({name}, all seeds): at most {most:.0%} of {runs} runs lost", (share,), word(share.below(most)))


def _all(each: Sequence[bool | None]) -> bool | None:
    """Yes on all seeds, no on one, otherwise undecided."""
    answer: bool | None = True
    for one in each:
        answer = both(answer, one)
    return answer


def _on_the_front(found: dict[str, OnASeed]) -> Answer:
    """21: who follows the target on every seed, and who of these is on the Pareto front of every seed."""
    names = list(dict.fromkeys(map(strategy_of, found)))
    of = {name: [one.total for variant, one in found.items() if strategy_of(variant) == name] for name in names}
    follow = [name for name in names if all(one.follows for one in of[name])]
    fronts = [
        set(compress(follow, front(list(of_seed)))) for of_seed in zip(*(of[name] for name in follow), strict=True)
    ]
    best = [name for name in follow if all(name in one for one in fronts)]
    words = (
        f"21: {OURS} is on the Pareto front of error and energy of those that follow on every seed (these follow: "
        f"{', '.join(follow) or 'none'}; on the front of each seed: {', '.join(best) or 'none'})"
    )
    return Answer(words, (), word(OURS in best))
