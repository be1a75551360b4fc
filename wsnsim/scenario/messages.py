"""From pydantic's errors to issues, in the words of a scenario and with their positions; and other YAML documents.

issues_of(validation_error, model, tree) -> [Issue, ...]
read_document(path, model) -> Document        a checked file that is no scenario, of a model based on DocumentModel
document_of(values, model)                      the same of values that a program gives
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Generic, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, ValidationError

from wsnsim.base.errors import Issue, ScenarioError, did_you_mean, dotted
from wsnsim.scenario.reader import read
from wsnsim.scenario.texts import BROKEN, Key, Keys, LocatedValue, Origin, content_of
from wsnsim.scenario.units import described, shown

BOUNDS: Final = {
    "greater_than": ("gt", "greater than"),
    "greater_than_equal": ("ge", "at least"),
    "less_than": ("lt", "less than"),
    "less_than_equal": ("le", "at most"),
}
EXPECTED: Final = {
    "bool_type": "true or false",
    "string_type": "text",
    "model_type": "a mapping",
    "dict_type": "a mapping",
    "tuple_type": "a list",
}


def issues_of(error: ValidationError, model: type[BaseModel], tree: LocatedValue) -> list[Issue]:
    """Return one issue per path; the alternatives of a union that all fail share a message."""
    messages: dict[Keys, list[str]] = {}
    at_key = set()
    for problem in error.errors(include_url=False):
        path = _written(problem["loc"], tree)
        if getattr(tree.at(path), "value", None) is BROKEN:
            continue
        message = _message(problem, path, model)
        if message not in messages.setdefault(path, []):
            messages[path].append(message)
        if problem["type"] == "extra_forbidden":
            at_key.add(path)
    return [tree.spot_of(path, path in at_key).issue(path, "; or ".join(words)) for path, words in messages.items()]


def _written(location: tuple[Key, ...], tree: LocatedValue) -> Keys:
    """Return the location without the entries that pydantic adds for the alternatives of a union."""
    path: list[Key] = []
    node: LocatedValue | None = tree
    for key in location:
        if node is not None and isinstance(node.value, dict if isinstance(key, str) else list):
            path.append(key)
            node = node.child(key)
    return tuple(path)


def _message(problem: Any, path: Keys, model: type[BaseModel]) -> str:
    kind, value, context = problem["type"], problem["input"], problem.get("ctx", {})
    if kind in BOUNDS:
        name, words = BOUNDS[kind]
        angle = " rad (degrees have their unit: '2 deg')" * ("[rad]" in (_description(model, path) or ""))
        return f"must be {words} {context[name]:g}, is {_short(value)}{angle}"
    if kind in EXPECTED:
        return f"expected {EXPECTED[kind]}, got {described(value)}"
    if kind == "literal_error":
        known = literals(_annotation(model, path))
        return f"unknown value {shown(value)} ({did_you_mean(str(value), known)})" if known else problem["msg"]
    if kind == "missing":
        about = _description(model, path)
        return "is missing" + (f": {about}" if about else "")
    if kind == "extra_forbidden":
        comma = "decimals have a point, not a comma; " * str(path[-1])[:1].isdigit()
        key, parent = str(path[-1]), _annotation(model, path[:-1])
        blocks = {name: unwrapped(field.annotation) for name, field in parent.model_fields.items() if name != "record"}
        ends = [f"'{name}.{key}'" for name, block in blocks.items() if key in getattr(block, "model_fields", ())]
        nearest = did_you_mean(key, {*parent.model_fields, *getattr(parent, "roles", ())})
        return f"unknown key, {comma}" + (f"did you mean {' or '.join(ends[-3:])}?" if ends else nearest)
    return str(context.get("message", problem["msg"]))


def _short(number: float) -> str:
    try:
        return f"{number:g}"
    except OverflowError:  # an integer that is too large for a float
        return shown(number)


def literals(annotation: Any) -> list[str]:
    """Return every text that the Literals within an annotation allow."""
    found: list[str] = []
    for argument in get_args(annotation):
        found += [argument] if isinstance(argument, str) else literals(argument)
    return found


def _annotation(model: Any, path: Keys) -> Any:
    """Return the annotation of a path in a model, or the model within that annotation."""
    here: Any = model
    for key in path:
        inside = here if _is_model(here) else _first_model(here)
        if inside is not None and key in inside.model_fields:
            here = inside.model_fields[key].annotation
        else:
            arguments = [argument for argument in get_args(unwrapped(here)) if argument is not ...]
            index = min(key, len(arguments) - 1) if isinstance(key, int) else -1
            here = arguments[index] if arguments else here
    return _first_model(here) or here


def _description(model: Any, path: Keys) -> str | None:
    inside = _annotation(model, path[:-1])
    field = inside.model_fields.get(path[-1]) if _is_model(inside) else None
    return field.description if field else None


def _is_model(thing: Any) -> bool:
    return isinstance(thing, type) and issubclass(thing, BaseModel)


def _first_model(annotation: Any) -> Any:
    if _is_model(annotation):
        return annotation
    return next((inner for argument in get_args(annotation) if (inner := _first_model(argument)) is not None), None)


def unwrapped(annotation: Any) -> Any:
    """Return an annotation without Annotated and without None."""
    arguments = [argument for argument in get_args(annotation) if argument is not type(None)]
    if hasattr(annotation, "__metadata__") or (len(arguments) == 1 and len(get_args(annotation)) == 2):
        return unwrapped(arguments[0])
    return annotation


class DocumentModel(BaseModel):
    """Declared keys of a mapping; any other key is an issue."""

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)


M = TypeVar("M", bound=DocumentModel)


@dataclass(frozen=True)
class Document(Generic[M]):
    """A checked document and where its values stand."""

    content: M
    root: LocatedValue

    def issue(self, path: Keys, message: str) -> Issue:
        """An issue of the value at a path of keys."""
        return self.root.spot_of(path).issue(path, message)


def read_document(path: Path, model: type[M], name: str = "") -> Document[M]:
    """The document in a YAML file, checked against a model; issues call the file by `name`, by default its own.

    Raises:
        ScenarioError: every issue found, each at its place.
    """
    content, issues = content_of(path)
    if content is None:
        raise ScenarioError(issues)
    root, issues = read(content, Origin(name or path.name, path.parent, tuple(content.splitlines())))
    if root is None or issues:
        raise ScenarioError(issues)
    try:
        return Document(model.model_validate(root.plain()), root)
    except ValidationError as error:
        raise ScenarioError(issues_of(error, model, root)) from None


def document_of(values: Mapping[str, Any], model: type[M]) -> M:
    """The document with these values. Raises ValueError with its first issue."""
    try:
        return model.model_validate(values)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        raise ValueError(f"{dotted(first['loc'])}: {first['msg']}") from None
