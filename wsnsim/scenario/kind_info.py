"""The description of a kind: idea, method, parameters, sources, import line, example; from registry and class.

    kind_info("motion", "coordinated_turn") -> KindInfo
    kinds_named("ris") -> [("sleep", "ris"), ("tracker", "ris")]

`wsnsim info`, the reference of the documentation and `--json` show the same object.

    cited_in("Jiang, Song, Lin (2013), eq. 1-4") -> [Citation(...)]
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

from wsnsim.base.errors import UsageError
from wsnsim.base.facades import import_name, package_of
from wsnsim.base.files import read_sections
from wsnsim.base.plugin_code import PluginImport, announce
from wsnsim.scenario.fields import PartError, fields_of
from wsnsim.scenario.parameter_info import ParameterInfo, common_parameters, has_no_default, parameters_of
from wsnsim.scenario.registry import ROLES, Role, find, kinds, load_class, search

BASE: Final = "jiang_field"
"""The shipped scenario that most examples extend."""


@dataclass(frozen=True)
class Example:
    """A minimal scenario with one kind.

    Attributes:
        base: the shipped scenario that it extends.
        lines: its own lines, beside `extends` and `name`; the first one names the kind.
        files: the content of each file that the lines name.
    """

    base: str
    lines: tuple[str, ...]
    files: dict[str, str] = dataclasses.field(default_factory=dict)

    def text(self, name: str = "example") -> str:
        """Return the scenario as YAML."""
        return "\n".join([f"extends: {self.base}", f"name: {name}", *self.lines]) + "\n"


NODES: Final = "id,x,y\na,0,0\nb,50,0\nc,0,50\nd,50,50\n"
TRACK: Final = "time,x,y\n0,5,5\n10,30,20\n28,45,45\n"
READINGS: Final = "time,node,reading\n0,a,7.1\n1,b,44.1\n2,c,44.1\n3,d,62.2\n"
LINKS: Final = (
    '{"tx_length": 100, "interframe_duration": 100, "node_count": 2, "channels": [26]}\n'
    "datetime,src,dst,channel,mean_rssi,pdr,tx_count\n"
    "2026-01-01T00:00:00,0,1,26,-60.0,1.0,100\n2026-01-01T00:00:30,1,0,26,-61.0,0.9,100\n"
    "2026-01-01T00:01:00,0,1,26,-60.0,1.0,100\n2026-01-01T00:01:30,1,0,26,-61.0,0.9,100\n"
    "2026-01-01T00:02:00,0,1,26,-60.0,1.0,100\n2026-01-01T00:02:30,1,0,26,-61.0,0.9,100\n"
)
"""A recording of three rounds in the K7 format."""

SUN: Final = "time,irradiance\n0,800\n0.1,0\n0.2,300\n"
FILES: Final = {"sun.csv": SUN, "nodes.csv": NODES, "track.csv": TRACK, "readings.csv": READINGS, "links.k7": LINKS}


@functools.cache
def _special() -> dict[tuple[str, str], Example]:
    """Return the examples of kinds that need parameters, or another base: the rows of examples.table."""
    ((_, rows),) = read_sections(Path(__file__).with_name("examples.table"))
    return {
        (role, kind): Example(base, tuple(lines), {name: FILES[name] for name in FILES if name in " ".join(lines)})
        for role, kind, base, *lines in rows
    }


_FAULT: Final = "at: 9 s, nodes: [0, 1]"


def example_of(role: Role, kind: str, required: tuple[str, ...]) -> Example:
    """Return the example of a kind; its `required` parameters have '...' as values if the kind is a plug-in's."""
    if found := _special().get((role.name, kind)):
        return found
    if role.optional:
        return Example(BASE, (f"{role.listed}: [{{kind: {kind}, {_FAULT}}}]",))
    name = f'"{kind}"' if ":" in kind else kind
    values = ", ".join([f"kind: {name}", *(f"{parameter}: ..." for parameter in required)])
    return Example(BASE, (f"{role.name}: {{{values}}}",))


NOT_LOOKED_UP: Final = "not looked up"
"""The mark of a DOI that was not compared with the record at doi.org."""


class Citation(NamedTuple):
    """A publication that the code cites.

    Attributes:
        key: how the code cites it.
        title: its title.
        venue: where it appeared.
        doi: its DOI; '' if none could be verified.
        looked_up: whether the DOI was compared with the record at doi.org.
    """

    key: str
    title: str
    venue: str
    doi: str = ""
    looked_up: bool = True

    @property
    def mark(self) -> str:
        """The words that follow a DOI which was not looked up; '' for all others."""
        return "" if self.looked_up else f" ({NOT_LOOKED_UP})"

    def text(self) -> str:
        """Return the citation in one line."""
        return f"{self.key}: {self.title}. {self.venue}." + (f" doi:{self.doi}{self.mark}" if self.doi else "")


