"""`Reception` finds the result of a frame as array operations do, bit by bit."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.network.plain_reception import PlainReception
from tests.network.radio_network import RadioNetwork
from wsnsim.base.frames import EVERYONE, MacFrame
from wsnsim.models.energy import FirstOrder
from wsnsim.models.links import Disk, LogNormal
from wsnsim.models.sleep import EventWake, RandomIndependent
from wsnsim.scenario import build, load

NODES = 14
LINKS = {
    "disk": Disk(reach=60.0),
    "disk with loss": Disk(reach=60.0, loss=0.3),
    "log-normal": LogNormal(),
    "log-normal, exponent 2.13": LogNormal(exponent=2.13),
    "sinr": LogNormal(interference="sinr"),
}
STATES = build(load("gmtt", ["duration=4 s"])).energy
SLEEPS = {"awake": EventWake(), "asleep at times": RandomIndependent(period=0.05, probability=0.6)}


class Windows:
    """Radios that are on for a share of each 20 ms, from a phase of their own on; all of them stay on for a frame."""

    def __init__(self, share):
        self.share = share

    def hears(self, ids, since):
        return (since / 0.02 + ids / 7.0) % 1.0 < self.share


def played(link, sleep, energy, seed, general, share=None):
    """What a busy tenth of a second in a small network leaves behind: events, ledger, counters and results."""
    rng = np.random.default_rng(seed)
    network = RadioNetwork(rng.uniform(0, 90, (NODES, 2)), link=link, sleep=sleep, energy=energy, seed=seed)
    if share is not None:
        network.mac.channel = network.mac._services.open_channel(network.mac._mac, network.mac._mac.cca, Windows(share))
    channel, results, ways = network.mac.channel, [], []
    if general:
        channel._reception.__class__ = PlainReception
    else:
        of = channel._reception._book
        channel._reception._book = lambda sent, *rest: ways.append(sent) or of(sent, *rest)

    def send(source, to, code, asleep):
        if network.nodes.alive[source] and not network.mac.channel.is_sending(source):
            frame = MacFrame(to, 232, packets=1, target=-1, code=code)
            network.mac.channel.transmit(source, frame, lambda sent, got: results.append((sent, got)), asleep)

    for number, time in enumerate(np.sort(rng.uniform(0, 0.12, 60)).tolist()):
        source, other = (int(node) for node in rng.choice(NODES, 2, replace=False))
        to = EVERYONE if rng.random() < 0.5 else other
        asleep = np.flatnonzero(rng.random(NODES) < 0.3) if to != EVERYONE and rng.random() < 0.4 else None
        network.at(time, lambda a=source, b=to, c=number, d=asleep: send(a, b, c, d))
    network.env.run(until=0.2)
    network.log.fingerprint()
    events = network.memory.table("events")
    return network, events, results, ways


def assert_equal(mine, general, ordered):
    for one, other in zip(mine[2], general[2], strict=True):
        assert one[0].missed == other[0].missed and np.array_equal(one[1], other[1])
        assert np.array_equal(one[0].listeners, other[0].listeners) or one[0].listeners is None is other[0].listeners
    for name, column in mine[1].items():
        if ordered:
            assert np.array_equal(column, general[1][name], equal_nan=column.dtype.kind == "f"), name
    assert mine[0].log.fingerprint() == general[0].log.fingerprint()
    assert np.array_equal(mine[0].nodes.ledger.joules, general[0].nodes.ledger.joules)
    assert np.array_equal(mine[0].nodes.ledger.spent, general[0].nodes.ledger.spent)
    assert mine[0].counters == general[0].counters and mine[0].died == general[0].died


@pytest.mark.thorough
@given(st.sampled_from(sorted(LINKS)), st.sampled_from(sorted(SLEEPS)), st.booleans(), st.integers(0, 10_000))
def test_the_result_of_a_frame_is_that_of_array_operations(link, sleep, continuous, seed):
    energy = STATES if continuous else FirstOrder()
    runs = [played(LINKS[link], SLEEPS[sleep], energy, seed, general) for general in (False, True)]
    assert_equal(*runs, ordered=link != "disk")
    assert len(runs[0][3]) > (0 if link == "disk" else 20), "the fast way was taken"


@pytest.mark.thorough
@given(
    st.sampled_from(sorted(LINKS)), st.sampled_from(sorted(SLEEPS)), st.sampled_from([0.2, 0.7, 1.0]),
    st.integers(0, 10_000),
)  # fmt: skip
def test_so_it_is_where_radios_are_mostly_off_and_no_radio_that_is_off_pays(link, sleep, share, seed):
    runs = [played(LINKS[link], SLEEPS[sleep], FirstOrder(), seed, general, share) for general in (False, True)]
    assert_equal(*runs, ordered=link != "disk")
    for sent, received in runs[0][2]:
        on = sent.neighbours.ids[Windows(share).hears(sent.neighbours.ids, sent.start)]
        assert set(sent.listeners.tolist()) <= set(on.tolist())
        assert sent.frame.to != EVERYONE or set(received.tolist()) <= set(sent.listeners.tolist())
    paid = [row for row in runs[0][0].rows("receive", "overhear", "collide") if row["joules"] > 0.0]
    listened = {(sent.number, node) for sent, _ in runs[0][2] for node in sent.listeners.tolist()}
    assert {(row["frame"], row["node"]) for row in paid} <= listened


@settings(max_examples=6)
@given(st.sampled_from(sorted(LINKS)), st.integers(0, 10_000))
def test_so_it_is_where_batteries_run_out(link, seed):
    scarce = FirstOrder(battery=1e-4)
    runs = [played(LINKS[link], EventWake(), scarce, seed, general) for general in (False, True)]
    assert_equal(*runs, ordered=link != "disk")


@pytest.mark.parametrize("link", ["log-normal", "sinr"])
def test_a_radio_that_is_jammed_receives_nothing(link):
    network = RadioNetwork([(0, 0), (10, 0), (20, 0)], link=LINKS[link])
    network.nodes.jammed[1] = network.nodes.disturbed = True
    assert network.broadcast(0).received.keys() <= {2}


@pytest.mark.parametrize("to", [EVERYONE, 2])
@pytest.mark.parametrize("disturbed", [False, True])
@pytest.mark.parametrize("link", ["disk", "sinr"])
def test_of_two_frames_that_begin_and_end_together_a_radio_that_may_be_off_pays_for_one(to, disturbed, link):
    network = RadioNetwork([(0, 0), (20, 0), (10, 8)], link=LINKS[link])
    network.nodes.disturbed = disturbed
    channel = network.mac._services.open_channel(network.mac._mac, network.mac._mac.cca, Windows(1.0))
    for source in (0, 1):
        channel.transmit(source, MacFrame(to, 232, packets=1, target=-1), lambda sent, received: None)
    network.env.run(until=0.1)
    paid = [row["bits"] for row in network.rows("receive", "collide", "overhear") if row["node"] == 2]
    assert sum(paid) == 232
