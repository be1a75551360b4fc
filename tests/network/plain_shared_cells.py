"""Saturated senders that share one cell: the back-off of IEEE 802.15.4, 6.2.5.3, slotframe by slotframe."""

import numpy as np


class Sender:
    """A node that always has a frame for the sink; `wait` counts the shared cells that it lets pass."""

    def __init__(self):
        self.failures, self.exponent, self.wait = 0, 0, 0


def throughput(senders, slotframes, seed, *, min_be=1, max_be=7, retries=3):
    """(frames delivered per slotframe, share of frames that are given up) of nodes in range of each other."""
    rng = np.random.default_rng(seed)
    nodes = [Sender() for _ in range(senders)]
    delivered = lost = 0
    for _ in range(slotframes):
        active = []
        for node in nodes:
            if node.wait:
                node.wait -= 1
            else:
                active.append(node)
        if len(active) == 1:
            delivered += 1
            active[0].failures = 0
            continue
        for node in active:
            node.failures += 1
            if node.failures > retries:
                lost += 1
                node.failures = 0
                continue
            node.exponent = min_be if node.failures == 1 else min(node.exponent + 1, max_be)
            node.wait = int(rng.integers(2**node.exponent))
    return delivered / slotframes, lost / max(delivered + lost, 1)
