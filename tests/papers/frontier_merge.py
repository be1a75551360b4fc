"""What new campaigns found, merged with the rows that docs/frontier.json has: rows and answers of the same name go.

merged(before, new) -> an experiment's part with rows of variants
merged_strategies(before, new, registered) -> that of the frontier
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from tests.papers.studies import module

hypotheses = module("frontier", "hypotheses")
_strategies = module("frontier", "strategies")
Strategy = _strategies.Strategy


OF_RUNS = re.compile(r"(run) of \d+.*")
"""What an answer says of the number of runs, which more runs change."""
BY_RUN = ("15", "16")
"""Hypotheses of the frontier that compare strategies run by run: rows do not answer them."""
Part = Mapping[str, Any]


def merged(before: Part, new: Part) -> dict[str, Any]:
    """The rows of both, the new ones in place of those of the same variant; answers likewise."""
    found = {**before, **new, "rows": {**before.get("rows", {}), **new["rows"]}}
    if "answers" in new:
        found["answers"] = [*_replaced(before.get("answers", ()), new["answers"])]
    return found


def _replaced(before: Iterable[Part], new: Sequence[Part]) -> Iterable[Part]:
    fresh = {_key(one): one for one in new}
    kept = [fresh.pop(_key(one), one) for one in before]
    return [*kept, *fresh.values()]


def _key(answer: Part) -> str:
    return OF_RUNS.sub(r"\1", answer["words"])


def number(answer: Part) -> str:
    """The number of the hypothesis that an answer is of."""
    return str(answer["words"]).split(":")[0].split(" ")[0]


def of_row(row: Part) -> Strategy:
    """A row of docs/frontier.json as the figures of a strategy."""
    return Strategy(**{name: row[name] for name in Strategy._fields})


def merged_strategies(before: Part, new: Part, registered: Mapping[str, Any]) -> dict[str, Any]:
    """The strategies of both, and the answers that follow from all of them.

    Answers that compare runs are the new ones if there are any, otherwise those that were there.
    """
    rows = {one["variant"]: one for part in (before, new) for one in part.get("strategies", ())}
    found, bound = [of_row(row) for row in rows.values()], new["bound"]
    paired = [one for one in new["answers"] if number(one) in BY_RUN]
    kept = [one for one in before.get("answers", ()) if number(one) in BY_RUN]
    answers = [each._asdict() for each in hypotheses.of_strategies(found, bound, registered)]
    return {
        "bound": bound,
        "strategies": [*rows.values()],
        "answers": [*answers, *_replaced(kept, paired)],
    }
