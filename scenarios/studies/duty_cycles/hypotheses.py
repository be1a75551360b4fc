"""The hypotheses of docs/registered/duty_cycles.txt, and their answers, which follow from the rows of the runs.

    OF_EXPERIMENT[name](data) -> [Answer, ...]        of the experiment with this name
    lines(data) -> [line, ...]                        the same in words

Thresholds stand in duty_cycles.yaml (`registered`). An answer is undecided if its 95 % interval contains the threshold,
and if one of its points has not been run.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from itertools import pairwise
from typing import Any, Final

import numpy as np

from wsnsim.papers.toolkit import Answer, Data, Floats, interval, word

from .points import (
    DELIVERED,
    ENERGY,
    ERROR,
    IN_TIME,
    REFERENCE,
    Best,
    best,
    over_known,
    ratio,
    run,
    statistic,
    trackers,
    usable_as_first_registered,
)

WITH_THREE: Final = "mean:tracked_three"
WOKEN: Final = ("gmtt", "tsstp", "cluster")
"""The trackers of Li's field that wake nodes."""
NEAR, FOUND = "near 125", "ctp"
"""The words of variants with an interval that follows the target, and with routes that are found."""
EXPERT: Final = "information_driven"
SYMBOLS: Final = {"above": ">", "below": "<"}


def _ask(data: Data, words: str, variants: Iterable[str], compute: Callable[[], Floats], **limit: float) -> Answer:
    """The answer to whether a value (1 + draws,) is `above` or `below` a limit; undecided without its points."""
    ((side, threshold),) = limit.items()
    said = f"{words} {SYMBOLS[side]} {threshold:g}"
    if not set(variants) <= set(run(data)):
        return Answer(f"{said} (not run)", (), "undecided")
    found = interval(compute())
    return Answer(said, (found,), word(found.above(threshold) if side == "above" else found.below(threshold)))


def _over(data: Data, words: str, one: str, other: str, measure: str, **limit: float) -> Answer:
    """The answer on the measure of one point over that of another."""
    return _ask(data, words, (one, other), lambda: ratio(data, one, other, measure), **limit)


def _spreads(data: Data, number: int, wanted: Mapping[str, Mapping[str, float]]) -> Iterator[Answer]:
    """The greatest of the trackers' energies over the least, for each MAC that is registered."""
    for mac, limit in wanted.items():
        points = [f"{tracker}, {mac}" for tracker in trackers(data)]
        words = f"{number}: {mac}: greatest over least energy of the trackers"
        yield _ask(data, words, points, partial(_spread, data, points), **limit)


def _spread(data: Data, variants: Iterable[str]) -> Floats:
    energies = np.array([statistic(data, variant, ENERGY) for variant in variants])
    found: Floats = energies.max(axis=0) / energies.min(axis=0)
    return found


def _order(data: Data, wanted: Mapping[str, str]) -> Iterator[Answer]:
    """2: which of gmtt and tsstp spends more."""
    for mac, dear in wanted.items():
        cheap = "gmtt" if dear == "tsstp" else "tsstp"
        words = f"2: {mac}: energy of {dear} over that of {cheap}"
        yield _over(data, words, f"{dear}, {mac}", f"{cheap}, {mac}", ENERGY, above=1.0)


def _in_time(data: Data, least: float) -> Iterator[Answer]:
    """3: shares of steps in time over those on CSMA."""
    cases = [("xmac 125", "above", IN_TIME, (*WOKEN, "ris")), ("contikimac 125", "above", IN_TIME, (*WOKEN, "ris")),
             ("xmac 1000", "below", IN_TIME, WOKEN), ("xmac 500", "below", WITH_THREE, WOKEN)]  # fmt: skip
    for mac, side, measure, names in cases:
        share = "share in time" if measure == IN_TIME else "share in time with three"
        for tracker in names:
            words = f"3: {tracker}, {mac}: {share} over that on CSMA"
            yield _over(data, words, f"{tracker}, {mac}", f"{tracker}, {REFERENCE}", measure, **{side: least})


def _contikimac(data: Data) -> Iterator[Answer]:
    """5: ContikiMAC over X-MAC."""
    for size in (125, 500):
        for tracker in trackers(data):
            words = f"5: {tracker}, {size} ms: energy on ContikiMAC over that on X-MAC"
            one, other = (f"{tracker}, {kind} {size}" for kind in ("contikimac", "xmac"))
            yield _over(data, words, one, other, ENERGY, below=1.0)


def _best(data: Data, tenth: float) -> Iterator[Answer]:
    """6 and 7: the best intervals of X-MAC."""
    rule = usable_as_first_registered
    found = [best(data, tracker, "xmac", rule) for tracker in trackers(data) if f"{tracker}, xmac 125" in run(data)]
    for each in found:
        share = over_known(each.energies / statistic(data, f"{each.tracker}, {REFERENCE}", ENERGY))
        words = f"6: {each.tracker}: energy at the best interval of X-MAC over that on CSMA < {tenth:g}"
        none = " (no interval is usable)" if not each.usable else ""
        yield Answer(words + none, () if none else (share,), "no" if none else word(share.below(tenth)))
    if found:
        yield Answer("7: the best intervals of X-MAC (s) of two trackers have ranges that do not meet",
                     tuple(each.interval for each in found), word(_differ(found)))  # fmt: skip


def _differ(found: Iterable[Best]) -> bool | None:
    """Whether two ranges do not meet; False if all trackers have the same best interval, else None."""
    ranges = sorted(each.interval for each in found if np.isfinite(each.interval.value))
    lowest_end = min((each.high for each in ranges), default=np.inf)
    if any(each.low > lowest_end for each in ranges):
        return True
    return False if all(one.value == other.value for one, other in pairwise(ranges)) else None


