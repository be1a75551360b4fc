"""Capture: a receiver locks on one frame; a slow twin with one receiver at a time says on which, and what arrives."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from tests.network.radio_network import RadioNetwork
from tests.network.test_beacons import RECEIVE, beacon_setup, run_of
from tests.network.test_channel import AIRTIME, BITS, TURNAROUND, play
from wsnsim.base.frames import EVERYONE, MacFrame
from wsnsim.models.deploy import Uniform
from wsnsim.models.links import LogNormal
from wsnsim.models.workloads import Periodic
from wsnsim.network.radio.capture import CapturingReceivers

HEADER, BIT = 160e-6, 4e-6
FLAT = LogNormal(shadowing=0.0, asymmetry=0.0, interference="sinr")
BETWEEN = [(0, 0), (10, 0), (25, 0)]
"""Node 1 hears node 0 with -79 dBm, node 2 with 4.2 dB less."""


@pytest.mark.parametrize(
    ("first", "later", "winner"),
    [(2, HEADER - BIT, 0), (2, HEADER + BIT, None), (0, HEADER - BIT, 0), (0, HEADER + BIT, 0)],
)
def test_a_stronger_frame_takes_a_receiver_over_while_the_header_of_the_first_is_on_the_air(first, later, winner):
    """After the header the stronger frame is lost, and so is the weaker one that faces it."""
    second = 2 - first
    sent = play(RadioNetwork(BETWEEN, link=FLAT), (0.1, first, 1), (0.1 + later, second, 1))
    assert sent.received == {0: winner == first, 1: winner == second}


def test_a_frame_that_is_stronger_by_less_than_the_margin_takes_nothing_over():
    for margin, winner in ((4.0, True), (4.5, False)):
        link = LogNormal(shadowing=0.0, asymmetry=0.0, interference="sinr", capture_margin=margin)
        assert play(RadioNetwork(BETWEEN, link=link), (0.1, 2, 1), (0.1001, 0, 1)).received[1] is winner


def test_interference_counts_for_the_time_of_the_overlap_only():
    """Most frames survive 8 bits of an interferer that is 3 dB stronger, and few survive 184 bits of it."""
    places, survived = [(0, 0), (10, 0), (17.5, 0)], []
    for overlap in (8 * BIT, AIRTIME - HEADER - 8 * BIT):
        frames = [
            (0.05 * i + shift, source, 1) for i in range(1, 101) for shift, source in ((0, 0), (AIRTIME - overlap, 2))
        ]
        received = play(RadioNetwork(places, link=FLAT), *frames, until=6.0).received
        survived.append(sum(received[number] for number in range(0, 200, 2)))
        assert not any(received[number] for number in range(1, 200, 2)), "the later frame is always lost"
    assert survived[0] > 70 and survived[1] < 15


def test_a_receiver_that_begins_to_send_loses_its_frame_and_may_lock_on_another_afterwards():
    network = RadioNetwork([(0, 0), (10, 0), (5, 5)], link=FLAT)
    short = MacFrame(EVERYONE, 80)
    network.at(0.1 + HEADER, lambda: network.mac.channel.transmit(1, short, lambda *_: None))
    sent = play(network, (0.1, 0, 1), (0.1 + HEADER + 80 * BIT + BIT, 2, 1))
    assert sent.received[0] is False
    assert network.topology.neighbours(2).powers[1] > network.topology.neighbours(0).powers[0] + 3.0
    assert sent.received[1] is True


def overlapping_receptions(seed: int) -> tuple[int, int]:
    """Receptions of a beacon run, and pairs of them at one node that overlap in time."""
    made = beacon_setup(
        seed=seed, steps=0, deploy=Uniform(nodes=30, width=130.0, height=130.0), workload=Periodic(period=0.03),
        link=LogNormal(interference="sinr", cca_mode=1),
    )  # fmt: skip
    log = run_of(made).log
    got = log["kind"] == RECEIVE
    nodes, ends, pairs = log["node"][got], log["time"][got], 0
    for node in np.unique(nodes):
        at = np.argsort(ends[nodes == node])
        end, start = ends[nodes == node][at], (ends - AIRTIME)[nodes == node][at]
        pairs += int((start[1:] < end[:-1] - 1e-9).sum())
    return int(got.sum()), pairs


@pytest.mark.thorough
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_no_node_receives_two_overlapping_frames(seed):
    receptions, pairs = overlapping_receptions(seed)
    assert receptions > 2000 and pairs == 0


def bit_error(ratio: float) -> float:
    """IEEE 802.15.4-2006, E.4.1.8."""
    terms = ((-1) ** k * math.comb(16, k) * math.exp(20.0 * ratio * (1.0 / k - 1.0)) for k in range(2, 17))
    return 8.0 / 15.0 / 16.0 * sum(terms)


class Twin:
    """One receiver, scalar by scalar: which frame it is locked on, and the probability of each that it keeps."""

    def __init__(self, node: int, heard: dict[int, float], frames: list, noise: float) -> None:
        self.node, self.noise = node, noise
        self.frames = frames
        self.milliwatts = {number: 10.0 ** (power / 10.0) for number, power in heard.items()}

    def ratio(self, frame, time: float, before: int | None = None) -> float:
        """Signal to noise and interference at a time; `before`: only frames that began earlier count."""
        others = (
            self.milliwatts.get(other.number, 0.0)
            for other in self.frames
            if other is not frame and other.start <= time < other.end and (before is None or other.number < before)
        )
        return self.milliwatts[frame.number] / (self.noise + sum(others))

    def kept(self) -> list:
        """The frames to whose end the receiver is locked."""
        lock, kept = None, []
        for frame in self.frames:
            if lock is not None and lock.end <= frame.start:
                kept.append(lock)
                lock = None
            if frame.source == self.node:
                lock = None
                continue
            if frame.number not in self.milliwatts or self._sends(frame.start):
                continue
            if (1.0 - bit_error(self.ratio(frame, frame.start, frame.number))) ** 40 < 1e-3:
                continue
            if lock is None or (
                frame.start < lock.start + HEADER
                and self.milliwatts[frame.number] >= 10**0.3 * self.milliwatts[lock.number]
            ):
                lock = frame
        return kept + ([] if lock is None else [lock])

    def _sends(self, time: float) -> bool:
        return any(frame.source == self.node and frame.start <= time < frame.end for frame in self.frames)

    def arrives(self, frame) -> float:
        """The probability that no bit is wrong, bit by bit."""
        times = frame.start + (np.arange(BITS) + 0.5) * BIT
        return math.prod(1.0 - bit_error(self.ratio(frame, time)) for time in times)


@pytest.mark.thorough
@pytest.mark.parametrize("seed", [1, 2])
def test_locks_and_probabilities_are_those_of_a_slow_twin(seed, monkeypatch):
    """Up to sixty frames from twelve nodes within ten airtimes, begun at whole bits without listening before."""
    rng, found, frames = np.random.default_rng(seed), {}, []
    network = RadioNetwork(rng.uniform(0, 60, (12, 2)), link=LogNormal(interference="sinr"))
    of = CapturingReceivers.probabilities

    def probabilities(self, sent):
        found[sent.number] = self.locked(sent).copy(), of(self, sent)
        return found[sent.number][1]

    monkeypatch.setattr(CapturingReceivers, "probabilities", probabilities)
    free = np.zeros(12)
    for time in np.sort(rng.integers(0, 2400, 60)) * BIT + 0.1:
        source = int(rng.integers(12))
        if free[source] <= time:
            free[source] = time + AIRTIME + 2 * TURNAROUND
            network.at(time, lambda source=source: frames.append(
                network.mac.channel.transmit(source, MacFrame(EVERYONE, BITS), lambda *_: None)))  # fmt: skip
    network.env.run(until=1.0)
    compared = 0
    for node in range(12):
        heard = {
            frame.number: float(frame.neighbours.powers[frame.neighbours.index(node)])
            for frame in frames
            if frame.neighbours.index(node) >= 0
        }
        twin = Twin(node, heard, frames, network.topology.link.noise)
        kept = twin.kept()
        for a, b in itertools.pairwise(kept):
            assert a.end <= b.start
        for frame in frames:
            if frame.number not in found or frame.number not in heard:
                continue
            locks, chances = found[frame.number]
            at = frame.neighbours.index(node)
            sends = any(f.source == node and f.start < frame.end and f.end > frame.start for f in frames)
            assert bool(locks[at]) == (frame in kept), (node, frame.number)
            if locks[at] and not sends:
                compared += 1
                assert chances[at] == pytest.approx(twin.arrives(frame), rel=1e-6, abs=1e-12)
    assert compared > 10
