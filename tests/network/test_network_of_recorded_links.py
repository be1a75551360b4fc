"""Networks over recorded links: what is delivered has the recorded ratios, in the recorded rounds, at any distance."""

from __future__ import annotations

import gzip
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

import wsnsim
from tests.helpers.thorough import thorough
from tests.models.test_k7file import GRENOBLE, row, written
from tests.models.test_recorded_links import second_half
from tests.network.radio_network import RadioNetwork
from wsnsim.base.errors import ScenarioError
from wsnsim.base.frames import EVERYONE, OfferedFrame, full_burst
from wsnsim.base.radio import BurstyLosses
from wsnsim.base.requests import Parcel
from wsnsim.base.rng import derive_all
from wsnsim.base.tables import KIND, RECORDED_BY_DEFAULT, Memory
from wsnsim.models.access import Csma, IdealMac
from wsnsim.models.recorded_links import RecordedLinks
from wsnsim.models.sleep import DutyCycle
from wsnsim.network.radio.datagrams import Datagram
from wsnsim.network.radio.topology import LinkStates

BURST = BurstyLosses(bad_time=2.0, good=0.9, bad=0.2)


def of_the_file(channel: int) -> list[dict[tuple[int, int], float]]:
    """{(source, receiver): ratio} of each round of a channel, by the times between bursts of one sender alone."""
    last: dict[str, tuple[float, int]] = {}
    rounds: list[dict[tuple[int, int], float]] = []
    with gzip.open(GRENOBLE, "rt") as file:
        for line in [*file][2:]:
            when, source, receiver, on, _, ratio, _ = line.split(",")
            if int(on) == channel:
                hours, minutes, seconds = when[11:].split(":")
                time = 86400 * int(when[8:10]) + 3600 * int(hours) + 60 * int(minutes) + float(seconds)
                before, number = last.get(source, (-math.inf, -1))
                number += time - before > 600.0
                last[source] = time, number
                rounds += [{}] * (number + 1 - len(rounds))
                rounds[number] = rounds[number] | {(int(source), int(receiver)): float(ratio)}
    return rounds


def beacons(duration: float, period: float, tables: dict[str, bool] | None = None, **changes: Any) -> Memory:
    """The tables of one run in which the 50 nodes of the recording send beacons."""
    values = {
        "name": "recorded", "seed": 7, "duration": duration, "step": 10.0,
        "workload": {"kind": "beacons", "period": period},
        "deploy": {"kind": "grid", "nodes": 50, "width": 50.0, "height": 50.0, "cover": False},
        "energy": {"kind": "first_order"}, "mac": {"kind": "csma"},
    }  # fmt: skip
    link = {"kind": "recorded", "path": str(GRENOBLE), **changes.pop("link", {})}
    memory = Memory({**RECORDED_BY_DEFAULT, **(tables or {"links": True, "events": False})})
    wsnsim.experiment.simulate_run(wsnsim.load({**values, "link": link, **changes}), recorder=memory)
    return memory


@pytest.mark.thorough
@pytest.mark.parametrize("channel", [22, *thorough([11, 13, 18, 26])])
def test_the_counts_of_delivered_beacons_have_the_distribution_of_the_recorded_ratios(channel: int) -> None:
    """Randomised probability integral transforms of binomial counts of 200 beacons a link are uniform.

    The ratios come from the lines of the file, not from our reader.
    """
    table = beacons(4000.0, 20.0, link={"channel": channel}).table("links")
    ratios = of_the_file(channel)[0]
    chance = np.array([ratios[pair] for pair in zip(table["source"].tolist(), table["node"].tolist(), strict=True)])
    assert len(chance) == len(ratios)
    assert table["chance"].tolist() == chance.tolist()
    assert np.all(table["sent"] >= 200) and np.all(table["received"][chance == 1.0] >= table["sent"][chance == 1.0] - 1)
    between = (chance > 0.0) & (chance < 1.0)
    assert between.sum() > 50
    sent, got, chance = (column[between] for column in (table["sent"], table["received"], chance))
    counts = stats.binom(sent, chance)
    transformed = counts.cdf(got - 1) + np.random.default_rng(1).random(got.size) * counts.pmf(got)
    assert stats.kstest(transformed, "uniform").pvalue > 0.01
    wrong = stats.binom(sent, 0.97 * chance)
    wrongly = wrong.cdf(got - 1) + np.random.default_rng(1).random(got.size) * wrong.pmf(got)
    assert stats.kstest(wrongly, "uniform").pvalue < 0.01


