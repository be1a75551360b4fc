"""A sensor node's life, as one SimPy process, born at its first wake.

Asleep, it waits on one event: the target's sound, or a frame that gives it a role. Awake it senses, stands for
election, follows or leads; it sleeps again when it neither senses nor has a role, and dies when its charge ends, in
the middle of whatever it did.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import Any

import simpy

from wsnsim.base.asks import PACKET_BITS, Parcel
from wsnsim.base.radio import Mode
from wsnsim.network.lead import lead
from wsnsim.network.mission import Crew, Mission
from wsnsim.network.stage import Stage
from wsnsim.network.track import Election, Track

Life = Generator[simpy.Event, Any, None]
Order = Callable[[], Any]


class Node:
    """One node. `senses` and `serves` are the targets it hears, and those it has a role for."""

    def __init__(self, stage: Stage, crew: Crew, index: int) -> None:
        self.index = index
        self.senses: set[int] = set()
        self.serves: set[int] = set()
        self._stage = stage
        self._crew = crew
        self._awake = False
        self._orders: list[tuple[int, bool, Order]] = []
        self._call = stage.env.event()
        self._duties: list[simpy.Process] = []
        self._process = stage.env.process(self._life())

    def hear_target(self, target: int) -> None:
        """The target has come within sensing range."""
        self._tell(target, False, lambda: self.senses.add(target))

    def lose_target(self, target: int) -> None:
        """The target has left the sensing range."""
        self._tell(target, False, lambda: self.senses.discard(target))

    def serve(self, target: int) -> None:
        """A frame has made the node a member, or head."""
        self._tell(target, True, lambda: self.serves.add(target))

    def dismiss(self, target: int) -> None:
        """The cluster has dissolved."""
        self._tell(target, True, lambda: self.serves.discard(target))

    def take_lead(self, track: Track, mission: Mission) -> None:
        """Lead a track from now on: a duty of its own, so that a death in this very instant ends it too."""
        self.serve(track.target)
        self._begin(lead(self._stage, self._crew, track, self.index, mission))

    def stand(self, track: Track, election: Election) -> None:
        """Stand for election."""
        self._begin(self._stand(track, election))

    def die(self) -> None:
        """The node is dead or down: every process of it ends; the one that runs now sees it for itself."""
        for process in (self._process, *self._duties):
            if process.is_alive and process is not self._stage.env.active_process:
                process.interrupt("death")

    def _tell(self, target: int, by_frame: bool, order: Order) -> None:
        if not self._stage.fleet.alive[self.index]:
            return
        self._orders.append((target, by_frame, order))
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

    def _wake_or_sleep(self, target: int, by_frame: bool) -> None:
        busy = bool(self.senses or self.serves)
        if busy != self._awake:
            self._awake = busy
            self._stage.log("wake" if busy else "sleep", target, self.index, "frame" if by_frame else "target")
            if busy:
                self._crew.woke(self.index, target, by_frame)
            self._stage.fleet.set_mode(self.index, Mode.AWAKE if busy else Mode.DORMANT)

    def _stand(self, track: Track, election: Election) -> Life:
        """Broadcast the strength of the own reading; the winner of an election that fills a vacancy takes the lead."""
        stage = self._stage
        parcel = Parcel(election.strengths[self.index], 1, PACKET_BITS, "strength")
        try:
            event, (frame,) = stage.air.broadcast([self.index], [parcel], track.target)
            yield event
            election.report(self.index, frame.heard)
            winner = yield election.closed
        except simpy.Interrupt:
            return
        if winner == self.index and election.fills_vacancy and stage.fleet.alive[self.index]:
            stage.log("elect", track.target, self.index)
            readings = election.readings_at(self.index)
            mission = Mission(election.step, readings=readings, elected=True, at_once=True)
            self._crew.appoint(track, self.index, mission)
