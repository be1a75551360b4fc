"""The hypotheses of docs/registered/frontier.txt, and their answers, which follow from the rows of the runs.

    OF_EXPERIMENT[name](data) -> [Answer, ...]        of the experiment with this name
    lines(data) -> [line, ...]                        the same in words

Thresholds stand in frontier.yaml (`registered`). An answer is undecided if its 95 % interval contains the threshold.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import compress
from typing import Any, Final

import numpy as np
import pandas as pd

from wsnsim.papers.toolkit import UNKNOWN, Answer, Data, Interval, both, campaigns, interval, statistics, word

from .bound import DIMENSIONS, SETTLED, Of, mean_nees, of_medians, pooled, ratio_of_medians, resampled, squares
from .real_radio import answers as real_radio
from .settings import stored
from .strategies import NEAR, OURS, RADIOS, Strategy, cheapest, front, limit, strategies

APPOINTED: Final = "appointed"


def strategy_of(variant: str) -> str:
    """'ideal: ekf, fair' -> 'ekf'."""
    return variant.partition(": ")[2].partition(", ")[0]


def last_word(variant: str) -> str:
    """'ideal: ekf, fair' -> 'fair'."""
    return variant.rpartition(", ")[2]


def seed_and_words(variant: str) -> str:
    """'slots: ekf, idle slots kept, seed 1' -> 'seed 1, idle slots kept'."""
    *others, seed = variant.partition(": ")[2].split(", ")[1:]
    return ", ".join([seed, *others])


def at_the_bound(data: Data) -> list[Answer]:
    """1 to 5: error over the bound, joules, losses and consistency on the ideal radio, for each seed."""
    return [answer for variant in data.variants for answer in _at_the_bound(data, variant)]


def _at_the_bound(data: Data, variant: str) -> list[Answer]:
    wanted, seed, found = _registered(data), last_word(variant), squares(data, variant)
    ratio, of_middle = pooled(found), of_medians(found)
    energy = mean_of_runs(data, variant, "energy")
    return [
        Answer(f"1 ({seed}): pooled error <= {wanted['ideal']:.2f} x the bound", (ratio,),
               word(ratio.below(wanted["ideal"]))),
        Answer(f"1 ({seed}): median error <= {wanted['ideal']:.2f} x the median bound", (of_middle,),
               word(of_middle.below(wanted["ideal"]))),
        Answer(f"2 ({seed}): energy <= {wanted['joules']:g} J", (energy,), word(energy.below(wanted["joules"]))),
        _no_run_lost("3", data, variant, wanted["greatest"]),
        *(_consistent(data, variant, of) for of in DIMENSIONS),
        _near_walls(data, variant),
    ]  # fmt: skip


def _no_run_lost(number: str, data: Data, variant: str, greatest: float | None) -> Answer:
    """No run loses the target at any time, nor has an RMSE above a threshold (m)."""
    runs = data.of(variant, "runs")
    lost, most = campaigns.ever_lost(runs), float(runs["rmse"].max())
    words = f"{number} ({seed_and_words(variant)}): no run of {len(runs)} loses the target"
    if greatest is not None:
        words += f" or has an RMSE above {greatest:g} m (lost {int(lost.sum())}, greatest RMSE {most:.2f} m)"
    share = statistics.share(lost)
    holds = not lost.any() and (greatest is None or most <= greatest)
    return Answer(words, (Interval(share.value, share.low, share.high),), word(bool(holds)))


def _consistent(data: Data, variant: str, of: Of) -> Answer:
    """Away from walls, the interval of the mean NEES contains the dimension."""
    found, size = mean_nees(data, variant, False, of), DIMENSIONS[of]
    words = f"4 ({last_word(variant)}): away from walls, the interval of the mean NEES of the {of} contains {size}"
    return Answer(words, (found,), word(None if np.isnan(found.low) else bool(found.low <= size <= found.high)))


def _near_walls(data: Data, variant: str) -> Answer:
    """Near walls, the filter claims too much, and not by far."""
    size, most = DIMENSIONS["position"], _registered(data)["near_walls"]
    found = mean_nees(data, variant, True)
    words = f"5 ({last_word(variant)}): near walls, the mean NEES of the position is above {size} and below {most:g}"
    return Answer(words, (found,), word(both(found.above(size), found.below(most))))


def on_a_radio(data: Data) -> list[Answer]:
    """6 and 7: error over the bound, estimates in time and losses on the CC2420, for each kind of slots and seed."""
    found = []
    for variant in data.variants:
        wanted, seed, all_steps = _registered(data), seed_and_words(variant), squares(data, variant)
        for words, ratio, most in (
            ("pooled error after 1 s", pooled(all_steps.after(SETTLED)), wanted["radio_settled"]),
            ("pooled error of the whole run", pooled(all_steps), wanted["radio_whole"]),
        ):
            found.append(Answer(f"6 ({seed}): {words} <= {most:g} x the bound", (ratio,), word(ratio.below(most))))
        timely = mean_of_runs(data, variant, "tracked")
        found += [
            Answer(f"7 ({seed}): >= {wanted['in_time']:.0%} of the estimates in time", (timely,),
                   word(timely.above(wanted["in_time"]))),
            _no_run_lost("7", data, variant, None),
        ]  # fmt: skip
    return found


def asleep(data: Data) -> list[Answer]:
    """8: beside other trackers on the same network, of which few nodes are awake."""
    (ours,) = (variant for variant in data.variants if strategy_of(variant) == OURS)
    timely = mean_of_runs(data, ours, "tracked")
    lost = {name: _lost(data, name) for name in data.variants}
    return of_losses(lost, timely, _registered(data)["asleep_in_time"])


def of_losses(lost: Mapping[str, pd.Series], timely: Interval, least: float) -> list[Answer]:
    """8, from the runs that each variant loses (1 or 0, by replicate), and our share of steps in time."""
    (ours,) = (variant for variant in lost if strategy_of(variant) == OURS)
    found = []
    for rival in lost:
        if rival != ours:
            excess = (lost[rival] - lost[ours]).dropna().to_numpy()
            less = interval(resampled(len(excess)) @ excess / len(excess)) if len(excess) else UNKNOWN
            words = f"8: {ours} loses the target in a smaller share of runs than {rival} (share less its own)"
            found.append(Answer(words, (less,), word(less.above(0.0))))
    return [*found, Answer(f"8: it has an estimate in time in >= {least:.0%} of the steps", (timely,),
                           word(timely.above(least)))]  # fmt: skip


def robustness(data: Data) -> list[Answer]:
    """9 to 11: what wrong knowledge costs, paired by run with the same tracker that knows all."""
    wanted, ours = _registered(data)["robust"], next(name for name in data.variants if strategy_of(name) == OURS)
    found = []
    for name, limits in wanted.items():
        number, least, most = limits["number"], limits["least"], limits["most"]
        ratio = _ratio(data, f"{ours}, {name}", ours)
        words = f"{number}: {name}: RMSE {least:g} to {most:g} times that with full knowledge"
        found.append(Answer(words, (ratio,), word(both(ratio.above(least), ratio.below(most)))))
    return found


def frontier(data: Data) -> list[Answer]:
    """12 to 17: strategies at fair settings."""
    found = strategies(data)
    answers = [*of_strategies(found, limit(data), _registered(data)), *of_pairs(data, found)]
    return sorted(answers, key=lambda each: int(each.words.partition(":")[0]))


def of_strategies(given: Sequence[Strategy], bound: float, registered: Mapping[str, Any]) -> list[Answer]:
    """12 to 14 and 17, which follow from the figures of the strategies and the bound (m)."""
    found = {one.variant: one for one in given}
    return [
        *_within_reach(found, bound, registered["published_near"]),
        _cheapest(found, bound),
        _on_the_front(found),
        *_kept(found, registered["kept"]),
    ]


def of_pairs(data: Data, given: Sequence[Strategy]) -> list[Answer]:
    """15 and 16, which compare two strategies run by run; without those of which the campaign lacks one."""
    found = {one.variant: one for one in given}
    return [*_linearisation(data, found), *_membership(data, found)]


def _within_reach(found: Mapping[str, Strategy], bound: float, least: float) -> list[Answer]:
    """12: with fair settings another strategy comes within 1.5 times the bound, and none within a smaller multiple."""
    others = [one for one in found.values() if one.radio == RADIOS[0] and strategy_of(one.variant) != OURS]
    those = [one for one in others if one.follows and APPOINTED not in one.variant]
    best = min(those, key=lambda one: one.rmse, default=None)
    ratio = Interval(best.rmse / bound, best.low / bound, best.high / bound) if best else UNKNOWN
    name = f"the best other strategy on the ideal radio ({best.variant if best else 'none follows the target'})"
    return [
        Answer(f"12: {name} is within {NEAR:g} x the bound", (ratio,), word(ratio.below(NEAR))),
        Answer(f"12: {name} is above {least:g} x the bound", (ratio,), word(ratio.above(least))),
    ]


def _cheapest(found: Mapping[str, Strategy], bound: float) -> Answer:
    """13: who is the cheapest within 1.5 times the bound on the ideal radio."""
    best = cheapest([one for one in found.values() if one.radio == RADIOS[0]], NEAR * bound)
    name = best.variant if best else "none"
    words = f"13: on the ideal radio, {OURS} is the cheapest within {NEAR:g} x the bound (it is {name})"
    return Answer(words, (), word(strategy_of(name) == OURS))


def _on_the_front(found: Mapping[str, Strategy]) -> Answer:
    """14: who has the least error on a real radio with all nodes awake."""
    these = [one for one in found.values() if one.air == "slots" and one.follows]
    best = min(these, key=lambda one: one.rmse, default=None)
    on = [one.variant for one in compress(these, front(these))]
    words = f"14: on the CC2420 with slots, {OURS} has the least error of those that follow (it is "
    words += f"{best.variant if best else 'none'}; Pareto front: {', '.join(on)})"
    return Answer(words, (), word(best is not None and strategy_of(best.variant) == OURS))


def _linearisation(data: Data, found: Mapping[str, Strategy]) -> list[Answer]:
    """15: sigma points change the median error of the extended filter by little."""
    answers, far = [], _registered(data)["linearisation"]
    for kind in ("ukf", "ckf"):
        one, other = (_fair(f"ideal: {name}", found) for name in (kind, "ekf"))
        if one not in found or other not in found:
            continue
        ratio = _ratio(data, one, other)
        holds = both(ratio.above(1.0 - far), ratio.below(1.0 + far))
        answers.append(Answer(f"15: median RMSE of {one} within {far:.0%} of that of {other}", (ratio,), word(holds)))
    return answers


def _membership(data: Data, found: Mapping[str, Strategy]) -> list[Answer]:
    """16: appointed clusters serve other filters, too."""
    less = _registered(data)["membership"]
    answers = []
    for kind in ("ekf", "gpf"):
        one, other = f"ideal: {kind}, {APPOINTED}", f"ideal: {kind}"
        if one in found and other in found:
            ratio = _ratio(data, one, other)
            words = f"16: appointed clusters lower the median RMSE of {kind} to less than {less:g} of what it was"
            answers.append(Answer(words, (ratio,), word(ratio.below(less))))
    return answers


def _kept(found: Mapping[str, Strategy], least: float) -> list[Answer]:
    """17: a fair setting that follows the target on the sweep's seeds does so on others."""
    answers = []
    for radio, sweep in stored().items():
        before = {one.variant: one for one in sweep.results}
        promised = [name for name, choice in sweep.choices.items() if before[choice.fair].follows]
        names = (_fair(f"{radio}: {name}", found) for name in promised)
        again = [found[name] for name in names if name in found]
        share = statistics.share(np.array([one.follows for one in again]))
        words = (
            f"17: on the radio '{radio}', >= {least:.0%} of the strategies whose fair setting follows the target in "
        )
        words += f"the sweep follow it again ({sum(one.follows for one in again)} of {len(again)})"
        answers.append(Answer(words, (Interval(share.value, share.low, share.high),), word(share.value >= least)))
    return answers


