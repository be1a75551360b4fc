"""A wake-up protocol: the head calls its sleeping neighbours near the predicted position."""

import numpy as np

from wsnsim import part
from wsnsim.plugins import Region


@part
class Neighbourhood(Region):
    """The head calls all sleeping neighbours in the region about the predicted position."""

    mechanism = "neighbourhood"

    def start(self, services):
        return CallsNeighbours(services)


class CallsNeighbours:
    def __init__(self, services):
        self.services = services

    def begin(self, round):
        services, message = self.services, round.message
        near = services.nodes_within(message.centre, message.radius)
        inside = np.intersect1d(services.neighbours(round.node), near)
        asleep = services.sleepers(inside)
        for node in {round.node, *inside.tolist()} - asleep:
            services.track(round, node, message)
        if asleep:
            services.call(round, round.node, sorted(asleep), message.bits, lambda woken: self.awake(round, woken))

    def awake(self, round, nodes):
        for node in nodes:
            self.services.track(round, node, round.message)