OTHER_FORMS: Final = {
    "Heinzelman, Chandrakasan, Balakrishnan (2002)": "Heinzelman (2002)",
    "Heinzelman and others (2000)": "Heinzelman (2000)",
    "Jiang, Song, Lin 2013": "Jiang, Song, Lin (2013)",
    "Jiang et al. (2013)": "Jiang, Song, Lin (2013)",
}
"""Other forms in which the code cites a publication."""


@functools.cache
def citations() -> tuple[Citation, ...]:
    """Return every publication that the code cites: the rows of citations.table."""
    ((_, rows),) = read_sections(Path(__file__).with_name("citations.table"))
    padded = ((*row, "", "") for row in rows)  # DOI and mark may be missing
    return tuple(Citation(key, title, venue, doi, mark != NOT_LOOKED_UP) for key, title, venue, doi, mark, *_ in padded)


def cited_in(text: str) -> list[Citation]:
    """Return the publications that a text cites, in the order of their first places."""
    words = " ".join(text.split())
    for form, key in OTHER_FORMS.items():
        words = words.replace(form, key)
    places = {one: words.find(one.key) for one in citations()}
    return sorted((one for one, place in places.items() if place >= 0), key=lambda one: places[one])


def import_line(role: str, kind: str) -> str:
    """Return the line that imports a built-in kind: 'from wsnsim.trackers import Ekf'.

    Raises:
        KeyError: there is no such role or kind.
    """
    paths = {info.kind: info.path for info in ROLES[role].kinds}
    return f"from {package_of(role)} import {import_name(role, kind, paths[kind].partition(':')[2])}"


@dataclass(frozen=True)
class KindInfo:
    """The description of a kind.

    Attributes:
        role: the role's name.
        kind: the kind's name in a scenario.
        purpose: what the role decides.
        idea: the kind in one line.
        paper: the source in short, as tables show it.
        method: the paragraphs of the class's docstring, without its sources.
        notes: the paragraphs that name sources and say what is our choice.
        citations: the publications that are cited, with DOIs.
        parameters: its parameters.
        facts: further (name, text) pairs, such as the columns of a motion model's state.
        import_line: how Python imports the class.
        example: lines of a scenario that use the kind.
        default: whether the kind is taken if a scenario leaves the role out.
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
        return plain


def kinds_named(word: str) -> list[tuple[str, str]]:
    """Return the (role, kind) pairs that a word names: a kind, 'role.kind', a class's name or 'module:Class'.

    Raises:
        UsageError: the word is 'module:Class', and the class is a component of no role.
    """
    if ":" in word:
        return _plugin(word)
    role, dot, name = word.rpartition(".")
    roles = [found for found in ROLES.values() if not dot or role in (found.name, found.plural, found.listed)]
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
    entry, described_role = find(role, kind), ROLES[role]
    part = load_class(entry)
    fields_of(part)  # raises PartError if the class is no component
    summary, method, notes = paragraphs_of(part)
    text = " ".join([entry.paper, *notes, *method])
    idea = summary.rstrip(".") if entry.plugin else entry.idea or summary.rstrip(".")
    required = tuple(field.name for field in dataclasses.fields(part) if field.init and has_no_default(field))
    return KindInfo(
        role=role, kind=kind, purpose=described_role.purpose, idea=idea, paper=entry.paper,
        method=(summary, *method), notes=notes, citations=tuple(cited_in(text)),
        parameters=(*parameters_of(part), *common_parameters(role)),
        facts=tuple(_facts(part, entry.state, entry.messages)),
        import_line=import_line(role, kind)
        if entry in described_role.kinds
        else f"from {part.__module__} import {part.__name__}",
        example=example_of(described_role, kind, required),
        default=kind == described_role.default, plugin=entry.plugin,
    )  # fmt: skip


def _plugin(path: str) -> list[tuple[str, str]]:
    """Return (role, path) for each role of which the class at the path 'module:Class' is a component."""
    from wsnsim.scenario.fields import part_model

    search([""])  # plug-ins may lie in the working directory
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


def paragraphs_of(part: type[Any]) -> tuple[str, tuple[str, ...], tuple[str, ...]]:
    """Return the first paragraph of a class's docstring, the others, and those about sources, also of its bases."""
    each = [
        (owner, " ".join(piece.split()))
        for owner in part.__mro__
        for piece in inspect.cleandoc(vars(owner).get("__doc__") or "").split("\n\n")
    ]
    notes = dict.fromkeys(piece for _, piece in each if piece.startswith(("Source:", "Sources:")))
    first, *others = (piece for owner, piece in each if owner is part)
    return first, tuple(piece for piece in others if piece not in notes), tuple(notes)


def _facts(part: type[Any], state: str, messages: str) -> Iterator[tuple[str, str]]:
    """Yield (name, text) of a class's state columns, components of readings, memory and messages, if it has them."""
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