def _fair(usual: str, found: Mapping[str, Strategy]) -> str:
    """The variant of a strategy at its fair setting, which may be the default."""
    return f"{usual}, fair" if f"{usual}, fair" in found else usual


def _ratio(data: Data, one: str, other: str) -> Interval:
    """The median RMSE of a variant over that of another, of the runs that both have, resampled together."""
    errors, others = data.of_runs(one, "rmse").align(data.of_runs(other, "rmse"), join="inner")
    return ratio_of_medians(errors.to_numpy(), others.to_numpy())


def mean_of_runs(data: Data, variant: str, column: str) -> Interval:
    """The mean of a column of `runs`."""
    values = data.of_runs(variant, column).to_numpy(dtype=np.float64)
    return interval(resampled(len(values)) @ values / len(values))


def _lost(data: Data, variant: str) -> pd.Series:
    """1 for a run that loses its target at any time, by replicate."""
    runs = data.of(variant, "runs")
    return pd.Series(campaigns.ever_lost(runs).astype(np.float64), index=runs["replicate"].to_numpy())


def _registered(data: Data) -> Mapping[str, Any]:
    found: Mapping[str, Any] = data.registered
    return found


OF_EXPERIMENT: Final[Mapping[str, Callable[[Data], list[Answer]]]] = {
    "at_the_bound": at_the_bound,
    "at_the_bound_again": at_the_bound,
    "on_a_radio": on_a_radio,
    "on_a_radio_again": on_a_radio,
    "asleep": asleep,
    "robustness": robustness,
    "frontier": frontier,
    "real_radio": real_radio,
}


def lines(data: Data) -> list[str]:
    """A line per hypothesis of the experiment that the data are of."""
    name = data.manifest.name.partition("_")[2]
    return [f"registered {answer}" for answer in OF_EXPERIMENT[name](data)]
