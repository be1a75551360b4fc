"""A fault: nodes lose charge three times, and then crash until the duration of the fault has passed."""

from typing import Annotated

from wsnsim import Quantity, part
from wsnsim.plugins import Aimed


@part
class Overheating(Aimed):
    """Nodes lose charge at regular intervals, and crash after the third loss."""

    mechanism = "overheating"
    joules: Annotated[float, Quantity("J", gt=0.0), "charge lost each time"] = 0.01

    def start(self, services):
        return Overheater(services, self.joules)


class Overheater:
    def __init__(self, services, joules):
        self.services, self.joules = services, joules

    def begin(self, nodes):
        for node in nodes.tolist():
            self.services.log_start(node)
        self.lose(nodes, times=3)

    def lose(self, nodes, times):
        if times == 0:
            self.services.take_down(nodes)
            return
        for node in nodes.tolist():
            if self.services.is_up(node):
                self.services.drain(node, self.joules)
        self.services.call_later(0.1, lambda: self.lose(nodes, times - 1))

    def end(self, nodes):
        self.services.bring_up()
        for node in nodes.tolist():
            self.services.log_end(node)
