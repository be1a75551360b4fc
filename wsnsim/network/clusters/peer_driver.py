"""Performs the requests of a network without a head: participants compute, and broadcast to their neighbours."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from wsnsim.base.arrays import Bools
from wsnsim.base.errors import PluginAnswerError
from wsnsim.base.requests import NOBODY, Delivery, Exchange, Flow, Local, Member
from wsnsim.network.clusters.driver import Driver, DriverServices
from wsnsim.network.event_log import Acting


class PeerDriver(Driver):
    """Performs flows of a network without a head: each participant computes, and broadcasts to its neighbours.

    A round ends when the last broadcast of it has, and all participants know that (our choice).

    Args:
        services: what it uses.
        target: the target of the track.
        members: every participant by id, with its memory.
    """

    def __init__(self, services: DriverServices, target: int, members: dict[int, Member]) -> None:
        super().__init__(services, target, NOBODY, members)

    def perform(self, flow: Flow[Any]) -> Acting[Any]:
        """Perform a flow's requests. The flow is closed, however it ends; it goes on whichever participants die."""
        answer: Any = None
        self.readings = 0
        try:
            while True:
                try:
                    request = flow.send(answer)
                except StopIteration as end:
                    return end.value
                if type(request) is Local:
                    answer, seconds = self._local(request)
                    if seconds:
                        yield self._env.timeout(seconds)
                elif type(request) is Exchange:
                    answer = yield from self._exchange(request)
                else:  # raised in the flow, which knows its line
                    flow.throw(PluginAnswerError(f"{type(request).__name__}: without a head, use Local and Exchange"))
        finally:
            flow.close()

    def _addressed(self, who: Sequence[int] | None) -> list[Member]:
        """The living participants of those that a request addresses; None: all."""
        return super()._addressed(list(self._members) if who is None else who)

    def _exchange(self, request: Exchange) -> Acting[dict[int, dict[int, Bools]]]:
        members, alive = self._members, self._alive
        parcels = {member.id: request.parcel_of(member) for member in self._addressed(request.who)}
        sent = {node: parcel for node, parcel in parcels.items() if parcel is not None}
        heard: dict[int, dict[int, Bools]] = {}
        if not sent:
            return heard
        ended, bursts = self._services.transport.broadcast(list(sent), list(sent.values()), self._target)
        yield ended
        for burst in bursts:
            parcel = burst.parcel
            for node, mask in burst.received.items():
                if node in members and alive[node]:
                    members[node].inbox.append(Delivery(parcel.what, parcel.payload, mask, burst.source))
                    heard.setdefault(node, {})[burst.source] = mask
        self._services.intervals.shorten_for_next_step({**parcels, **heard})
        return heard
