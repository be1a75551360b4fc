"""Answers to hypotheses that were registered before the runs that answer them.

resamples(statistic) -> (1 + draws,)    a statistic of the runs as they are, and of every resample
interval(values) -> Interval            of a value and its resamples
ends(low, high) -> ' [0.90, 1.10]'      the ends of an interval in words
Interval.above(threshold)               True, False, or None if the interval contains the threshold
Answer(words, found, answer)            'yes', 'no' or 'undecided', with the intervals that it follows from
answered(hypothesis, data) -> Answer    of a hypothesis that a study's file declares
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final, Literal, NamedTuple, TypeAlias

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.papers.measures import Data, sample
from wsnsim.papers.reproduction import RegisteredHypothesis
from wsnsim.papers.resampling import DRAWS, Resampled, known, weights

TAIL: Final = 0.025
Word: TypeAlias = Literal["yes", "no", "undecided"]
_WORDS: Final[Mapping[bool | None, Word]] = {True: "yes", False: "no", None: "undecided"}


class Interval(NamedTuple):
    """A value with its 95 % interval; NaN without one."""

    value: float
    low: float
    high: float

    def __str__(self) -> str:
        return "unknown" if np.isnan(self.value) else f"{self.value:.2f}{ends(self.low, self.high)}"

    def above(self, threshold: float) -> bool | None:
        """Whether the whole interval is above a threshold, or below it; None if it is neither, or unknown."""
        if self.low > threshold:
            return True
        return False if self.high < threshold else None

    def below(self, threshold: float) -> bool | None:
        """Whether the whole interval is below a threshold, or above it; None if it is neither, or unknown."""
        above = self.above(threshold)
        return None if above is None else not above


UNKNOWN: Final = Interval(float("nan"), float("nan"), float("nan"))


class Answer(NamedTuple):
    """The answer to a registered hypothesis."""

    words: str
    found: tuple[Interval, ...]
    answer: Word

    def __str__(self) -> str:
        return f"{self.words}: {self.answer}" + (f", {' and '.join(map(str, self.found))}" if self.found else "")


def answered(hypothesis: RegisteredHypothesis, data: Data) -> Answer:
    """The answer to a hypothesis, over the runs that have a value; undecided if its interval has the threshold."""
    found = interval(resamples(known(sample(data, hypothesis.of, hypothesis.measure))))
    if hypothesis.above is not None:
        holds = found.above(hypothesis.above)
    else:
        assert hypothesis.below is not None, "one of both, as the study's file is checked"
        holds = found.below(hypothesis.below)
    return Answer(hypothesis.says, (found,), word(holds))


def resamples(found: Resampled) -> Floats:
    """(1 + draws,) a statistic of the runs as they are, and of every resample."""
    count = len(found.runs)
    return np.concatenate([found.at(np.ones((1, count))), found.at(weights(count, count))])


def interval(values: Floats) -> Interval:
    """The interval of a value (1 + draws,), the first of which is that of all runs; NaN if a resample has no value."""
    assert len(values) == 1 + DRAWS
    with np.errstate(invalid="ignore"):  # between infinite values
        low, high = np.quantile(values[1:], [TAIL, 1.0 - TAIL])
    return Interval(float(values[0]), float(low), float(high))


def ends(low: float, high: float, form: str = ".2f") -> str:
    """The ends of an interval as they follow a value in a text; '' if they are not known."""
    return f" [{low:{form}}, {high:{form}}]" if math.isfinite(low) and not math.isnan(high) else ""


def word(holds: bool | None) -> Word:
    """'yes' if a hypothesis holds, 'no' if it does not, 'undecided' if it is not known."""
    return _WORDS[holds]


def both(one: bool | None, other: bool | None) -> bool | None:
    """Whether two statements hold; None if that is not known."""
    if one is False or other is False:
        return False
    return None if one is None or other is None else True
