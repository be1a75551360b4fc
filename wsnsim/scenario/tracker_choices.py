"""Trackers of a comparison, each with its own parameters: 'pf:particles=1000,ekf'.

    choices = tracker_choices("pf:particles=1000,assumes.noise_scale=4,ekf")
    [one.name for one in choices] -> ['pf:particles=1000,assumes.noise_scale=4', 'ekf']

Trackers are separated by commas. A tracker's parameters follow its kind after a colon, as KEY=VALUE with the keys of
the section `tracker`, nested ones with dots, and values as those of --set. Commas between brackets or quotes belong to
a value. A part that is KEY=VALUE without a kind belongs to the tracker before it. Other parameters are defaults, except
that components within the scenario's tracker, such as a filter, are kept where the new kind holds such, too.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, NamedTuple

from wsnsim.base.errors import Issue, ScenarioError, did_you_mean, dotted, shortened
from wsnsim.scenario.axes import Settings, joined
from wsnsim.scenario.load import keys_of
from wsnsim.scenario.points import PointName
from wsnsim.scenario.python_values import defaults_of, of_dict
from wsnsim.scenario.reader import read
from wsnsim.scenario.registry import kinds
from wsnsim.scenario.texts import Assignment, LocatedValue, Origin, Spot

OPTION: Final = "--trackers"
EXAMPLE: Final = "such as --trackers 'pf:particles=1000,ekf'"
PARAMETER: Final = re.compile(r"\s*[A-Za-z_]\w*(\.\w+)*\s*=")
WITH_PARAMETERS: Final = re.compile(rf"(?P<kind>[^=]*?):(?P<parameter>{PARAMETER.pattern}.*)", re.DOTALL)
CLOSED_BY: Final = {"[": "]", "{": "}", "(": ")"}


class TrackerChoice(NamedTuple):
    """A tracker with parameters: its name in tables, and the values to assign."""

    name: str
    assignments: tuple[Assignment, ...]


class TrackerText(NamedTuple):
    """A part of the option's text, and its position there."""

    text: str
    start: int


def tracker_choices(text: str) -> list[TrackerChoice]:
    """Return the trackers that a text names, in its order.

    Raises:
        ScenarioError: the text cannot be read; unknown kinds and parameters are found when a scenario is built.
    """
    groups: list[tuple[TrackerText, list[TrackerText]]] = []
    for part in _split(text):
        if not part.text.strip():
            raise _refused(text, part.start, f"expected a tracker, {EXAMPLE}")
        if PARAMETER.match(part.text):
            if not groups:
                raise _refused(text, part.start, f"'{part.text.strip()}' stands before the first tracker, {EXAMPLE}")
            groups[-1][1].append(part)
            continue
        found = WITH_PARAMETERS.fullmatch(part.text)
        first = [TrackerText(found["parameter"], part.start + found.start("parameter"))] if found else []
        groups.append((TrackerText(found["kind"] if found else part.text, part.start), first))
    return [_choice(text, kind, parameters) for kind, parameters in groups]


def choices_of(trackers: str | Sequence[Any] | Mapping[str, Any]) -> list[TrackerChoice]:
    """Return the trackers of a text, or those that a caller gives in Python: texts, components, mappings, by name.

    Raises:
        ScenarioError: one of them is no tracker.
    """
    if isinstance(trackers, str):
        return tracker_choices(trackers)
    named = list(trackers.items()) if isinstance(trackers, Mapping) else [("", tracker) for tracker in trackers]
    found: list[TrackerChoice] = []
    for number, (name, tracker) in enumerate(named):
        if isinstance(tracker, str):
            found += [TrackerChoice(name or one.name, one.assignments) for one in tracker_choices(tracker)]
        else:
            found.append(_of_value(f"trackers.{name or number}", name, tracker))
    return found


def _of_value(place: str, name: str, tracker: Any) -> TrackerChoice:
    """Return the choice of a component, or of a mapping with a kind; without a name, named as --trackers would."""
    tree, issues = of_dict(tracker, Origin("", Path.cwd()), ("tracker",))
    values = tree.value if isinstance(tree.value, dict) else {}
    if not issues and "kind" not in values:
        message = f"expected a tracker: a component, a mapping with a kind, or a name, got {type(tracker).__name__}"
        issues = [Issue((), message)]
    if issues:
        raise ScenarioError([replace(issue, place=place) for issue in issues])
    assignments = [(("tracker", key), entry.node) for key, entry in values.items()]
    kind = str(values["kind"].node.plain())
    usual = defaults_of(tracker)
    given = {str(key): node.plain() for (_, key), node in assignments if key != "kind"}
    words = [f"{key}={value}" for key, value in given.items() if key not in usual or usual[key] != value]
    return TrackerChoice(name or kind + (":" + ",".join(words) if words else ""), tuple(assignments))


