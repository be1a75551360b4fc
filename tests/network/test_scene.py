"""What a head knows of places and prices before it asks: in a network, and without one."""

from __future__ import annotations

import numpy as np
import pytest

import wsnsim
from tests.helpers.centroid_network import Centroid, Run, network_setup, passing, standing
from wsnsim.base.initial_conditions import sample_initial_conditions
from wsnsim.base.radio import PacketJoules
from wsnsim.base.requests import PACKET_BITS
from wsnsim.base.rng import Streams
from wsnsim.models.clusters import Central, StrongestSignal
from wsnsim.models.energy import FirstOrder, FirstOrder2002, States
from wsnsim.offline.loopback import OfflineCluster
from wsnsim.scenario import build

DISTANCES = np.array([0.0, 10.0, 75.0, 87.0, 88.0, 300.0])


@pytest.mark.parametrize("policy", [None, Central()], ids=["standing", "open"])
def test_a_head_knows_its_place_and_the_places_and_traits_of_all_living_members(policy) -> None:
    tracker = Centroid()
    changes = {} if policy is None else {"clusters": policy}
    run = Run(network_setup(tracker=tracker, **changes), truths=[passing((-60.0, -60.0), (40.0, 40.0), 50)])
    rosters = {scene.roster for scene in tracker.scenes}
    assert len(tracker.scenes) == 50 and len(rosters) > 1
    assert any(set(scene.roster) > set(scene.ids) for scene in tracker.scenes), "not every member senses"
    for scene in tracker.scenes:
        assert np.array_equal(scene.head_position, run.positions[scene.head])
        assert np.array_equal(scene.roster_positions, run.positions[list(scene.roster)])
        assert np.array_equal(scene.roster_traits, np.ones((len(scene.roster), 1)))


def test_the_places_of_members_are_looked_up_once_while_the_roster_stays() -> None:
    tracker = Centroid()
    Run(network_setup(steps=3, tracker=tracker), [(0.0, 0.0), (30.0, 0.0), (0.0, 40.0)], [standing((5.0, 5.0), 3)])
    first, *others = tracker.scenes
    assert all(scene.roster_positions is first.roster_positions for scene in others)
    assert all(scene.roster_traits is first.roster_traits for scene in others)


def test_a_member_that_died_is_in_no_roster() -> None:
    tracker = Centroid()
    battery = FirstOrder(battery=3.5e-4)  # the farther a member is, the earlier it dies: it pays for every reading
    nodes = [(0.0, 0.0), (30.0, 0.0), (0.0, 40.0)]
    run = Run(
        network_setup(tracker=tracker, energy=battery, clusters=StrongestSignal(minimum_active=1)),
        nodes,
        [standing((1.0, 1.0), 50)],
    )
    assert [scene.roster for scene in tracker.scenes if len(scene.roster) < 3][:1] == [(0, 1)]
    for scene in tracker.scenes:
        assert np.array_equal(scene.roster_positions, run.positions[list(scene.roster)])
        assert len(scene.roster_traits) == len(scene.roster)


@pytest.mark.parametrize("energy", [FirstOrder(), FirstOrder2002()], ids=["2000", "2002"])
def test_a_packet_costs_what_the_energy_model_says_for_the_distance(energy) -> None:
    expected = [sum(energy.transmit(PACKET_BITS, away)) + energy.receive(PACKET_BITS) for away in DISTANCES.tolist()]
    tracker = Centroid()
    Run(network_setup(steps=1, tracker=tracker, energy=energy), [(0.0, 0.0)], [standing((5.0, 5.0), 1)])
    assert tracker.scenes[0].packet_joules(DISTANCES).tolist() == expected
    assert np.all(np.diff(expected) > 0.0)
    assert tracker.scenes[0].packet_joules(DISTANCES[:0]).shape == (0,)


def test_a_packet_in_the_event_log_costs_what_the_scene_says() -> None:
    tracker = Centroid()
    run = Run(
        network_setup(steps=2, tracker=tracker), [(0.0, 0.0), (30.0, 0.0), (0.0, 40.0)], [standing((5.0, 5.0), 2)]
    )
    scene = tracker.scenes[0]
    away = np.hypot(*(run.positions[1] - scene.head_position))
    sent = [row for row in run.events("send", "reading") if row["node"] == 1]
    heard = [row for row in run.events("receive", "reading") if row["peer"] == 1]
    assert scene.packet_joules(np.array([away]))[0] == pytest.approx(sent[0]["joules"] + heard[0]["joules"], rel=1e-12)


def test_the_distance_does_not_matter_to_a_radio_of_constant_power() -> None:
    energy = build(wsnsim.load("ekf_real")).energy
    assert isinstance(energy, States)
    costs = PacketJoules(energy)(DISTANCES)
    assert np.all(costs == costs[0]) and costs[0] > 0.0


def test_without_a_network_packets_are_free_and_the_head_is_in_the_middle_of_the_field() -> None:
    setup = build(wsnsim.load("jiang_field", ["network=none", "tracker={kind: ekf}"]))
    conditions = sample_initial_conditions(setup, 0)
    scene = OfflineCluster(setup, 0, conditions, Streams(setup.seed, 0)).scene(1, 1)
    assert np.array_equal(scene.head_position, np.array(setup.deploy.field.centre))
    assert np.array_equal(scene.roster_positions, conditions.assumed)
    assert np.array_equal(scene.roster_traits, conditions.traits)
    assert scene.packet_joules(DISTANCES).tolist() == [0.0] * DISTANCES.size
