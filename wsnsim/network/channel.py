"""The air when it takes time: frames overlap, collide, fade, are overheard, and keep nodes from hearing others.

    channel.is_busy(node)                            clear channel assessment
    channel.transmit(node, message, owner, landed)   on the air after the turnaround; `landed(transmission, heard)`

A frame costs one event, its end, however many hear it. Nothing is done for a pair of frames that do not overlap in
time within twice the range, which is nearly every pair. Every frame begins one turnaround after it was decided on, so
frames are met in the order in which they begin. A radio that is locked on a frame pays for it, whether it can use it
or not; one that hears two at once pays for the time, not twice.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np
import simpy

from wsnsim.base.arrays import Bools, Floats, Ints
from wsnsim.base.ports import Draws, EnergyModel, FramedMac, LinkModel
from wsnsim.base.rng import derive, derive_all, uniforms
from wsnsim.base.tables import CAUSE, EVENT_CAUSE, KIND
from wsnsim.network.counts import Counts
from wsnsim.network.fleet import Fleet
from wsnsim.network.journal import EACH, Journal
from wsnsim.network.medium import EVERYONE
from wsnsim.network.wiring import Audience, Wiring

SEND, RECEIVE, DROP = KIND["send"], KIND["receive"], KIND["drop"]
COLLIDE, OVERHEAR = KIND["collide"], KIND["overhear"]
NONE, TX, RX, OVERHEARD = (EVENT_CAUSE[name] for name in ("none", "tx", "rx", "overhear"))
RX_LEDGER, OVERHEARD_LEDGER, SWITCH = CAUSE["rx"], CAUSE["overhear"], CAUSE["switch"]
WHOLE: Final = 1.0
NOWHERE: Final = np.False_
FREE: Final = (0.0, 0.0, 0.0, 0.0)


class Message:
    """One frame that a MAC wants on the air: `bits` there, `packets` inside, what the log calls it.

    `sends`: how often it was on the air; `retries`: of these, after the first.
    """

    __slots__ = ("bits", "code", "kind", "packets", "retries", "sends", "sequence", "target", "to")

    def __init__(
        self, to: int, bits: int, packets: int = 1, target: int = -1, code: int = 0, kind: int = SEND, sequence: int = 0
    ) -> None:
        self.to = to
        self.bits = bits
        self.packets = packets
        self.target = target
        self.code = code
        self.kind = kind
        self.sequence = sequence
        self.sends = 0
        self.retries = 0


class Transmission:
    """A frame on the air from `start` to `end`. `others`: those that overlap it. `cut`: its sender fell silent."""

    __slots__ = (
        "asleep",
        "audience",
        "costs",
        "cut",
        "end",
        "landed",
        "message",
        "number",
        "others",
        "owner",
        "source",
        "start",
    )

    def __init__(
        self, source: int, message: Message, audience: Audience, number: int, start: float, end: float,
        owner: Any, landed: Landed,
    ) -> None:  # fmt: skip
        self.source = source
        self.message = message
        self.audience = audience
        self.number = number
        self.start = start
        self.end = end
        self.owner = owner
        self.landed = landed
        self.others: list[Transmission] | None = None
        self.cut = False
        self.asleep: Ints | None = None
        self.costs = FREE


Heard = Any
"""Of a broadcast, the ids (n,) that received it; of a unicast, whether its destination did."""
Landed = Callable[[Transmission, Heard], None]


class Channel:
    """The shared air. `window`: for how long a channel is assessed, in s."""

    def __init__(
        self,
        env: simpy.Environment,
        fleet: Fleet,
        journal: Journal,
        energy: EnergyModel,
        link: LinkModel,
        wiring: Wiring,
        mac: FramedMac,
        counts: Counts,
        key: int,
        window: float,
    ) -> None:
        self._env = env
        self._fleet = fleet
        self._journal = journal
        self._energy = energy
        self._link = link
        self._wiring = wiring
        self._mac = mac
        self._key = key
        self._window = window
        self._turnaround = mac.turnaround
        self._turning = 2.0 * energy.turnaround() if isinstance(energy, Draws) else 0.0
        self._draws: dict[int, int] = {}
        self._cells: dict[tuple[int, int], list[Transmission]] = {}
        self._around: dict[int, tuple[list[Transmission], ...]] = {}
        self._sending: dict[int, Transmission] = {}
        self._side = 2.0 * max(link.audible, 1e-9)
        self._costs: dict[int, tuple[float, float, float, float]] = {}
        self._links: dict[int, Ints] | None = None
        self._sent: dict[int, int] = {}
        self.counts = counts

    def is_busy(self, node: int) -> bool:
        """Whether a node hears anything in the window that ends now, or sends itself."""
        fleet = self._fleet
        if fleet.disturbed and fleet.jammed[node]:
            return True
        now = self._env.now
        since = now - self._window
        for cell in self._around.get(node) or self._near(node):
            for one in cell:
                if one.end > since and (one.source == node or (one.start < now and self._sensed(one, node))):
                    return True
        return False

    def transmit(
        self, source: int, message: Message, owner: Any, landed: Landed, asleep: Ints | None = None
    ) -> Transmission:
        """Put a frame on the air, one turnaround from now. A sender whose charge does not last is cut short.

        `asleep`: nodes that have the radio off because they know that the frame is not for them.
        """
        env, counts = self._env, self.counts
        now = env.now
        start = now + self._turnaround
        costs = self._cost(message, source)
        counts.numbers += 1
        end = start + costs[3]
        left, joules = self._fleet.left(source), costs[0] + costs[1]
        if joules >= left:
            end = start + costs[3] * left / joules
        one = Transmission(source, message, self._wiring.audience(source), counts.numbers, start, end, owner, landed)
        one.costs, one.asleep = costs, asleep
        near = self._around.get(source) or self._near(source)
        for cell in near:
            for other in cell:
                if other.end > start and self._fleet.distance(source, other.source) <= self._side:
                    _meet(one, other)
        own = near[0]
        if own and own[0].end <= now - self._window:
            own[:] = [other for other in own if other.end > now - self._window]
        own.append(one)
        self._sending[source] = one
        event = env.timeout(end - now, one)
        event.callbacks.append(self._land)
        return one

    def silence(self, node: int) -> None:
        """A node falls silent, whatever it was sending: what is on the air so far is paid, and nobody can use it."""
        one = self._sending.pop(node, None)
        if one is None or one.cut:
            return
        one.cut = True
        share = min(max((self._env.now - one.start) / max(one.end - one.start, 1e-12), 0.0), 1.0)
        self._pay(one, share)

    def count_links(self) -> None:
        """Keep count of every link's frames from now on."""
        self._links = {}

    def link_rows(self) -> dict[str, Any]:
        """The columns of the table `links`: every link of a node that sent."""
        links = self._links or {}
        sources = sorted(links)
        audiences = [self._wiring.audience(source) for source in sources]
        repeats = [len(audience.listed) for audience in audiences]
        nothing = np.zeros(0)
        ids = np.concatenate([nothing.astype(np.int64), *(audience.ids for audience in audiences)])
        source = np.repeat(np.array(sources, dtype=np.int64), repeats)
        apart = self._fleet.positions[source] - self._fleet.positions[ids]
        return {
            "source": source,
            "node": ids,
            "distance": np.sqrt((apart**2).sum(axis=1)),
            "power": np.concatenate([nothing, *(audience.powers for audience in audiences)]),
            "sent": np.repeat(np.array([self._sent[one] for one in sources], dtype=np.int64), repeats),
            "received": np.concatenate([nothing.astype(np.int64), *(links[one] for one in sources)]),
        }

    def _near(self, node: int) -> tuple[list[Transmission], ...]:
        """What is on the air in the cell of a node, first, and in the eight about it."""
        found = self._around.get(node)
        if found is None:
            column, row = int(self._fleet.x[node] // self._side), int(self._fleet.y[node] // self._side)
            about = [(0, 0), *((i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if (i, j) != (0, 0))]
            found = tuple(self._cells.setdefault((column + i, row + j), []) for i, j in about)
            self._around[node] = found
        return found

    def _sensed(self, one: Transmission, node: int) -> bool:
        at = one.audience.index(node)
        return at >= 0 and bool(one.audience.senses[at])

    def _cost(self, message: Message, source: int) -> tuple[float, float, float, float]:
        """Joules of sending (electronics, amplifier) and of receiving, and the airtime; a broadcast goes to reach."""
        bits = message.bits
        known = self._costs.get(bits)
        if known is None:
            known = self._costs[bits] = (
                *self._energy.transmit(bits, self._fleet.reach),
                self._energy.receive(bits),
                self._mac.airtime(bits),
            )
        if message.to == EVERYONE:
            return known
        return *self._energy.transmit(bits, self._fleet.distance(source, message.to)), known[2], known[3]

    def _land(self, event: simpy.Event) -> None:
        """A frame has ended: everybody pays, and who heard it is told to its MAC."""
        one: Any = event.value
        message, source = one.message, one.source
        if self._sending.get(source) is one:
            del self._sending[source]
        if one.cut or not self._pay(one, WHOLE):
            one.cut = True
            one.landed(one, _nobody(message))
            return
        fleet = self._fleet
        heard: Heard | None = None
        if message.to == EVERYONE and self._wiring.sharp and fleet.all_listen and not fleet.disturbed:
            heard = self._receive_all(one) if one.others is None else self._part(one)
        if heard is None:
            heard = self._sort_out(one)
        if self._links is not None and message.to == EVERYONE:
            self._count(one, heard)
        one.landed(one, heard)

    def _pay(self, one: Transmission, share: float) -> bool:
        """Charge and log the sending of a share of a frame; whether it left whole."""
        fleet, message, source = self._fleet, one.message, one.source
        electronics, amplifier, _, airtime = one.costs
        bits = message.bits if share == WHOLE else int(message.bits * share)
        if share != WHOLE:
            electronics, amplifier, airtime = electronics * share, amplifier * share, airtime * share
        if bits == 0 or not fleet.alive[source]:
            return False
        sent = fleet.spend_transmit(source, electronics, amplifier, bits, airtime)
        joules = (electronics + amplifier) * sent / bits
        self._journal.add(
            (self._env.now, self._journal.step, message.target, source, message.kind, message.code, one.number,
             message.sequence, message.to, message.packets, sent, joules, TX)
        )  # fmt: skip
        if self._turning and fleet.alive[source]:
            fleet.spend(source, SWITCH, self._turning)
        return sent == message.bits and bool(fleet.alive[source])

    def _receive_all(self, one: Transmission) -> Heard | None:
        """The common case: nothing disturbs a broadcast, and everybody lives. None if somebody may die of it."""
        message, audience = one.message, one.audience
        _, _, joules, airtime = one.costs
        count = len(audience.listed)
        if not self._fleet.can_all_receive(audience.ids, audience.listed, joules):
            return None
        if count:
            self._fleet.receive_all(audience.ids, audience.listed, joules, RX_LEDGER, airtime)
            self._log_each(one, RECEIVE, audience.ids, message.bits, joules, RX)
        self.counts.in_range += count
        self.counts.delivered += count
        return audience.ids

    def _part(self, one: Transmission) -> Heard | None:
        """A broadcast that overlaps others, where distance alone decides: whom they spoil it for, and who has it.

        What `_sort_out` would find, in a tenth of its time. None if somebody may die of it.
        """
        audience = one.audience
        spoilt: dict[int, float] = {}
        for other in one.others or ():
            members, sender = other.audience.members, other.source
            until = other.end if other.end <= one.end and not other.cut else one.start
            for node in audience.listed:
                if node in members:
                    spoilt[node] = max(spoilt.get(node, one.start), until)
                elif node == sender:
                    spoilt[node] = one.end
        if not self._fleet.can_all_receive(audience.ids, audience.listed, one.costs[2]):
            return None
        counts, lasts = self.counts, one.end - one.start
        counts.in_range += len(audience.listed)
        counts.collided += len(spoilt)
        counts.delivered += len(audience.listed) - len(spoilt)
        groups: dict[float, list[int]] = {}
        for node, until in spoilt.items():
            groups.setdefault((one.end - until) / lasts, []).append(node)
        for share, nodes in groups.items():
            self._charge_group(one, np.array(nodes), nodes, share, COLLIDE, RX)
        if not spoilt:
            heard, listed = audience.ids, audience.listed
        else:
            listed = [node for node in audience.listed if node not in spoilt]
            heard = np.array(listed, dtype=np.int64)
        if listed:
            self._charge_group(one, heard, listed, WHOLE, RECEIVE, RX)
        return heard

    def _sort_out(self, one: Transmission) -> Heard:
        """Who got the frame, who lost it and to what, who overheard it; each pays and is logged."""
        fleet, audience, message = self._fleet, one.audience, one.message
        ids, everyone = audience.ids, message.to == EVERYONE
        hears = fleet.listening[ids]
        if one.asleep is not None:
            hears &= ~np.isin(ids, one.asleep)
        quiet = one.others is None and not fleet.disturbed
        hit, interference, share = (None, None, None) if quiet else self._disturbances(one)
        arrived = hears if hit is None else hears & ~hit
        expected = self._wiring.reliable(audience, message.bits)
        if not self._wiring.sharp or fleet.disturbed:
            arrived = arrived & self._survives(one, interference)
        collided: Any = NOWHERE
        if hit is not None and interference is not None:
            collided = hears & ~arrived & (hit | (interference > 0)) & expected
        meant = expected if everyone else ids == message.to
        got = arrived if everyone else arrived & meant
        self._charge(one, got, share, RECEIVE, RX)
        if collided is not NOWHERE:
            self._charge(one, collided & meant, share, COLLIDE, RX)
        if not everyone:
            self._charge(one, (arrived | collided) & ~meant, share, OVERHEAR, OVERHEARD)
        living = fleet.living[ids]
        lost = meant & ~(arrived | collided)
        if everyone:
            lost &= living
        if lost.any():
            self._log_each(one, DROP, ids[lost], 0, 0.0, NONE)
        got &= living
        counts = self.counts
        counts.in_range += int((meant & living).sum())
        counts.delivered += int((got & meant).sum())
        if collided is not NOWHERE:
            counts.collided += int((collided & meant).sum())
        return ids[got] if everyone else bool(got.any())

    def _disturbances(self, one: Transmission) -> tuple[Bools, Floats, Floats]:
        """What the others do at each of the audience.

        hit: the frame is lost there; interference, in mW, where a frame may survive it; share: of the airtime, what
        the radio has not paid for already: nothing where it was sending itself.
        """
        fleet, audience, captures = self._fleet, one.audience, self._link.captures
        ids = audience.ids
        hit, interference = np.zeros(ids.size, dtype=np.bool_), np.zeros(ids.size)
        paid_until = np.full(ids.size, one.start)
        for other in one.others or ():
            here, there = audience.common(other.audience)
            if captures:
                interference[here] += 10.0 ** (other.audience.powers[there] / 10.0)
            else:
                hit[here] = True
            if other.end <= one.end and not other.cut:
                paid_until[here] = np.maximum(paid_until[here], other.end)
            at = audience.index(other.source)
            if at >= 0:
                hit[at], paid_until[at] = True, one.end
        if fleet.disturbed:
            hit |= fleet.jammed[ids] | fleet.jammed[one.source]
        return hit, interference, (one.end - paid_until) / (one.end - one.start)

    def _survives(self, one: Transmission, interference: Floats | None) -> Bools:
        """Draw for each of the audience whether the frame arrives in spite of noise and interference."""
        fleet, audience, bits = self._fleet, one.audience, one.message.bits
        if interference is not None and interference.any():
            chances = self._link.reception(audience.powers, bits, interference)
        else:
            chances = self._wiring.chances(audience, bits)
        if fleet.disturbed:
            chances = chances * (1.0 - fleet.loss[one.source]) * (1.0 - fleet.loss[audience.ids])
        count = self._draws[one.source] = self._draws.get(one.source, 0) + 1
        drawn = uniforms(derive_all(derive(self._key, one.source, count), audience.ids), 0)
        return np.asarray(drawn >= 1.0 - chances)

    def _charge(self, one: Transmission, chosen: Bools, shares: Floats | None, kind: int, cause: int) -> None:
        """Charge and log the chosen of the audience for the share of the frame that they listened to; None: for all."""
        nodes = one.audience.ids[chosen]
        if not nodes.size:
            return
        if shares is None:
            self._charge_group(one, nodes, nodes.tolist(), WHOLE, kind, cause)
            return
        parts = shares[chosen]
        for share in np.unique(parts).tolist():
            group = nodes[parts == share]
            self._charge_group(one, group, group.tolist(), share, kind, cause)

    def _charge_group(
        self, one: Transmission, nodes: Ints, listed: list[int], share: float, kind: int, cause: int
    ) -> None:
        """Charge and log nodes (given twice: as array and list) for the same share of a frame."""
        fleet, ledger = self._fleet, RX_LEDGER if cause == RX else OVERHEARD_LEDGER
        heard, joules, airtime = int(one.message.bits * share), one.costs[2] * share, one.costs[3] * share
        if heard == 0:
            self._log_each(one, kind, nodes, 0, 0.0, NONE)
        elif fleet.can_all_receive(nodes, listed, joules):
            fleet.receive_all(nodes, listed, joules, ledger, airtime)
            self._log_each(one, kind, nodes, heard, joules, cause)
        else:
            for node in listed:
                paid = fleet.spend_receive(node, joules, heard, ledger, airtime)
                spent = joules * paid / heard
                whole = fleet.alive[node]
                self._log_each(one, kind if whole else DROP, np.array([node]), paid, spent, cause if paid else NONE)

    def _log_each(self, one: Transmission, kind: int, nodes: Ints, bits: int, joules: float, cause: int) -> None:
        message = one.message
        self._journal.add_all(
            (self._env.now, self._journal.step, message.target, EACH, kind, message.code, one.number,
             message.sequence, one.source, message.packets, bits, joules, cause),
            nodes,
        )  # fmt: skip

    def _count(self, one: Transmission, heard: Ints) -> None:
        """Count a broadcast on each of its links."""
        assert self._links is not None
        source, audience = one.source, one.audience
        row = self._links.get(source)
        if row is None:
            row = self._links[source] = np.zeros(audience.ids.size, dtype=np.int64)
        self._sent[source] = self._sent.get(source, 0) + 1
        if heard is audience.ids:
            row += 1
        else:
            row[np.searchsorted(audience.ids, heard)] += 1


def _meet(one: Transmission, other: Transmission) -> None:
    """Two frames overlap in time."""
    if one.others is None:
        one.others = []
    if other.others is None:
        other.others = []
    one.others.append(other)
    other.others.append(one)


def _nobody(message: Message) -> Heard:
    return np.zeros(0, dtype=np.int64) if message.to == EVERYONE else False
