"""The roles of a scenario, and the built-in kinds of each: the rows of kinds.table.

    ROLES: {role name: Role}    AT_TOP: {key at the top of a scenario: Role}

No class is imported here: `wsnsim list` shows this table.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from wsnsim.base.data_tables import read_sections

OFFLINE_ROLES: Final = ("prior", "deploy", "motion", "sensor", "detection", "fault", "tracker")
TARGET_ROLES: Final = (
    "prior", "motion", "sensor", "wakeup", "clusters", "acquire", "detection", "sink", "tracker",
)  # fmt: skip


@dataclass(frozen=True)
class Kind:
    """The description of one kind.

    Attributes:
        kind: Name in a scenario.
        path: Module and class, 'package.module:Class'.
        idea: Description in one line.
        paper: Source.
        state: What a tracker keeps between steps, and where.
        messages: What a tracker sends in a step.
        variants: The options of a tracker that change the method.
        plugin: Name and version of the package that adds the kind; '' if it comes with wsnsim.
    """

    kind: str
    path: str
    idea: str
    paper: str = ""
    state: str = ""
    messages: str = ""
    variants: str = ""
    plugin: str = ""


@dataclass(frozen=True)
class Role:
    """A role of a scenario.

    Attributes:
        name: the role's name, and its key in a scenario.
        purpose: what the role decides.
        port: name of the Protocol that its components satisfy.
        default: the kind of a role that is left out; None: the role must be given.
        kinds: the kinds that come with wsnsim.
        listed: the key of a list of several components, instead of one under the role's name; '' if not allowed.
        optional: the components stand in a list only, and the list may be empty.
    """

    name: str
    purpose: str
    port: str
    default: str | None
    kinds: tuple[Kind, ...]
    listed: str = ""
    optional: bool = False

    @property
    def of_network(self) -> bool:
        """Whether only scenarios with a network use the role."""
        return self.name not in OFFLINE_ROLES

    @property
    def of_targets(self) -> bool:
        """Whether only scenarios with targets use the role."""
        return self.name in TARGET_ROLES

    @property
    def offline_default(self) -> str | None:
        """The kind of the role in a scenario without a network. Default deployment: one node at the origin."""
        return "anchors" if self.name == "deploy" else self.default

    @property
    def keys(self) -> tuple[str, ...]:
        """The keys of a scenario under which components of the role stand."""
        return tuple(key for key in ("" if self.optional else self.name, self.listed) if key)

    @property
    def plural(self) -> str:
        """The plural of the role's name: trackers, energies, clusters."""
        if self.name == "energy":
            return "energies"
        return self.name if self.name.endswith("s") else self.name + "s"

    @property
    def group(self) -> str:
        """The entry-point group through which packages add kinds to the role."""
        return f"wsnsim.{self.plural}"


def _read() -> dict[str, Role]:
    """Return every role by name."""
    found = {}
    for (name, *cells), rows in read_sections(Path(__file__).with_name("kinds.table")):
        purpose, port, default, listed, only, *_ = (*cells, "", "", "")
        kinds = tuple(Kind(*row) for row in rows)
        found[name] = Role(name, purpose, port, default or None, kinds, listed, only == "only")
    return found


ROLES: Final = _read()
AT_TOP: Final = {key: role for role in ROLES.values() for key in role.keys}
"""The role of each key at the top of a scenario."""


@dataclass(frozen=True)
class Scope:
    """Which roles a scenario uses: with or without a network, with or without targets."""

    network: bool = True
    targets: bool = True

    def uses(self, role: Role) -> bool:
        """Return whether a run builds components of the role."""
        return (self.network or not role.of_network) and (self.targets or not role.of_targets)

    def default(self, role: Role) -> str | None:
        """Return the kind of a role that is left out; None: the role must be given."""
        return role.default if self.network else role.offline_default