def _radio_on(data: Data, wanted: Mapping[str, float]) -> Iterator[Answer]:
    """8: the share of time with the radio on."""
    for mac, most in wanted.items():
        for tracker in trackers(data):
            name = f"{tracker}, {mac}"
            words = f"8: {name}: share of time with the radio on"
            yield _ask(data, words, [name], partial(statistic, data, name, "mean:radio_on"), below=most)


def _lifetime(data: Data, wanted: Mapping[str, float]) -> Iterator[Answer]:
    """9: days that two AA cells last."""
    name = "gmtt, contikimac 125"
    yield _ask(data, f"9: {name}: lifetime of the mean node, days", [name],
               partial(statistic, data, name, "median:days"), above=wanted["days"])  # fmt: skip
    yield _ask(data, f"9: {name}: lifetime of the busiest node over that of the mean node", [name],
               lambda: statistic(data, name, "median:days_busiest") / statistic(data, name, "median:days"),
               below=wanted["busiest"])  # fmt: skip


def _latency(data: Data, wanted: Mapping[str, float]) -> Iterator[Answer]:
    """10: latency at the head and at the sink."""
    name, reference = "gmtt, xmac 125", f"gmtt, {REFERENCE}"
    yield _over(data, f"10: {name}: latency at the head over that on CSMA", name, reference, "tracks_median:delay",
                above=wanted["head"])  # fmt: skip
    yield _ask(data, f"10: {name}: latency at the sink, s", [name],
               partial(statistic, data, name, "tracks_median:report_delay"), below=wanted["sink"])  # fmt: skip


def _follows(data: Data, most: float) -> Iterator[Answer]:
    """12: an interval that follows the target."""
    for tracker in ("gmtt", "tsstp"):
        one, other = f"{tracker}, xmac 500, {NEAR}", f"{tracker}, xmac 500"
        yield _over(data, f"12: {one}: share in time with three over that without", one, other, WITH_THREE, above=1.0)
        yield _over(data, f"12: {one}: energy over that without", one, other, ENERGY, below=most)


def found_routes(data: Data) -> list[Answer]:
    """13: routes that are found and paid for."""
    wanted = _registered(data)["found"]
    one, other = f"gmtt, xmac 250, {FOUND}", "gmtt, xmac 250"
    words = (
        f"13: {one}: energy over that with ideal routes",
        f"13: {one}: reports delivered over those with ideal routes",
    )
    return [
        _over(data, words[0], one, other, ENERGY, above=wanted["energy"]),
        _over(data, words[1], one, other, DELIVERED, above=wanted["delivered"]),
    ]


def _slotframes(data: Data, least: float) -> Iterator[Answer]:
    """14: TSCH with a short and with a long slotframe."""
    for mac, side in (("tsch 11", "above"), ("tsch 101", "below")):
        words = f"14: gmtt, {mac}: share in time over that on CSMA"
        yield _over(data, words, f"gmtt, {mac}", f"gmtt, {REFERENCE}", IN_TIME, **{side: least})


def _beside_csma(data: Data, number: int, what: str, measure: str, **limit: float) -> Iterator[Answer]:
    """4 and 11: trackers that wake nodes, on X-MAC at 125 ms over CSMA."""
    for tracker in WOKEN:
        words = f"{number}: {tracker}, xmac 125: {what} over that on CSMA"
        yield _over(data, words, f"{tracker}, xmac 125", f"{tracker}, {REFERENCE}", measure, **limit)


def li(data: Data) -> list[Answer]:
    """1 to 12, and 14: Li's field."""
    wanted = _registered(data)
    return [
        *_spreads(data, 1, wanted["spread"]),
        *_order(data, wanted["order"]),
        *_in_time(data, wanted["in_time"]),
        *_beside_csma(data, 4, "error", ERROR, below=wanted["error"]),
        *_contikimac(data),
        *_best(data, wanted["tenth"]),
        *_radio_on(data, wanted["radio_on"]),
        *_lifetime(data, wanted["lifetime"]),
        *_latency(data, wanted["latency"]),
        *_beside_csma(data, 11, "share of reports delivered", DELIVERED, above=wanted["delivered"]),
        *_follows(data, wanted["follows"]["energy"]),
        *_slotframes(data, wanted["in_time"]),
    ]


def jiang(data: Data) -> list[Answer]:
    """15 to 17: Jiang's field in slow motion."""
    wanted = _registered(data)["slow"]
    answers = [*_spreads(data, 15, wanted["spread"])]
    for tracker in trackers(data):
        if tracker != EXPERT:
            one, other = f"{EXPERT}, xmac 125", f"{tracker}, xmac 125"
            words = f"16: xmac 125: energy of {EXPERT} over that of {tracker}"
            answers.append(_over(data, words, one, other, ENERGY, below=wanted["expert"]))
    one, other = f"{EXPERT}, xmac 250", "ekf, xmac 250"
    words = f"17: xmac 250: share in time with three of {EXPERT} over that of ekf"
    return [*answers, _over(data, words, one, other, WITH_THREE, above=1.0)]


def _registered(data: Data) -> Mapping[str, Any]:
    found: Mapping[str, Any] = data.registered
    return found


OF_EXPERIMENT: Final[Mapping[str, Callable[[Data], list[Answer]]]] = {
    "li": li, "found": found_routes, "jiang": jiang,
    "li_again": li, "found_again": found_routes, "jiang_again": jiang,
}  # fmt: skip
"""The first study and its replication are answered by the same functions."""


def lines(data: Data) -> list[str]:
    """A line per hypothesis of the experiment that the data are of."""
    name = data.manifest.name.removeprefix("duty_cycles_")
    return [f"registered {answer}" for answer in OF_EXPERIMENT[name](data)]
