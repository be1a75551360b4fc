"""Who gets a frame, who loses it and to what, who overhears it; each pays, and each is logged.

    Reception(...).resolve(transmission) -> Heard

A radio that is locked on a frame pays for it, whether it can use it or not; one that hears two at once pays for the
time, not twice; one that sends hears nothing.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import simpy

from wsnsim.base.arrays import Bools, Floats, Ints
from wsnsim.base.radio import LinkModel
from wsnsim.base.rng import derive, derive_all, uniforms
from wsnsim.base.tables import CAUSE, EVENT_CAUSE, KIND
from wsnsim.network.event_log import EACH, EventLog, event
from wsnsim.network.nodes import Nodes
from wsnsim.network.radio.counters import Counters, Uses
from wsnsim.network.radio.ideal_medium import EVERYONE
from wsnsim.network.radio.topology import Topology
from wsnsim.network.radio.transmission import Heard, Transmission

RECEIVE, DROP, COLLIDE, OVERHEAR = (KIND[name] for name in ("receive", "drop", "collide", "overhear"))
NONE, RX, OVERHEARD = (EVENT_CAUSE[name] for name in ("none", "rx", "overhear"))
RX_LEDGER, OVERHEARD_LEDGER = CAUSE["rx"], CAUSE["overhear"]
WHOLE: Final = 1.0
NOWHERE: Final = np.False_


class Reception:
    """What frames do at those who may hear them."""

    def __init__(
        self,
        env: simpy.Environment,
        fleet: Nodes,
        journal: EventLog,
        link: LinkModel,
        wiring: Topology,
        counts: Counters,
        key: int,
    ) -> None:
        self._env = env
        self._fleet = fleet
        self._journal = journal
        self._link = link
        self._wiring = wiring
        self._key = key
        self._uses = Uses()
        self.counts = counts

    def resolve(self, one: Transmission) -> Heard:
        """What became of a frame that left whole, at each of its audience."""
        fleet, heard = self._fleet, None
        plain = one.message.to == EVERYONE and self._wiring.sharp and not fleet.disturbed
        hears = None if fleet.all_listen else fleet.hears(one.audience.ids, one.start)
        if plain and (hears is None or hears.all()):
            heard = self._receive_all(one) if one.others is None else self._part(one)
        if heard is None and self._is_simple(one):
            return self._to_one(one, hears)
        return self._sort_out(one, hears) if heard is None else heard

    def _is_simple(self, one: Transmission) -> bool:
        """Whether a frame is for one node, nothing disturbs it, and distance alone decides."""
        addressed = one.message.to != EVERYONE and one.others is None and one.asleep is None
        return addressed and self._wiring.sharp and not self._fleet.disturbed

    def _to_one(self, one: Transmission, hears: Bools | None) -> Heard:
        """Such a frame: one node has it, all others that listen overhear it. What `_sort_out` would find."""
        message, to, ids = one.message, one.message.to, one.audience.ids
        listening = ids if hears is None else ids[hears]
        at = int(np.searchsorted(listening, to))
        got = at < listening.size and int(listening[at]) == to
        if got:
            self._charge_group(one, listening[at : at + 1], [to], WHOLE, RECEIVE, RX)
        others = np.concatenate((listening[:at], listening[at + got :]))
        if others.size:
            self._charge_group(one, others, others.tolist(), WHOLE, OVERHEAR, OVERHEARD)
        in_range = one.audience.index(to) >= 0
        if in_range and not got:
            self._log_each(one, DROP, np.array([to]), 0, 0.0, NONE)
        lives = self._fleet.alive[to]
        got = got and lives
        one.missed = in_range and lives and not got
        if message.packets:
            self.counts.in_range += in_range and lives
            self.counts.delivered += got
        return got

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
            if other.end <= max(other.start, one.start):
                continue
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
        one.missed = bool(spoilt)
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

    def _sort_out(self, one: Transmission, listening: Bools | None) -> Heard:
        """Who got the frame, who lost it and to what, who overheard it; each pays and is logged.

        A broadcast is meant for whoever is awake: those who sleep miss nothing that was theirs. `listening`: who is
        awake of the audience; None: everybody.
        """
        fleet, audience, message = self._fleet, one.audience, one.message
        ids, everyone = audience.ids, message.to == EVERYONE
        hears = fleet.living[ids] if listening is None else listening
        if one.asleep is not None:
            hears = hears & ~np.isin(ids, one.asleep)
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
        if everyone and listening is not None:
            meant = meant & listening
        lost = meant & ~(arrived | collided)
        if everyone:
            lost &= living
        if lost.any():
            self._log_each(one, DROP, ids[lost], 0, 0.0, NONE)
        got &= living
        counts = self.counts
        in_range, delivered = int((meant & living).sum()), int((got & meant).sum())
        one.missed = delivered < in_range
        if message.packets:
            counts.in_range += in_range
            counts.delivered += delivered
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
            if other.end <= max(other.start, one.start):
                continue
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
        step = self._journal.step
        key = derive(self._key, one.source, step, self._uses.next(one.source, step))
        drawn = uniforms(derive_all(key, audience.ids), 0)
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
            event(self._env.now, self._journal.step, message.target, EACH, kind, message.code, one.number,
                  message.sequence, one.source, message.packets, bits, joules, cause),
            nodes,
        )  # fmt: skip
