"""Events, numbers and nodes in words.

row_in_words(row);   energy_in_words(joules);   counted(3, 'packet');   named(nodes);   StepContext: how a step is told
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

from wsnsim.analysis.event_groups import LoggedEvent

NAMES: Final = 24
"""How many nodes a sentence names (our choice)."""
PARCELS: Final = {
    "announce": ("its announcement", "their announcements"),
    "join": ("its request to join", "their requests to join"),
    "strength": ("the strength of its reading", "the strengths of their readings"),
    "wake": ("a call to wake", "calls to wake"),
    "track": ("its call to track", "their calls to track"),
    "request": ("its request for readings", "their requests for readings"),
    "detection": ("that it had detected a target", "that they had detected a target"),
    "": ("a message", "messages"),
}
"""What a parcel is called of one sender and of several; others are called what the tracker calls them."""
REASONS: Final = {"no_path": "there is no path", "no_channel": "the channel was never free"}
LOSSES: Final = {
    "empty_region": "no node stands where the target is expected",
    "nobody_woken": "nobody was woken where the target was expected",
    "no_readings": "no readings came",
    "no_successor": "there was nobody to hand over to",
    "handover_lost": "the belief was lost on its way to the next head",
    "head_died": "the head died",
    "expired": "the message that was to wake nodes expired on its way",
}
"""Why a track was lost."""
SPEECH: Final = {
    "wake": (
        "woke",
        {
            "frame": ", called by a frame",
            "target": ", as the target came into range",
            "call": ", called on the wake-up radio",
            "schedule": ", as scheduled",
        },
    ),
    "sleep": (
        "went to sleep",
        {"frame": ", dismissed", "target": ", as the target had left", "schedule": ", as scheduled"},
    ),
    "stay": ("stayed awake", {"frame": ", having something to do", "target": ", as the target is in range"}),
    "resume": ("went back to the schedule, awake", {}),
    "compute": ("computed", {}),
    "sense": ("sensed", {"nothing": " nothing, though told to"}),
    "drop": ("dropped a message", {"expired": " that had expired"}),
    "crash": ("crashed", {}),
    "restart": ("restarted", {}),
    "death": ("died: the charge is gone", {}),
}
"""Verbs of acts without another node, and what follows them for a word of the event."""
OF_NODES: Final = ("join", "strength", "wake", "handover", "report")
"""Parcels that not only members send to a head."""


class Sentence(NamedTuple):
    """A sentence, and from when to when it holds, in s of simulated time."""

    time: float
    until: float
    text: str


@dataclass(frozen=True, slots=True)
class StepContext:
    """How it is told: who is called a head, and how many similar messages are told one by one before they are summed.

    `issued`: what to say of the estimates issued, by (target, time). `several`: whether targets need their numbers.
    """

    heads: frozenset[int]
    limit: int
    issued: dict[tuple[int, float], str]
    several: bool = False

    def node(self, number: int) -> str:
        """A node by its role."""
        return f"{'head' if number in self.heads else 'node'} {number}"

    def of(self, target: int) -> str:
        """Which target a sentence is about, where there are several."""
        return f" (target {target})" if self.several and target >= 0 else ""


def row_in_words(row: LoggedEvent) -> str:
    """One event, with all that it says."""
    joules = f"{energy_in_words(row.joules)} ({row.cause})" if row.joules else ""
    facts = [
        f"'{row.what}'" if row.what else "",
        f"peer {row.peer}" if row.peer >= 0 else "to everyone" if row.kind in ("send", "relay") else "",
        f"target {row.target}" if row.target >= 0 else "",
        f"frame {row.frame} of message {row.sequence}" if row.frame else "",
        counted(row.packets, "packet") if row.packets else "",
        counted(row.bits, "bit") if row.bits else "",
        joules,
    ]
    who = f"node {row.node}" if row.node >= 0 else "the target" if row.kind in ("leave", "return") else "nobody"
    return f"{who}: {row.kind} {', '.join(filter(None, facts))}".rstrip()


def energy_in_words(joules: float) -> str:
    """Joules with three digits and the fitting prefix."""
    if joules == 0:
        return "0 J"
    for factor, unit in ((1.0, "J"), (1e-3, "mJ"), (1e-6, "uJ")):
        if abs(joules) >= 0.9995 * factor:
            return f"{joules / factor:.3g} {unit}" if abs(joules) < 999.5 * factor else f"{joules / factor:,.0f} {unit}"
    return f"{joules / 1e-9:.3g} nJ"


def counted(count: int, word: str) -> str:
    """'1 packet', '2 packets', '9,024 bits'."""
    return f"{count:,} {word}{'' if count == 1 else 's'}"


def named(nodes: Sequence[int]) -> str:
    """The nodes one by one, as long as there are not too many."""
    shown = ", ".join(str(node) for node in nodes[:NAMES])
    return shown + (f" and {len(nodes) - NAMES:,} more" if len(nodes) > NAMES else "")
