"""The pages of the roles: every kind with its parameters, sources and an example."""

from __future__ import annotations

import re
from collections.abc import Iterator

from wsnsim.scenario.kind_info import Citation, KindInfo, kind_info
from wsnsim.scenario.parameter_info import ParameterInfo, common_parameters
from wsnsim.scenario.registry import ROLES, Role
from wsnsim_reference.markdown import code, escaped, fence, generated, table

HEADINGS = ("parameter", "default", "meaning, and *what it takes*")


def pages() -> Iterator[tuple[str, str]]:
    """Yield the name and the text of the page of each role, and of the index."""
    yield "index.md", _index()
    for role in ROLES.values():
        yield f"{role.name}.md", _page(role)


def _index() -> str:
    rows = [
        [f"[{role.name}]({role.name}.md)", escaped(role.purpose), code(role.default or ""), str(len(role.kinds))]
        for role in ROLES.values()
    ]
    toctree = fence("{toctree}", ":hidden:\n\n" + "\n".join(ROLES))
    return generated(
        "Kinds",
        "A scenario names a kind for each of its roles. `wsnsim info KIND` shows the same as these pages, and "
        "`wsnsim list ROLE` the kinds of a role, those of installed plug-ins included.",
        table(("role", "decides", "default", "kinds"), rows),
        toctree,
    )


def _page(role: Role) -> str:
    found = [kind_info(role.name, row.kind) for row in role.kinds]
    rows = [[f"[{one.kind}](#{one.kind})", escaped(one.idea), escaped(one.paper)] for one in found]
    common = _common(role) if common_parameters(role.name) else ""
    return generated(
        f"{role.name}: {escaped(role.purpose)}",
        _keys(role),
        table(("kind", "idea", "source"), rows),
        common,
        *(block for one in found for block in _kind(one)),
    )


def _keys(role: Role) -> str:
    place = f"Key {code(role.name)} of a scenario." if not role.optional else ""
    several = f"{'Several components stand' if not role.optional else 'The components stand'} in a list under the key "
    listed = f"{several}{code(role.listed)}." if role.listed else ""
    default = f"Without it, {code(role.default)} is used." if role.default else ""
    network = "" if role.of_network else "Scenarios without a network use it too."
    plug_in = (
        f"A kind of your own is a class that satisfies the port {code(role.port)}: `kind: mylab.module:Class`, or an "
        f"entry point of the group {code(role.group)} (see [plug-ins](../../plugins.md))."
    )
    return " ".join(piece for piece in (place, listed, default, network, plug_in) if piece)


def _common(role: Role) -> str:
    return f"Every {role.name} has these parameters, beside its own:\n\n" + table(
        HEADINGS, [_row(one) for one in common_parameters(role.name)]
    )


def _kind(one: KindInfo) -> Iterator[str]:
    yield f"## {one.kind}"
    if one.default:
        yield "The default of the role."
    yield from (escaped(paragraph) for paragraph in one.method if paragraph)
    yield from (escaped(paragraph) for paragraph in one.notes)
    if one.citations:
        yield "\n".join(f"- {_citation(citation)}" for citation in one.citations)
    if one.facts:
        yield "\n".join(f"- {escaped(name.capitalize())}: {escaped(text)}" for name, text in one.facts)
    own = [parameter for parameter in one.parameters if not parameter.name.startswith("assumes.")]
    yield table(HEADINGS, [_row(parameter) for parameter in own]) if own else "It has no parameters of its own."
    yield fence("yaml", one.example.text(f"try_{one.kind}"))
    for name, content in one.example.files.items():
        yield f"with a file {code(name)} beside it:\n\n{fence('text', content)}"
    yield fence("python", one.import_line)


def _row(one: ParameterInfo) -> list[str]:
    default = "required" if one.default is None else code(one.default)
    return [code(one.name), default, f"{escaped(one.meaning)}. *{_takes(one.takes)}*"]


def _takes(text: str) -> str:
    """Return what a parameter takes as Markdown; a sign stays beside its number."""
    return re.sub(r"([≥≤]|\\[<>]) ", "\\1\u00a0", escaped(text.replace(" | ", ", ")))


def _citation(one: Citation) -> str:
    doi = f" [doi:{escaped(one.doi)}](https://doi.org/{one.doi}){one.mark}" if one.doi else ""
    return f"{escaped(one.key)}: *{escaped(one.title)}*. {escaped(one.venue)}.{doi}"