MACS: dict[str, dict[str, Any]] = {
    "ideal": {"kind": "ideal"}, "ideal with a rate": {"kind": "ideal", "rate": 250e3},
    "csma": {"kind": "csma"}, "tdma": {"kind": "tdma"},
}  # fmt: skip


@pytest.mark.thorough
@pytest.mark.parametrize("burstiness", ["none", "gilbert_elliott"])
@pytest.mark.parametrize("mac", MACS)
def test_what_was_not_heard_in_a_round_is_not_delivered_in_it(mac: str, burstiness: str) -> None:
    link = {"channel": 25, "start": 5, "round_length": 20.0, "burstiness": burstiness}
    log = beacons(60.0, 4.0, {"events": True}, link=link, mac=MACS[mac]).table("events")
    received = log["kind"] == KIND["receive"]
    rounds, delivered, edge = of_the_file(25)[5:8], [set(), set(), set()], 0.01
    for time, source, node in zip(*(log[name][received].tolist() for name in ("time", "peer", "node")), strict=True):
        if min(time % 20.0, 20.0 - time % 20.0) > edge:
            delivered[int(time // 20.0)].add((source, node))
    for ratios, pairs in zip(rounds, delivered, strict=True):
        assert pairs <= ratios.keys()
        assert len(pairs) > 0.9 * len(ratios)
    assert any(pairs - ratios.keys() for pairs in delivered for ratios in rounds)


@pytest.mark.thorough
def test_a_row_of_the_table_of_links_is_about_all_rounds() -> None:
    table = beacons(60.0, 2.0, link={"channel": 22, "round_length": 20.0}).table("links")
    rounds = of_the_file(22)[:3]
    assert {*zip(table["source"].tolist(), table["node"].tolist(), strict=True)} == set().union(*rounds)
    for source, node, chance, sent in zip(
        *(table[name].tolist() for name in ("source", "node", "chance", "sent")), strict=True
    ):
        assert sent in (29, 30)
        assert chance == pytest.approx(np.mean([each.get((source, node), 0.0) for each in rounds]), abs=0.02)
    assert np.all(table["received"] <= table["sent"])
    mean = (table["chance"] * table["sent"]).sum()
    assert table["received"].sum() == pytest.approx(mean, rel=0.01)


@pytest.mark.thorough
@pytest.mark.parametrize("channel", [11, 18])
def test_the_second_half_of_a_recording_is_played_from_its_first_whole_round(channel: int, tmp_path: Path) -> None:
    link = {"path": second_half(tmp_path), "channel": channel}
    table = beacons(100.0, 10.0, link=link).table("links")
    heard = {*zip(table["source"].tolist(), table["node"].tolist(), table["chance"].tolist(), strict=True)}
    assert heard == {(*pair, ratio) for pair, ratio in of_the_file(channel)[5].items()}
    assert table["received"].sum() == pytest.approx((table["chance"] * table["sent"]).sum(), rel=0.02)


@pytest.mark.thorough
def test_a_network_tracks_a_target_over_recorded_links() -> None:
    """Every cluster protocol of the scenario sends unicasts: none is delivered over a link that was not heard."""
    changes = {
        "link": {"kind": "recorded", "path": str(GRENOBLE), "channel": 20},
        "deploy": {"kind": "grid", "nodes": 50, "width": 250.0, "height": 250.0, "cover": False},
        "duration": 8.0, "sensor.reach": 500.0, "record": {"events": True},
    }  # fmt: skip
    memory = Memory({**RECORDED_BY_DEFAULT})
    wsnsim.experiment.simulate_run(
        wsnsim.load("ekf_real", [f"{key}={json.dumps(value)}" for key, value in changes.items()]), recorder=memory
    )
    log = memory.table("events")
    received = log["kind"] == KIND["receive"]
    pairs = {*zip(log["peer"][received].tolist(), log["node"][received].tolist(), strict=True)}
    assert len(pairs) > 10
    assert pairs <= of_the_file(20)[0].keys()


PARCEL = Parcel("payload", 1, 96, "test")
FAR = [(0.0, 0.0), (900.0, 0.0), (0.0, 900.0)]


def network(path: str, **components: Any) -> RadioNetwork:
    return RadioNetwork(FAR, link=RecordedLinks(path=path, channel=11), weight="hop", **components)


def test_links_may_join_nodes_that_are_far_apart_and_collide_there(tmp_path: Path) -> None:
    rows = [row(0, 0, 2, 1.0), row(20, 1, 2, 1.0), row(40, 2, 0, 1.0), row(40, 2, 1, 1.0)]
    net = network(written(tmp_path, *rows))
    burst = net.unicast(0, 2)
    assert burst.packets == 1 and net.unicast(0, 1).packets == 0
    assert [event["node"] for event in net.rows("drop")] == [1] * 4 and net.counters.in_range == 5
    assert net.router.path(0, 1) == [0, 2, 1]
    (datagram,) = net.carry(Datagram(0, 1, PARCEL))
    assert datagram.arrived and datagram.hops == 2
    hidden = network(written(tmp_path, *rows), mac=Csma(min_be=0, acks=False))
    hidden.env.run(until=hidden.mac.send([full_burst(source, EVERYONE, PARCEL, 0) for source in (0, 1)]))
    assert [event["node"] for event in hidden.rows("collide")] == [2, 2]


@pytest.mark.parametrize("ratio", [0.0, 0.01])
def test_the_channel_is_busy_for_those_who_hear_the_sender_in_the_round_however_rarely(
    ratio: float, tmp_path: Path
) -> None:
    rows = [row(0, 0, 2, 1.0), row(0, 0, 1, ratio), row(20, 1, 2, 1.0), row(40, 2, 0, 1.0)]
    channel = (net := network(written(tmp_path, *rows))).mac.channel
    channel.transmit(0, OfferedFrame(232, 0, lambda received: None), lambda *_: None)
    net.env.run(until=0.0005)
    assert [channel.is_busy(node) for node in range(3)] == [True, ratio > 0.0, True]


def test_directions_of_a_link_differ_and_acknowledgements_need_the_way_back(tmp_path: Path) -> None:
    net = network(written(tmp_path, row(0, 0, 1, 1.0), row(20, 1, 2, 1.0), row(40, 2, 1, 1.0)))
    burst = net.unicast(0, 1)
    assert burst.packets == 1 and net.counters.retries == 3
    assert not net.topology.connected(0, 1) and net.topology.connected(1, 2)
    assert net.router.path(0, 1) is None


def test_paths_follow_the_rounds(tmp_path: Path) -> None:
    """In the second round the direct link is gone; a sleeping node is no relay."""
    both = [row(0, a, b, 1.0) for a in range(3) for b in range(3) if a != b]
    without = [row(60, a, b, 1.0) for a in range(3) for b in range(3) if a != b and {a, b} != {0, 1}]
    path = written(tmp_path, *both, *without)
    net = network(path, mac=IdealMac())
    assert net.router.path(0, 1) == [0, 1]
    changes: list[float] = []
    net.topology.on_change = lambda: (net.router.forget_links(), changes.append(net.env.now))
    net.env.run(until=59.0)
    assert net.router.path(0, 1) == [0, 1]
    net.env.run(until=61.0)
    assert (net.router.path(0, 1), changes) == ([0, 2, 1], [60.0])
    sleeping = network(path, mac=IdealMac(), sleep=DutyCycle())
    sleeping.env.run(until=61.0)
    sleeping.nodes.hears = lambda nodes, time: np.isin(nodes, [0, 1])
    assert sleeping.router.path(0, 1) is None
    sleeping.nodes.hears = lambda nodes, time: np.isin(nodes, [2])
    assert sleeping.router.path(0, 1) == [0, 2, 1]


def states(ratio: float, number: int = 4000, since: float = 0.0, losses: BurstyLosses = BURST) -> LinkStates:
    return LinkStates(derive_all(5, np.arange(number)), np.full(number, ratio), losses, since)


@pytest.mark.parametrize("ratio", [0.3, 0.55, 0.85])
def test_a_bursty_link_has_the_mean_and_the_memory_of_its_markov_chain(ratio: float) -> None:
    """The share of good states, and how many are still good after h: π + (1 - π) exp(-h / τ); four standard errors."""
    links, share = states(ratio), (ratio - BURST.bad) / (BURST.good - BURST.bad)
    good_time = BURST.bad_time * share / (1.0 - share)
    memory = 1.0 / (1.0 / good_time + 1.0 / BURST.bad_time)
    for time in (0.0, 17.0, 400.0):
        before = links.ratios(time) == BURST.good
        after = links.ratios(time + 0.7) == BURST.good
        for found, expected in (
            (before, share),
            (after[before], share + (1.0 - share) * math.exp(-0.7 / memory)),
            (after[~before], share * (1.0 - math.exp(-0.7 / memory))),
        ):
            assert np.mean(found) == pytest.approx(
                expected, abs=4.0 * math.sqrt(expected * (1 - expected) / found.size)
            )


def test_lost_beacons_of_a_bursty_link_come_in_runs_of_the_stated_mean() -> None:
    """Beacons every h: a run of losses has 1 / (π (1 - exp(-h / τ))) on average, where frames arrive in good states."""
    ratio, period = 0.8, 0.5
    links = states(ratio, 50, losses=BurstyLosses(bad_time=2.0, good=1.0, bad=0.0))
    lost = np.array([links.ratios(period * number) == 0.0 for number in range(4000)])
    ended = lost[:-1] & ~lost[1:]
    memory = 1.0 / (1.0 / 8.0 + 1.0 / 2.0)
    mean = 1.0 / (ratio * (1.0 - math.exp(-period / memory)))
    assert lost[:-1].sum() / ended.sum() == pytest.approx(mean, rel=0.05)
    assert lost.mean() == pytest.approx(1.0 - ratio, abs=0.01)


def test_the_states_of_a_link_do_not_depend_on_when_they_were_looked_at() -> None:
    often, once = states(0.5, 200), states(0.5, 200)
    for time in np.linspace(0.0, 99.0, 50):
        often.ratios(float(time))
    assert np.array_equal(often.ratios(100.0), once.ratios(100.0))
    assert not np.array_equal(states(0.5, 200).ratios(90.0), once.ratios(100.0))


@pytest.mark.parametrize("ratio", [0.1, 0.2, 0.9, 1.0])
def test_a_link_whose_ratio_no_mixture_of_states_has_loses_frames_independently(ratio: float) -> None:
    links = states(ratio, 10)
    assert all(links.ratios(time).tolist() == [ratio] * 10 for time in (0.0, 1e6))


@pytest.mark.parametrize("mac", [Csma(acks=False), IdealMac()], ids=["csma", "ideal"])
def test_frames_meet_the_state_of_their_link(mac: Any, tmp_path: Path) -> None:
    """A frame arrives if and only if the link is good when it begins; the mean is the recorded ratio."""
    path = written(tmp_path, row(0, 0, 1, 0.5), row(20, 1, 2, 1.0), row(40, 2, 0, 1.0))
    link = RecordedLinks(path=path, channel=11, burstiness="gilbert_elliott", bad_time=30.0)
    net = RadioNetwork(FAR, link=link, mac=mac)
    neighbours, arrived = net.topology.neighbours(0), []
    for number in range(400):
        net.at(10.0 * (number + 1), lambda: None)
        net.env.run(until=10.0 * (number + 1))
        burst = net.broadcast(0)
        arrived.append(1 in burst.received)
        assert arrived[-1] == (neighbours.states.ratios(net.env.now)[0] == 1.0)
    assert np.mean(arrived) == pytest.approx(0.5, abs=0.15)
    changes = np.count_nonzero(np.diff(arrived))
    assert 400 * 0.5 * (1.0 - math.exp(-10.0 / 15.0)) == pytest.approx(changes, rel=0.35)


@pytest.mark.parametrize("choose", [lambda text: text[:5000], lambda text: b"PK" + text], ids=["cut", "not gzip"])
def test_a_scenario_with_a_damaged_recording_is_refused_in_one_sentence(
    choose: Callable[[bytes], bytes], tmp_path: Path
) -> None:
    path = tmp_path / "links.k7.gz"
    path.write_bytes(choose(GRENOBLE.read_bytes()))
    with pytest.raises(ScenarioError, match=r"link\.path.*cannot be read"):
        beacons(10.0, 1.0, link={"path": str(path)})
