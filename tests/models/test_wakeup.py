"""Wake-up protocols: the decisions of nodes, case by case, and the contents of messages."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from wsnsim.base.sleeping import Decision, WakeUpPlan
from wsnsim.models.wakeup import DirectedFlood, ExperienceZones, NoWakeUp, Region

DROP, TRACK, FORWARD, STOP = Decision.DROP, Decision.TRACK, Decision.FORWARD, Decision.STOP
WAKES = [DirectedFlood(), ExperienceZones(), Region()]
PLAN = WakeUpPlan(
    target=1, step=7, sequence=300, sender=12, place=(0.0, 0.0), fix=(5.0, 0.0), heading=(3.0, 0.0),
    prediction=(100.0, 0.0), foreseen=True, due=14.0, ahead=2.0, sensing=40.0, reach=80.0, payload_bits=160,
)  # fmt: skip


def flooded(place, seen=False, now=13.0, sender=(0.0, 0.0)):
    protocol = DirectedFlood()
    return protocol.decide(place, replace(protocol.compose(PLAN, "belief"), place=sender), seen, now, 0.5)


def test_the_floods_message_has_33_bytes_with_five_positions():
    """Sequence 1, sender 2, target 2, five positions 20, predicted position 4, expiry 4."""
    assert DirectedFlood().compose(PLAN, None).bits == 8 * (1 + 2 + 2 + 5 * 4 + 4 + 4) == 8 * 33
    assert DirectedFlood().compose(PLAN._replace(payload_bits=64), None).bits == 8 * (13 + 8)


def test_invitations_have_17_bytes_and_announcements_13_whatever_the_belief():
    assert ExperienceZones().compose(PLAN, None).bits == 8 * 17
    assert Region().compose(PLAN, None).bits == 8 * 13


@pytest.mark.parametrize("protocol", WAKES, ids=repr)
def test_a_message_says_what_its_head_planned(protocol):
    message = protocol.compose(PLAN, "belief")
    assert (message.target, message.step, message.sender, message.place) == (1, 7, 12, (0.0, 0.0))
    assert (message.fix, message.heading, message.due) == ((5.0, 0.0), (3.0, 0.0), 14.0)
    assert (message.sensing, message.reach) == (40.0, 80.0)
    assert message.centre == (100.0, 0.0)
    assert message.expires == 15.0
    assert message.sequence == 300 - 256, "a byte"
    assert replace(protocol, expiry=0.25).compose(PLAN, None).expires == 14.25


def test_the_flood_alone_hands_the_belief_over():
    assert [(p.carries_belief, p.compose(PLAN, "belief").belief) for p in WAKES] == [
        (True, "belief"), (False, None), (False, None),
    ]  # fmt: skip


def test_protocols_name_their_mechanism_and_their_times():
    assert [protocol.mechanism for protocol in WAKES] == ["flood", "invite", "region"]
    assert {(protocol.wait, protocol.call) for protocol in WAKES} == {(3.0, 5e-3)}


@pytest.mark.parametrize("protocol", [DirectedFlood(), Region()], ids=repr)
def test_without_a_prediction_the_region_is_around_the_last_fix_and_as_wide_as_the_target_may_have_moved(
    protocol,
):
    """min(R, r + v_max dt): 40 m and 8 m/s for 2 s, at most 80 m."""
    blind = PLAN._replace(foreseen=False)
    message = protocol.compose(blind, None)
    assert (message.centre, message.radius) == ((5.0, 0.0), 56.0)
    assert protocol.compose(blind._replace(ahead=4.9), None).radius == pytest.approx(79.2)
    assert protocol.compose(blind._replace(ahead=5.1), None).radius == 80.0
    assert protocol.compose(PLAN._replace(ahead=50.0), None).radius == 40.0, "a prediction needs no margin"
    assert replace(protocol, radius=25.0).compose(PLAN, None).radius == 25.0
    assert replace(protocol, radius=25.0, speed=1.0).compose(blind, None).radius == 27.0


@pytest.mark.parametrize(
    ("place", "seen", "now", "decision"),
    [
        ((100.0, 39.9), False, 13.0, TRACK),  # in the region
        ((100.0, 40.0), False, 13.0, FORWARD),  # its edge is outside; nearer than the sender
        ((30.0, 0.0), False, 13.0, FORWARD),  # nearer than the sender
        ((0.0, 0.0), False, 13.0, STOP),  # as far as the sender
        ((-30.0, 0.0), False, 13.0, STOP),  # farther
        ((200.0, 0.0), False, 13.0, STOP),  # as far, beyond
        ((199.0, 0.0), False, 13.0, FORWARD),  # nearer, beyond
        ((100.0, 0.0), True, 13.0, STOP),  # heeded before
        ((30.0, 0.0), True, 13.0, STOP),
        ((100.0, 0.0), False, 15.0, TRACK),  # heeded until it expires
        ((100.0, 0.0), False, 15.001, DROP),
        ((30.0, 0.0), False, 15.001, DROP),
        ((-30.0, 0.0), False, 15.001, DROP),
        ((100.0, 0.0), True, 15.001, DROP),
    ],
)
def test_a_node_that_hears_the_flood_drops_tracks_forwards_or_stops(place, seen, now, decision):
    assert flooded(place, seen, now) is decision


def test_a_node_compares_its_distance_with_that_of_the_sender_of_the_copy():
    """A forwarding node puts its own position into its copy."""
    assert flooded((30.0, 0.0), sender=(20.0, 0.0)) is FORWARD
    assert flooded((30.0, 0.0), sender=(30.0, 0.0)) is STOP
    assert flooded((30.0, 0.0), sender=(50.0, 0.0)) is STOP


def test_a_flood_over_any_network_ends_and_each_hop_is_nearer_to_the_prediction_than_the_one_before():
    """A flood over random networks without a clock: a forwarding node puts its position into its copy."""
    protocol, hops = DirectedFlood(), 0
    for seed in range(20):
        nodes = np.random.default_rng(seed).uniform(-150.0, 150.0, (150, 2))
        first = protocol.compose(PLAN._replace(place=tuple(nodes[0])), None)
        queue, seen = [first], {0}
        while queue:
            copy = queue.pop()
            for node in np.flatnonzero(np.hypot(*(nodes - copy.place).T) <= 80.0).tolist():
                decision = protocol.decide(tuple(nodes[node]), copy, node in seen, 13.0, 0.5)
                seen.add(node)
                apart = math.dist(nodes[node], copy.centre)
                if decision is FORWARD:
                    hops += 1
                    assert 40.0 <= apart < math.dist(copy.place, copy.centre)
                    queue.append(replace(copy, place=tuple(nodes[node])))
                assert (decision is TRACK) <= (apart < 40.0)
    assert hops > 100


@pytest.mark.parametrize(
    ("place", "seen", "now", "decision"),
    [
        ((100.0, 39.9), False, 13.0, TRACK),
        ((100.0, 40.0), False, 13.0, STOP),
        ((30.0, 0.0), False, 13.0, STOP),
        ((100.0, 0.0), True, 13.0, STOP),
        ((100.0, 0.0), False, 15.001, DROP),
        ((30.0, 0.0), True, 15.001, DROP),
    ],
)
def test_a_node_that_is_called_into_a_region_tracks_if_it_is_in_it(place, seen, now, decision):
    protocol = Region()
    assert protocol.decide(place, protocol.compose(PLAN, None), seen, now, 0.5) is decision


def at(distance, degrees):
    """A position at a distance from the last fix, at an angle to the heading, which is along x."""
    return 5.0 + distance * math.cos(math.radians(degrees)), distance * math.sin(math.radians(degrees))


@pytest.mark.parametrize("levels", [(0.6, 0.3, 0.4, 0.1), (0.9, 0.5, 0.7, 0.2), (1.0, 0.8, 0.9, 0.5)])
def test_the_zones_are_inside_the_reach_or_beyond_and_within_sixty_degrees_of_the_heading_or_not(levels):
    name = {0.6: "low", 0.9: "mid", 1.0: "high"}[levels[0]]
    for protocol in (ExperienceZones(levels=name), ExperienceZones(probabilities=levels)):
        message = protocol.compose(PLAN, None)
        for distance, (ahead, behind) in (
            (20.0, levels[:2]),
            (39.9, levels[:2]),
            (40.1, levels[2:]),
            (79.0, levels[2:]),
        ):
            for degrees, expected in (
                (0, ahead),
                (59.9, ahead),
                (-59.9, ahead),
                (60.1, behind),
                (-60.1, behind),
                (180, behind),
            ):
                assert protocol.probability(at(distance, degrees), message) == expected


def test_the_heading_turns_the_zones_and_its_length_does_not_matter():
    protocol = ExperienceZones()
    for pace in (1e-6, 1.0, 1e6):
        up = protocol.compose(PLAN._replace(heading=(0.0, pace)), None)
        assert protocol.probability((5.0, 20.0), up) == 0.9
        assert protocol.probability((25.0, 0.0), up) == 0.5
        assert protocol.probability((5.0, -60.0), up) == 0.2


def test_without_a_heading_no_node_is_ahead():
    protocol = ExperienceZones()
    message = protocol.compose(PLAN._replace(heading=(0.0, 0.0)), None)
    assert {protocol.probability(at(20.0, degrees), message) for degrees in range(0, 360, 30)} == {0.5}
    assert {protocol.probability(at(60.0, degrees), message) for degrees in range(0, 360, 30)} == {0.2}
    assert protocol.probability((5.0, 0.0), message) == 0.5


def test_an_invited_node_tracks_if_its_random_number_is_below_the_probability_of_its_zone():
    protocol = ExperienceZones()
    message, place = protocol.compose(PLAN, None), at(20.0, 0)
    draws = np.linspace(0.0, 1.0, 1000, endpoint=False)
    tracking = [protocol.decide(place, message, False, 13.0, float(chance)) is TRACK for chance in draws]
    assert sum(tracking) == 900
    assert protocol.decide(place, message, True, 13.0, 0.0) is STOP
    assert protocol.decide(place, message, False, 15.001, 0.0) is DROP


def test_all_nodes_track_with_probability_one_and_none_with_zero():
    protocol = ExperienceZones(probabilities=(1.0, 0.0, 0.0, 0.0))
    message = protocol.compose(PLAN, None)
    assert protocol.decide(at(20.0, 0), message, False, 13.0, 1.0 - 2.0**-53) is TRACK
    assert protocol.decide(at(20.0, 90), message, False, 13.0, 0.0) is STOP


STEPS_OF_TWO: Any = SimpleNamespace(dt=2.0)


def test_probabilities_that_are_all_zero_are_an_issue():
    [issue] = ExperienceZones(probabilities=(0.0, 0.0, 0.0, 0.0)).check(STEPS_OF_TWO)
    assert issue.path == ("wakeup", "probabilities")
    assert "no node would ever track" in issue.message
    assert not list(ExperienceZones(probabilities=(0.0, 0.0, 0.0, 0.1)).check(STEPS_OF_TWO))
    assert not list(ExperienceZones().check(STEPS_OF_TWO))


@pytest.mark.parametrize("protocol", [DirectedFlood, Region, ExperienceZones])
def test_a_message_expires_before_its_sequence_number_is_used_again(protocol):
    [issue] = protocol(expiry=256.0).check(STEPS_OF_TWO)
    assert issue.path == ("wakeup", "expiry") and "less than 256 s" in issue.message
    assert not list(protocol(expiry=255.0).check(STEPS_OF_TWO))


def test_without_a_wake_up_protocol_there_is_no_message_and_no_decision():
    protocol = NoWakeUp()
    assert (protocol.mechanism, protocol.carries_belief) == ("none", False)
    assert protocol.decide((0.0, 0.0), DirectedFlood().compose(PLAN, None), False, 0.0, 0.0) is STOP
    with pytest.raises(NotImplementedError, match="no node is woken"):
        protocol.compose(PLAN, None)


@pytest.mark.parametrize("protocol", WAKES, ids=repr)
def test_decisions_are_pure(protocol):
    """Equal arguments give equal decisions, and the message is unchanged."""
    message, draw = protocol.compose(PLAN, "belief"), np.random.default_rng(4)
    before = repr(message)
    asked = [
        (tuple(draw.uniform(-150, 150, 2)), bool(draw.random() < 0.3), draw.uniform(12, 16), draw.random())
        for _ in range(200)
    ]
    answers = [protocol.decide(place, message, seen, now, chance) for place, seen, now, chance in asked]
    again = [protocol.decide(place, message, seen, now, chance) for place, seen, now, chance in reversed(asked)]
    assert answers == again[::-1]
    assert {DROP, TRACK, STOP} <= set(answers)
    assert repr(message) == before
