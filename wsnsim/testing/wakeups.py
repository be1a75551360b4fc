"""The contract check of wake-up components: `check_wakeup`."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, Final

import numpy as np

from wsnsim.base.mechanisms import StartsWakeUp
from wsnsim.base.setups import NetworkSetup
from wsnsim.base.sleeping import Decision, WakeUp, WakeUpMessage, WakeUpPlan
from wsnsim.base.tables import KIND, Memory
from wsnsim.experiment import replicate_of
from wsnsim.scenario import build, load
from wsnsim.testing.demand import demand, examined

PLAN: Final = WakeUpPlan(
    target=0, step=7, sequence=300, sender=3, place=(0.0, 0.0), fix=(10.0, 0.0), heading=(1.0, 0.0),
    prediction=(12.0, 0.0), foreseen=True, due=14.0, ahead=2.0, sensing=40.0, reach=80.0, payload_bits=160,
)  # fmt: skip
SCENARIO: Final[dict[str, Any]] = {
    "name": "check_wakeup",
    "seed": 5,
    "duration": 40.0,
    "step": 2.0,
    "lost": {"window": 20.0},
    "deploy": {"kind": "uniform", "nodes": 200, "width": 400.0, "height": 400.0, "cover": False},
    "motion": {"kind": "random_waypoint", "width": 300.0, "height": 300.0},
    "sensor": {"kind": "range", "reach": 40.0, "sd": 2.0},
    "energy": {"kind": "states", "radio": "cc2420", "processor": "msp430f1611"},
    "link": {"kind": "disk", "reach": 80.0},
    "mac": {"kind": "csma"},
    "routing": {"kind": "greedy_geographic"},
    "sleep": {"kind": "ris"},
    "wakeup": {"kind": "directed_flood"},
    "clusters": {"kind": "moving_head"},
    "faults": [{"kind": "crash", "at": 21.0, "head": 0, "duration": 5.0}],
    "tracker": {"kind": "gmtt"},
}
"""A small field of sleeping nodes with a moving head that crashes once."""


def check_wakeup(wakeup: WakeUp) -> None:
    """Check a wake-up component against its contract.

    Args:
        wakeup: the component.

    Raises:
        AssertionError: names the demand that fails. message: a message is about the plan's target and step, and its
            numbers are finite; decision: equal arguments give equal decisions; wakes: nodes track in a small network,
            and only nodes that are up send; repeatable: the same seed gives the same run.
    """
    if wakeup.mechanism == "none":
        return
    wakeup = examined(wakeup, WakeUp)
    with demand("message"):
        message = wakeup.compose(PLAN, None)
        _check_message(message)
    with demand("decision"):
        _check_decisions(wakeup, message)
    with demand("wakes"):
        first = _run(wakeup)
        _check_run(first)
    with demand("repeatable"):
        again = _run(wakeup).table("events")
        equal = all(np.array_equal(column, again[name]) for name, column in first.table("events").items())
        assert equal, "the same seed gives two different runs"


def _check_message(message: WakeUpMessage) -> None:
    assert (message.target, message.step) == (PLAN.target, PLAN.step), "it names another target or step"
    assert message.bits > 0 and message.radius >= 0.0, "its bits or its radius are negative or zero"
    assert message.expires >= message.due == PLAN.due, "it expires before its step"
    numbers = (*message.centre, *message.fix, *message.heading, message.radius, message.expires)
    assert all(map(math.isfinite, numbers)), "it holds a number that is not finite"


def _check_decisions(wakeup: WakeUp, message: WakeUpMessage) -> None:
    """A component without a mechanism of its own decides for every node, by its arguments alone."""
    if isinstance(wakeup, StartsWakeUp):
        return
    for x in (0.0, 12.0, 60.0, 500.0):
        for seen, now in ((False, 13.0), (True, 13.0), (False, message.expires + 1.0)):
            decisions = [wakeup.decide((x, 0.0), message, seen, now, 0.5) for _ in range(2)]
            assert decisions[0] is decisions[1], "equal arguments give different decisions"
            assert isinstance(decisions[0], Decision), f"{decisions[0]!r} is not a Decision"


def _run(wakeup: WakeUp) -> Memory:
    """One run of the small network."""
    main = "detection" if wakeup.mechanism == "invite" else "prediction"
    setup = build(load({**SCENARIO, "clusters": {"kind": "moving_head", "main": main}}))
    assert isinstance(setup, NetworkSetup), "the scenario has a network and a target"
    memory = Memory()
    replicate_of(replace(setup, wakeup=wakeup), 0, memory)
    return memory


def _check_run(memory: Memory) -> None:
    wakeups, events = memory.table("wakeups"), memory.table("events")
    assert wakeups, "no head started a round"
    assert (wakeups["woken"] > 0).any(), "no node tracked at the step that it was woken for"
    down: set[int] = set()
    changes = {KIND["crash"]: down.add, KIND["death"]: down.add, KIND["restart"]: down.discard}
    sends = KIND["send"], KIND["call"]
    for kind, node in zip(events["kind"].tolist(), events["node"].tolist(), strict=True):
        if kind in changes:
            changes[kind](node)
        assert kind not in sends or node not in down, f"node {node} sends though it is down"
