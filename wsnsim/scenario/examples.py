"""The scenarios that `wsnsim new` writes, and a minimal scenario of each kind. Tests load them all.

    example_of(ROLES["motion"], "gauss_markov", ()).lines -> ("motion: {kind: gauss_markov}",)

A minimal scenario is the shipped scenario that it extends, its lines, and the files that these name.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from wsnsim.base.files import read_sections
from wsnsim.scenario.registry import Role


def template(name: str, offline: bool = False) -> str:
    """Return the text of a scenario of this name, with a network or without (`offline`)."""
    file = Path(__file__).with_name("templates") / ("offline.yaml" if offline else "tracking.yaml")
    return file.read_text(encoding="utf-8").replace("{name}", name)


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
    files: dict[str, str] = field(default_factory=dict)

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
