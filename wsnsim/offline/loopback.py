"""A cluster without a network: its members, their measurements of a target, and flows whose requests are done at once.

belief = perform(tracker.step(belief, scene), {member.id: member for member in members}, head, lose)

There is no clock and no energy.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np

from wsnsim.base import requests
from wsnsim.base.arrays import Bools, Floats, Reading, as_readings, components_of, finite, planar
from wsnsim.base.initial_conditions import InitialConditions, measured_points, node_names
from wsnsim.base.optional_ports import Detects, Recording
from wsnsim.base.ports import Scene, SensorModel
from wsnsim.base.rng import HEAD_KEY, Streams, derive, derive_all, derive_each, reading_noise
from wsnsim.base.sensing import path_shadowing
from wsnsim.base.setups import TrackingSetup

Lose: TypeAlias = Callable[[int, int, requests.Parcel], Bools]
"""(source, destination, parcel) → mask of the packets that arrive."""
Answer: TypeAlias = Callable[[requests.Request, dict[int, requests.Member], int, Lose], Any]
"""(request, members, head, lose) → the answer to the request."""


def perfect(source: int, to: int, parcel: requests.Parcel) -> Bools:
    """The mask of a lossless network: everything arrives."""
    return requests.all_arrived(parcel.packets)


def silent(source: int, to: int, parcel: requests.Parcel) -> Bools:
    """The mask of a silent network: nothing arrives."""
    return np.zeros(parcel.packets, dtype=np.bool_)


def perform(
    flow: requests.Flow[Any],
    members: dict[int, requests.Member],
    head: int,
    lose: Lose = perfect,
    before: Callable[[requests.Request], None] | None = None,
    answer_of: Answer | None = None,
) -> Any:
    """Perform all requests of a flow; returns its belief.

    Args:
        flow: The flow of a tracker.
        members: Members of the cluster by id.
        head: Id of the cluster head.
        lose: Which packets arrive.
        before: Called with each request before it is performed.
        answer_of: Answers the requests; by default `answer_to`.
    """
    answer_of = answer_of or answer_to
    answer: Any = None
    while True:
        try:
            request = flow.send(answer)
        except StopIteration as end:
            return end.value
        if before:
            before(request)
        answer = answer_of(request, members, head, lose)


def answer_to(request: requests.Request, members: dict[int, requests.Member], head: int, lose: Lose) -> Any:
    """The answer to a request in a network that loses packets as `lose` says."""
    if isinstance(request, requests.Compute | requests.GatherLate):
        return None if isinstance(request, requests.Compute) else {}
    if isinstance(request, requests.GatherReadings):
        return _gather_readings(request, members, head, lose)
    if isinstance(request, requests.Local):
        return _compute(request, _addressed(request.who, members))
    if isinstance(request, requests.Gather):
        return _gather(request, _addressed(request.who, members), head, lose)
    if isinstance(request, requests.Exchange):
        return _exchange(request, members, lose)
    if isinstance(request, requests.Send):
        return _carry(head, request.to, request.parcel, lose)
    if isinstance(request, requests.Scatter):
        parcels = {i: parcel for i, parcel in request.parcels.items() if i in members}
    else:
        parcels = {i: request.parcel for i in members if i != head}
    return _deliver(parcels, members, head, lose)


def _addressed(who: Sequence[requests.NodeId] | None, members: Mapping[int, requests.Member]) -> list[requests.Member]:
    if who is None:
        return [member for member in members.values() if member.reading is not None]
    return [members[i] for i in who if i in members]


def _compute(request: requests.Local, addressed: list[requests.Member]) -> tuple[int, ...]:
    if request.work_all is not None and addressed:
        request.work_all(addressed)
    else:
        for member in addressed:
            request.work(member)
    return tuple(member.id for member in addressed)


def _gather(request: requests.Gather, addressed: list[requests.Member], head: int, lose: Lose) -> requests.Gathered:
    parcels = {member.id: request.parcel_of(member) for member in addressed}
    sent = {i: (parcel.payload, _carry(i, head, parcel, lose)) for i, parcel in parcels.items() if parcel is not None}
    return requests.Gathered(
        {i: (payload, mask) for i, (payload, mask) in sent.items() if mask.any()}, requests.Journeys(head)
    )


def _gather_readings(
    request: requests.GatherReadings, members: dict[int, requests.Member], head: int, lose: Lose
) -> requests.GatheredReadings:
    if lose is not perfect:
        return requests.GatheredReadings.of(_gather(request.gather(), _addressed(request.who, members), head, lose))
    readings = request.readings_of(members.values() if request.who is None else _addressed(request.who, members))
    values = np.array(list(readings.values()), dtype=np.float64)
    return requests.GatheredReadings(tuple(readings), values, requests.Journeys(head))


def _exchange(
    request: requests.Exchange, members: dict[int, requests.Member], lose: Lose
) -> dict[int, dict[int, Bools]]:
    """Every member is a neighbour of every other one."""
    senders = members.values() if request.who is None else _addressed(request.who, members)
    parcels = {member.id: request.parcel_of(member) for member in senders}
    heard: dict[int, dict[int, Bools]] = {}
    for source, parcel in parcels.items():
        for to, member in members.items():
            if parcel is None or to == source or not (mask := lose(source, to, parcel)).any():
                continue
            member.inbox.append(requests.Delivery(parcel.what, parcel.payload, mask, source))
            heard.setdefault(to, {})[source] = mask
    return heard


def _carry(source: int, to: int, parcel: requests.Parcel, lose: Lose) -> Bools:
    return requests.all_arrived(parcel.packets) if source == to else lose(source, to, parcel)


def _deliver(
    parcels: dict[int, requests.Parcel], members: dict[int, requests.Member], head: int, lose: Lose
) -> dict[int, Bools]:
    masks = {i: _carry(head, i, parcel, lose) for i, parcel in parcels.items()}
    heard = {i: mask for i, mask in masks.items() if mask.any()}
    for i, mask in heard.items():
        members[i].inbox.append(requests.Delivery(parcels[i].what, parcels[i].payload, mask))
    return heard


Rows: TypeAlias = Callable[[int, int], Floats]
"""(first, count) → (count, S) or (count, S, M) what sensors report from step `first` on; NaN where they do not."""
ReportsOf: TypeAlias = Callable[[TrackingSetup, InitialConditions, Streams, int], Rows]
"""(setup, initial conditions, streams, target) → reports of sensors that fail, or whose detection is imperfect."""
HEAD: Final = 0
"""The sensor that is the head of the cluster for the whole run."""
MOST_AHEAD: Final = 200_000
"""Measurements computed per block: enough to be fast, few enough for a field with many nodes."""


class OfflineCluster:
    """All sensors as one cluster for one target. `members` holds them by number.

    `reports` is needed unless `setup.reports_all`.
    """

    def __init__(
        self,
        setup: TrackingSetup,
        target: int,
        conditions: InitialConditions,
        streams: Streams,
        reports: ReportsOf | None = None,
    ) -> None:
        self._setup, self._target = setup, target
        self._assumed, self._traits = conditions.assumed, conditions.traits
        self._middle = np.array(setup.deploy.field.centre)
        self._track_key = derive(streams.key("tracker"), target)
        self._readings = readings_of(setup, target, conditions, streams, reports)
        counted = setup.recorded is not None and setup.recorded.counted
        self._counts = _recording(setup, target, len(self._assumed)).counts if counted else None
        self._length = max(1, min(len(conditions.truths[target]), MOST_AHEAD // len(self._assumed)))
        self._block = _Block(0, [], [], [])
        self._ids: tuple[int, ...] = ()
        self._rows = np.zeros(0, dtype=np.int64)
        sensors = zip(self._assumed, self._traits, strict=True)
        self.members = {
            node: requests.Member(node, position, traits) for node, (position, traits) in enumerate(sensors)
        }

    def scene(self, step: int, steps: int) -> Scene:
        """The scene of a step, `steps` after the last one; each member gets its measurement and its key."""
        setup, block = self._setup, self._block_of(step)
        before, ids, row = self._ids, block.ids[step - block.first], step - block.first
        if ids != before:
            self._ids, self._rows = ids, np.array(ids, dtype=np.int64)
        traits = self._traits_at(step)
        measuring = set(ids)
        for member, value, key in zip(self.members.values(), block.readings[row], block.keys[row], strict=True):
            member.reading, member.key = value if member.id in measuring else None, key
        return Scene(
            time=step * setup.dt,
            step=step,
            steps=steps,
            dt=setup.dt,
            target=self._target,
            head=HEAD,
            ids=ids,
            positions=self._assumed[self._rows],
            traits=traits[self._rows],
            roster=tuple(self.members),
            joined=() if ids == before else tuple([node for node in ids if node not in before]),
            left=() if ids == before else tuple([node for node in before if node not in ids]),
            field=setup.deploy.field,
            motion=setup.filter_motions[self._target],
            sensor=setup.filter_sensor,
            key=derive(self._track_key, step, HEAD_KEY),
            head_position=self._middle,
            roster_positions=self._assumed,
            roster_traits=traits,
        )

    def _traits_at(self, step: int) -> Floats:
        """(S, T) the traits of the sensors; with the number of readings that each measurement is the mean of."""
        if self._counts is None:
            return self._traits
        traits = np.column_stack([self._traits, np.maximum(self._counts[step], 1)])
        for member, own in zip(self.members.values(), traits, strict=True):
            member.traits = own
        return traits

    def _block_of(self, step: int) -> _Block:
        """The block of steps that holds this one, computed if it is not the present one."""
        if not self._block.first <= step < self._block.first + len(self._block.ids):
            readings = self._readings(step, self._length)
            numbers = np.arange(step, step + len(readings))
            nodes = np.arange(len(self.members), dtype=np.uint64)
            keys = derive_each(derive_all(self._track_key, numbers)[:, None], nodes[None, :])
            ids = [tuple(np.flatnonzero(known).tolist()) for known in finite(self._setup.sensor, readings)]
            self._block = _Block(step, ids, [as_readings(values) for values in readings], keys.tolist())
        return self._block


class _Block(NamedTuple):
    """Consecutive steps from `first` on: ids of the sensors with a measurement, all measurements, members' keys.

    The measurement of a sensor that has none is NaN.
    """

    first: int
    ids: list[tuple[int, ...]]
    readings: list[list[Reading]]
    keys: list[list[int]]


def readings_of(
    setup: TrackingSetup, target: int, conditions: InitialConditions, streams: Streams, reports: ReportsOf | None
) -> Rows:
    """The measurements of a target: what sensors report that may fail, what was recorded, or what is sampled."""
    if not setup.reports_all:
        assert reports is not None, "sensors that fail need somebody who says what they report"
        return reports(setup, conditions, streams, target)
    if setup.recorded is not None:
        recorded = _recording(setup, target, len(conditions.positions)).readings
        return lambda first, count: recorded[first : first + count]
    sensor, key = setup.sensor, derive(streams.key("sense"), target)
    points = measured_points(setup.motions[target], sensor, conditions.truths[target], setup.dt)
    shadowing = path_shadowing(sensor, points, key)

    def sampled(first: int, count: int) -> Floats:
        at = points[first : first + count]
        readings = sample_readings(sensor, at, conditions.positions, conditions.traits, key, first)
        if shadowing is not None:
            steps, nodes = np.nonzero(np.isfinite(readings))
            readings[steps, nodes] += shadowing.at(first + steps, nodes)
        return readings

    return sampled


def _recording(setup: TrackingSetup, target: int, sensors: int) -> Recording:
    assert setup.recorded is not None, "measurements are recorded"
    names = node_names(setup, sensors)
    return setup.recorded.recordings(names, len(setup.motions), setup.steps, setup.dt)[target]


def sample_readings(
    sensor: SensorModel, points: Floats, positions: Floats, traits: Floats, key: int, first: int = 0
) -> Floats:
    """(T, S) measurements of a target at points (T, P) by sensors at positions (S, 2); NaN out of range.

    Measurements of M > 1 components are (T, S, M).

    Args:
        sensor: The sensor model.
        points: Position of the target at the steps from `first` on.
        positions: Positions of the sensors.
        traits: (S, n) constants of the sensors.
        key: `derive(streams.key("sense"), target)`.
        first: Number of the first step.
    """
    if isinstance(sensor, Detects):
        detecting = sensor.detects(points, positions)
    else:
        apart = planar(points)[:, None, :] - positions[None, :, :]
        detecting = np.hypot(apart[..., 0], apart[..., 1]) <= sensor.reach
    count = len(components_of(sensor))
    readings = np.full(detecting.shape if count == 1 else (*detecting.shape, count), np.nan)
    steps, nodes = np.nonzero(detecting)
    noise = reading_noise(key, first + steps, nodes, count)
    readings[steps, nodes] = sensor.measure(points[steps], positions[nodes], traits[nodes], noise)
    return readings
