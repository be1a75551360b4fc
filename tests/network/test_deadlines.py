"""Deadlines on a radio that one can buy: estimates come in time, and delays and hops are those of the event log."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from typing import Annotated, Any, NamedTuple

import numpy as np
import pytest

import wsnsim
from wsnsim import GatherReadings, Quantity, part
from wsnsim.base.tables import KIND, Memory
from wsnsim.trackers.ekf import ExtendedKalman

DT = 0.04
CLOCK = 1e-9
"""Times (s) that differ by less are equal but for rounding."""
ANSWERS: list[tuple[int, int, Any]] = []


@part
class Hasty(ExtendedKalman):
    """An extended Kalman filter that goes on after a deadline; (step, head, answer) of each gather is kept."""

    within: Annotated[float, Quantity("s", ge=0.0), "deadline of a step's readings"] = 0.03

    def step(self, belief, scene):
        flow, answer = super().step(belief, scene), None
        while True:
            try:
                request = flow.send(answer)
            except StopIteration as end:
                return end.value
            if not isinstance(request, GatherReadings):
                answer = yield request
                continue
            answer = yield replace(request, deadline=self.within)
            ANSWERS.append((scene.step, scene.head, answer))


class Arrival(NamedTuple):
    """A reading that the head had in time: its sender, and when it came, over how many hops."""

    step: int
    head: int
    sender: int
    time: float
    hops: int


class RealRun:
    """A run on the CC2420, its tables, and the readings that its heads had in time at punctual steps.

    At a punctual step the head requests at the step's instant: it had been done with the step before, as the same head.
    """

    def __init__(self, mac: str, within: float, *changes: str) -> None:
        ANSWERS.clear()
        said = [
            "duration=3 s", "seed=1000", "sink={kind: none}", f"mac={{kind: {mac}, rate: 250 kbit/s}}",
            f"tracker={{kind: '{__name__}:Hasty', within: {within} s}}", *changes,
        ]  # fmt: skip
        self.memory = Memory()
        wsnsim.experiment.simulate_run(wsnsim.load("ekf_real", said), 0, self.memory)
        self.answers = list(ANSWERS)
        self.estimates = self.memory.table("estimates")
        events = self.memory.table("events")
        chosen = np.isin(events["kind"], [KIND[kind] for kind in ("send", "relay", "receive")])
        chosen &= events["what"] == self.memory.words.code("reading")
        self.rows = [{name: column[i].item() for name, column in events.items()} for i in np.flatnonzero(chosen)]
        done = {step: (head, issued) for step, head, issued in self._columns("step", "head", "issued")}
        before = {step: done.get(step - 1, (-1, 0.0)) for step, *_ in self.answers}
        self.punctual = {
            step for step, head, _ in self.answers if before[step][0] == head and before[step][1] < step * DT - CLOCK
        }
        self.arrivals = [
            Arrival(step, head, sender, step * DT + delay, hops)
            for step, head, answer in self.answers
            if step in self.punctual
            for sender, delay, hops in zip(answer.ids, answer.delays.tolist(), answer.hops.tolist(), strict=True)
            if sender != head
        ]

    def _columns(self, *names: str) -> Iterator[tuple[Any, ...]]:
        return zip(*(self.estimates[name].tolist() for name in names), strict=True)

    def received(self, arrival: Arrival) -> list[dict[str, Any]]:
        """The rows of the event log that say that the head received the reading then."""
        return [
            row for row in self.rows
            if row["kind"] == KIND["receive"] and row["node"] == arrival.head
            and abs(row["time"] - arrival.time) < CLOCK
        ]  # fmt: skip


@cache
def real_run(mac: str, within: float, *changes: str) -> RealRun:
    """A run that several tests look at."""
    return RealRun(mac, within, *changes)


RADIOS = [("csma", 0.03), ("tdma", 0.03), ("tdma", 0.012)]


@pytest.mark.thorough
@pytest.mark.parametrize(("mac", "within"), RADIOS)
def test_with_a_deadline_of_less_than_a_step_estimates_come_in_time(mac, within) -> None:
    run = real_run(mac, within)
    assert len(run.punctual) > 55, "of 75 steps"
    assert max(answer.delays.max(initial=0.0) for *_, answer in run.answers) <= within + CLOCK
    steps = run.estimates["step"]
    issued = (run.estimates["issued"] - run.estimates["time"])[np.isin(steps, [*run.punctual])]
    assert issued.size == len(run.punctual) and issued.max() < within + 1e-3, "computing takes less than 1 ms"


@pytest.mark.thorough
@pytest.mark.parametrize(("mac", "within"), RADIOS)
def test_the_delays_of_a_real_run_are_those_of_its_event_log(mac, within) -> None:
    run = real_run(mac, within)
    assert len(run.arrivals) > 150
    sends = {(row["peer"], row["node"], row["sequence"]): row["time"] for row in reversed(run.rows)
             if row["kind"] == KIND["send"]}  # fmt: skip
    for arrival in run.arrivals:
        (row,) = [row for row in run.received(arrival) if row["peer"] == arrival.sender]
        sent = sends[arrival.head, arrival.sender, row["sequence"]]
        assert arrival.step * DT < sent <= arrival.time + CLOCK and arrival.hops == 1


def test_what_misses_the_deadline_is_received_later_and_not_used() -> None:
    run = real_run("tdma", 0.012)
    missed = 0
    for step, head, answer in run.answers:
        times = [row["time"] for row in run.rows if row["kind"] == KIND["receive"] and row["node"] == head]
        after = [time for time in times if step * DT + 0.012 + CLOCK < time < (step + 1) * DT]
        missed += len(after) if step in run.punctual else 0
        used = run.estimates["readings"][run.estimates["step"] == step]
        assert used.tolist() == [len(answer.ids)]
    assert missed > 50


@pytest.mark.thorough
@pytest.mark.parametrize("mac", ["csma", "tdma"])
def test_over_several_hops_of_a_real_radio_hops_and_delays_are_those_of_the_event_log(mac) -> None:
    few = ("sensor.reach=25 m", "deploy.cover=false")  # several hops of many readings take longer than a step
    run = real_run(mac, 0.03, "clusters={kind: central, x: 130 m, y: 110 m}", *few)
    hops = Counter(arrival.hops for arrival in run.arrivals)
    assert hops[2] > 15 and hops[3] > 15
    for arrival in run.arrivals:
        found = [path_of(run.rows, row) for row in run.received(arrival)]
        assert (arrival.sender, arrival.hops) in found


def path_of(rows: list[dict[str, Any]], last: dict[str, Any]) -> tuple[int, int]:
    """(origin, hops) of the datagram that a row received on its last hop."""
    node, hops, time = last["peer"], 1, last["time"]
    while True:
        before = [row for row in rows if row["kind"] == KIND["receive"] and row["node"] == node
                  and row["sequence"] == last["sequence"] and row["time"] < time]  # fmt: skip
        if not before:
            return node, hops
        node, hops, time = before[0]["peer"], hops + 1, before[0]["time"]
