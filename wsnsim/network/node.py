"""A sensor node's life, as one SimPy process, born at its first wake.

Asleep, it waits on one event: the target's sound, or a frame that gives it a role. Awake it senses, stands for
election, follows or leads; it sleeps again when it neither senses nor has a role, and dies when its charge ends, in
the middle of whatever it did.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import Any

import simpy

from wsnsim.base.radio import Mode
from wsnsim.base.requests import PACKET_BITS, Parcel
from wsnsim.network.clusters.handover import Crew, Handover
from wsnsim.network.clusters.head_life_cycle import tenure
from wsnsim.network.clusters.moving_head import pursue
from wsnsim.network.clusters.standing_cluster import lead
from wsnsim.network.clusters.track import Election, Track
from wsnsim.network.run_context import RunContext

TARGET, FRAME, CALL = "target", "frame", "call"
"""What makes a node wake, or sleep again."""
Life = Generator[simpy.Event, Any, None]
Order = Callable[[], Any]


class Node:
    """One node. `senses` and `serves` are the targets it hears, and those it has a role for; `watches` those for which
    it stays awake for a while.
    """

    def __init__(self, stage: RunContext, crew: Crew, index: int) -> None:
        self.index = index
        self.senses: set[int] = set()
        self.serves: set[int] = set()
        self.watches: dict[int, float] = {}
        self._stage = stage
        self._crew = crew
        self._awake = False
        self._orders: list[tuple[int, str, Order]] = []
        self._call = stage.env.event()
        self._duties: list[simpy.Process] = []
        self._process = stage.env.process(self._life())

    def hear_target(self, target: int) -> None:
        """The target has come within sensing range."""
        self._tell(target, TARGET, lambda: self.senses.add(target))

    def lose_target(self, target: int) -> None:
        """The target has left the sensing range."""
        self._tell(target, TARGET, lambda: self.senses.discard(target))

    def serve(self, target: int) -> None:
        """A frame has made the node a member, or head."""
        self._tell(target, FRAME, lambda: self.serves.add(target))

    def dismiss(self, target: int) -> None:
        """The cluster has dissolved."""
        self._tell(target, FRAME, lambda: self.serves.discard(target))

    def watch(self, target: int, until: float, why: str = FRAME) -> None:
        """Stay awake for a target until then, at least, because of a frame or a call."""
        known = self.watches.get(target)
        if known is not None and known >= until:
            return
        self.watches[target] = until
        if known is None:
            self._tell(target, why, _nothing)
            self._look_again(target, until)

    def relax(self, target: int) -> None:
        """Need not stay awake for a target any longer."""
        if self.watches.pop(target, None) is not None:
            self._tell(target, TARGET, _nothing)

    def _look_again(self, target: int, until: float) -> None:
        """Fall back to the schedule, unless it has been told to stay for longer."""
        event = self._stage.env.timeout(max(until - self._stage.env.now, 0.0))
        assert event.callbacks is not None
        event.callbacks.append(lambda _: self._watched(target, until))

    def _watched(self, target: int, until: float) -> None:
        known = self.watches.get(target)
        if known is None:
            return
        if known > until:
            self._look_again(target, known)
        else:
            self.relax(target)

    def take_lead(self, track: Track, mission: Handover) -> None:
        """Lead a track from now on: a duty of its own, so that a death in this very instant ends it too."""
        self.serve(track.target)
        life = pursue if self._stage.parts.clusters.moves else lead
        self._begin(tenure(self._stage, self._crew, track, self.index, mission, life))

    def stand(self, track: Track, election: Election) -> None:
        """Stand for election."""
        self._begin(self._stand(track, election))

    def die(self) -> None:
        """The node is dead or down: every process of it ends; the one that runs now sees it for itself."""
        for process in (self._process, *self._duties):
            if process.is_alive and process is not self._stage.env.active_process:
                process.interrupt("death")

    def _tell(self, target: int, why: str, order: Order) -> None:
        if not self._stage.fleet.alive[self.index]:
            return
        self._orders.append((target, why, order))
        if not self._call.triggered:
            self._call.succeed()

    def _begin(self, duty: Life) -> None:
        self._duties = [process for process in self._duties if process.is_alive]
        self._duties.append(self._stage.env.process(duty))

    def _life(self) -> Life:
        try:
            while True:
                yield self._call
                self._call = self._stage.env.event()
                orders, self._orders = self._orders, []
                for _, _, order in orders:
                    order()
                self._wake_or_sleep(*orders[0][:2])
                if not self._stage.fleet.alive[self.index]:
                    return
        except simpy.Interrupt:
            self._awake = False

    def _wake_or_sleep(self, target: int, why: str) -> None:
        busy = bool(self.senses or self.serves or self.watches)
        if busy != self._awake:
            self._awake = busy
            fleet = self._stage.fleet
            if fleet.is_scheduled_awake(self.index):
                self._stage.log("stay" if busy else "resume", target, self.index, why if busy else "schedule")
            else:
                why = "schedule" if fleet.follows_schedules and not busy else why
                self._stage.log("wake" if busy else "sleep", target, self.index, why)
                if busy:
                    self._crew.woke(self.index, target, why != TARGET)
            fleet.set_mode(self.index, Mode.AWAKE if busy else fleet.rest_of(self.index))

    def _stand(self, track: Track, election: Election) -> Life:
        """Broadcast the strength of the own reading; the winner of an election that fills a vacancy takes the lead."""
        stage = self._stage
        parcel = Parcel(election.strengths[self.index], 1, PACKET_BITS, "strength")
        try:
            event, (frame,) = stage.air.broadcast([self.index], [parcel], track.target)
            yield event
            election.report(self.index, frame.received)
            winner = yield election.closed
        except simpy.Interrupt:
            return
        if winner == self.index and election.fills_vacancy and stage.fleet.alive[self.index]:
            stage.log("elect", track.target, self.index)
            readings = election.readings_at(self.index)
            mission = Handover(election.step, readings=readings, elected=True, at_once=True)
            self._crew.appoint(track, self.index, mission)


def _nothing() -> None:
    """An order that changes nothing but makes the node look at what it has to do."""
