"""A time synchronisation: one node broadcasts what its clock shows, and those that receive it set theirs."""

from typing import Annotated

from wsnsim import Quantity, part


@part
class Reference:
    """Node 0 broadcasts the time once per period, and nodes in range set their clocks to it."""

    mechanism = "reference"
    period: Annotated[float, Quantity("s", ge=0.1, le=1e6), "between two messages"] = 10.0
    bits: Annotated[int, Quantity("", ge=1, le=800), "payload of a message"] = 64

    def start(self, services):
        return SetsClocks(self, services)


class SetsClocks:
    def __init__(self, component, services):
        self.component, self.services = component, services
        self.set = {0}

    def begin(self):
        self.services.call_later(self.services.lasts(0, self.component.period), self.send)

    def send(self):
        if self.services.is_awake(0):
            self.services.broadcast(0, self.component.bits, self.arrived)
        self.begin()

    def arrived(self, nodes):
        if nodes is None:  # it never got the channel
            return
        for node in nodes.tolist():
            self.services.set_clock(node, self.services.clock(0), 1.0)
            self.set.add(node)

    def forget(self, node):
        self.set.discard(node)

    def is_synchronised(self, node):
        return node in self.set