def column_of(choices: list[TrackerChoice]) -> str:
    """Return the column that tells these trackers apart: their kinds if they have no parameters, else their names."""
    return "tracker.kind" if all(len(one.assignments) == 1 for one in choices) else "tracker"


def with_trackers(
    choices: list[TrackerChoice], settings: list[Settings]
) -> tuple[list[Settings], list[PointName] | None]:
    """Return the settings of every tracker, and the names of the points; None if there are no trackers to choose."""
    if not choices:
        return settings, None
    column = column_of(choices)
    pairs = list(itertools.product(choices, settings))
    names = [PointName(column, one.name, frozenset(dotted(path) for path, _ in one.assignments)) for one, _ in pairs]
    return [joined([one.assignments, laid]) for one, laid in pairs], names


def _choice(text: str, kind: TrackerText, parameters: list[TrackerText]) -> TrackerChoice:
    name = kind.text.strip()
    _check_kind(text, name, kind.start)
    origin = Origin(f"{OPTION} {name}", Path.cwd(), (), ("tracker", "kind"))
    assignments: list[Assignment] = [(("tracker", "kind"), LocatedValue(name, Spot(origin)))]
    words = []
    for part in parameters:
        written, _, value = part.text.partition("=")
        keys = ("tracker", *keys_of(written))
        if not value.strip():
            raise _refused(text, part.start, f"{name}: {written.strip()} has no value, {EXAMPLE}")
        if keys in (earlier for earlier, _ in assignments):
            raise _refused(text, part.start, f"{name}: {dotted(keys[1:])} is given twice")
        spot = Origin(f"{OPTION} {name}:{dotted(keys[1:])}", Path.cwd(), (), keys)
        node, issues = read(value, spot)
        if node is None or issues:
            raise ScenarioError(issues)
        assignments.append((keys, node))
        words.append(f"{dotted(keys[1:])}={value.strip()}")
    return TrackerChoice(name + (":" + ",".join(words) if words else ""), tuple(assignments))


def _check_kind(text: str, name: str, start: int) -> None:
    """Refuse what is neither a kind nor a class of a module, such as 'pf:particles' and 'pf:'."""
    head, colon, rest = name.partition(":")
    if colon and (head in kinds("tracker") or not rest):
        raise _refused(text, start, f"{head}: expected KEY=VALUE after the colon, not '{rest}', {EXAMPLE}")
    if "=" in name:
        raise _refused(text, start, f"cannot read '{name}': expected KIND or KIND:KEY=VALUE, {EXAMPLE}")
    if not colon and name not in kinds("tracker"):
        raise _refused(text, start, f"unknown tracker '{shortened(name)}' ({did_you_mean(name, kinds('tracker'))})")


def _split(text: str) -> list[TrackerText]:
    """The parts between the commas that are neither in quotes nor in brackets."""
    parts, start, closing, quote = [], 0, list[tuple[str, int]](), ""
    opened = 0
    for i, char in enumerate(text):
        if quote:
            quote = "" if char == quote else quote
        elif char in "\"'":
            quote, opened = char, i
        elif char in CLOSED_BY:
            closing.append((CLOSED_BY[char], i))
        elif closing and char == closing[-1][0]:
            closing.pop()
        elif char == "," and not closing:
            parts.append(TrackerText(text[start:i], start))
            start = i + 1
    if quote or closing:
        wanted, at = (quote, opened) if quote else closing[-1]
        raise _refused(text, at, f"is never closed: {wanted} is missing")
    return [*parts, TrackerText(text[start:], start)]


def _refused(text: str, start: int, message: str) -> ScenarioError:
    """An error with the option's text and a caret under the place."""
    start += len(text[start:]) - len(text[start:].lstrip())
    return ScenarioError([Issue((), message, OPTION, f"    {text}\n    {' ' * start}^")])
