"""What a kind is: idea, method, parameters, sources, import line and an example, from the registry and its class.

    kind_info("motion", "coordinated_turn") -> KindInfo
    kinds_named("ris") -> [("sleep", "ris"), ("tracker", "ris")]

`wsnsim info`, the reference of the documentation and `--json` show the same object.
"""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

from wsnsim.base.errors import UsageError
from wsnsim.base.plugin_code import PluginImport, announce
from wsnsim.scenario.citations import Citation, cited_in
from wsnsim.scenario.fields import PartError, fields_of
from wsnsim.scenario.import_names import import_line
from wsnsim.scenario.kind_examples import Example, example_of
from wsnsim.scenario.parameter_info import ParameterInfo, assumptions, has_no_default, parameters_of
from wsnsim.scenario.registry import ROLES, Kind, Role, find, kinds, load_class, search


@dataclass(frozen=True)
class KindInfo:
    """The description of a kind.

    Attributes:
        role: the role's name.
        kind: the kind's name in a scenario.
        purpose: what the role decides.
        idea: the kind in one line.
        paper: the source, as short as in a table.
        method: the paragraphs of the class's docstring, without its sources.
        notes: the paragraphs that name sources and say what is our choice.
        citations: the publications that are cited, with DOIs.
        parameters: its parameters.
        facts: further (name, text) pairs, such as the columns of a motion model's state.
        import_line: how Python imports the class.
        example: lines of a scenario that use the kind.
        default: whether the kind stands for a role that is left out.
        plugin: the package that adds the kind; '' if it comes with wsnsim.
    """

    role: str
    kind: str
    purpose: str
    idea: str
    paper: str
    method: tuple[str, ...]
    notes: tuple[str, ...]
    citations: tuple[Citation, ...]
    parameters: tuple[ParameterInfo, ...]
    facts: tuple[tuple[str, str], ...]
    import_line: str
    example: Example
    default: bool
    plugin: str

    def as_json(self) -> dict[str, Any]:
        """Return the description as plain values."""
        plain = asdict(self)
        plain["citations"] = [one._asdict() for one in self.citations]
        plain["facts"] = dict(self.facts)
        plain["example"] = {"base": self.example.base, "lines": self.example.lines, "files": self.example.files}
        return plain


def kinds_named(word: str) -> list[tuple[str, str]]:
    """Return the (role, kind) pairs that a word names: a kind, 'role.kind', a class's name or 'module:Class'.

    Raises:
        UsageError: the word is a dotted path, and its class is a component of no role.
    """
    if ":" in word:
        return _plugin(word)
    role, dot, name = word.rpartition(".")
    roles = _roles(role) if dot else list(ROLES.values())
    named = [(found.name, name) for found in roles if name in kinds(found.name)]
    return named or [
        (found.name, row.kind)
        for found in roles
        for row in kinds(found.name).values()
        if name and row.path.rpartition(":")[2] == name
    ]


def kind_info(role: str, kind: str) -> KindInfo:
    """Return the description of a kind.

    Raises:
        LookupError: there is no such kind.
        ImportError: its class cannot be imported.
        PartError: its class is no component.
    """
    row, known = find(role, kind), ROLES[role]
    part = load_class(row)
    fields_of(part)  # refuses what is no component
    summary, method, notes = _paragraphs(part)
    text = " ".join([row.paper, *notes, *method])
    idea = summary.rstrip(".") if row.plugin else row.idea or summary.rstrip(".")
    return KindInfo(
        role=role, kind=kind, purpose=known.purpose, idea=idea, paper=row.paper,
        method=(summary, *method), notes=notes, citations=tuple(cited_in(text)),
        parameters=tuple(_parameters(part, role)), facts=tuple(_facts(part, row.state, row.messages)),
        import_line=_import_line(role, row, part), example=example_of(known, kind, tuple(_required(part))),
        default=kind == known.default, plugin=row.plugin,
    )  # fmt: skip


def _import_line(role: str, row: Kind, part: type[Any]) -> str:
    """Return the line that imports the class of a component; of a plug-in, from its module."""
    is_own = row in ROLES[role].kinds
    return import_line(role, row.kind) if is_own else f"from {part.__module__} import {part.__name__}"


def _roles(word: str) -> list[Role]:
    return [role for role in ROLES.values() if word in (role.name, role.plural, role.listed)]


def _plugin(path: str) -> list[tuple[str, str]]:
    """Return the roles that the class at a dotted path can play."""
    from wsnsim.scenario.schema import part_model

    search([""])
    announce(PluginImport("info", path, path.partition(":")[0], ""))
    found, reasons = [], []
    for role in ROLES:
        try:
            part_model(role, path)
            found.append((role, path))
        except ImportError as error:
            raise UsageError(str(error)) from None
        except PartError as error:
            reasons.append(str(error))
    if not found:
        raise UsageError(f"{path} is a component of no role: for example, it {reasons[0].removeprefix(path).strip()}")
    return found


def _paragraphs(part: type[Any]) -> tuple[str, tuple[str, ...], tuple[str, ...]]:
    """Return the first paragraph of a class's docstring, its further ones, and those about sources."""
    text = inspect.cleandoc(vars(part).get("__doc__") or "")
    first, *others = [" ".join(piece.split()) for piece in text.split("\n\n")] if text else [""]
    inherited = [
        " ".join(piece.split())
        for owner in part.__mro__[1:]
        for piece in inspect.cleandoc(vars(owner).get("__doc__") or "").split("\n\n")
        if _is_source(piece)
    ]
    notes = dict.fromkeys([*(piece for piece in others if _is_source(piece)), *inherited])
    return first, tuple(piece for piece in others if not _is_source(piece)), tuple(notes)


def _is_source(paragraph: str) -> bool:
    return paragraph.startswith(("Source:", "Sources:"))


def _facts(part: type[Any], state: str, messages: str) -> Iterator[tuple[str, str]]:
    """Yield what else is known of a class: the columns of its state, the components of its readings."""
    columns, units = getattr(part, "columns", None), getattr(part, "units", None)
    if isinstance(columns, tuple) and isinstance(units, tuple):
        yield (
            "state",
            ", ".join(f"{name} [{unit}]" if unit else name for name, unit in zip(columns, units, strict=True)),
        )
    components = getattr(part, "components", None)
    if isinstance(components, tuple):
        yield "reading", ", ".join(map(str, components))
    if state:
        yield "keeps", state
    if messages:
        yield "sends per step", messages


def _required(part: type[Any]) -> Iterator[str]:
    for field in dataclasses.fields(part):
        if field.init and has_no_default(field):
            yield field.name


def _parameters(part: type[Any], role: str) -> Iterator[ParameterInfo]:
    yield from parameters_of(part)
    if role == "tracker":
        yield from assumptions()
