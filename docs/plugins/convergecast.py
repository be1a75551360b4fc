"""A workload: each node sends one datagram to node 0, over the path that `routing` names."""

from functools import partial
from typing import Annotated

from wsnsim import Quantity, part


@part
class Convergecast:
    """Each node sends one datagram of `bits` to node 0, one node after the other, within `within` s."""

    mechanism = "convergecast"
    within: Annotated[float, Quantity("s", ge=0.1, le=1e6), "all nodes send within this time"] = 2.0
    bits: Annotated[int, Quantity("", ge=1, le=800), "payload of a datagram"] = 200

    def start(self, services):
        return Sends(self, services)


class Sends:
    def __init__(self, component, services):
        self.component, self.services = component, services
        self.arrived = 0

    def begin(self):
        count = len(self.services.positions)
        for node in range(1, count):
            self.services.call_later(self.component.within * node / count, partial(self.send, node))

    def send(self, node):
        if self.services.is_awake(node):
            self.services.send(node, 0, self.component.bits, "sample", self.note)

    def note(self, arrived):
        self.arrived += arrived
