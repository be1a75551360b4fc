"""Contract checks for authors of plug-ins: whether a component keeps the rules of its interface.

    from wsnsim.testing import check_tracker
    check_tracker(MyTracker(particles=100))

A rule that is broken raises an AssertionError that names it.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, TypeAlias, cast

import numpy as np

from wsnsim.base.arrays import Bools, Estimate
from wsnsim.base.ports import HeadlessTracker, MotionModel, SensorModel, Tracker
from wsnsim.base.requests import Local, Member, Parcel, Request
from wsnsim.models.motion import BoundedVelocity
from wsnsim.models.sensing import AcousticEnergy
from wsnsim.offline.loopback import Lose, perfect, silent
from wsnsim.testing.batteries import check_battery
from wsnsim.testing.headless import check_headless
from wsnsim.testing.isolation import Isolation
from wsnsim.testing.macs import check_mac, check_wakeup
from wsnsim.testing.mechanisms import check_fault, check_sync, check_workload
from wsnsim.testing.models import check_motion, check_sensor
from wsnsim.testing.multi_trackers import check_multi_tracker
from wsnsim.testing.privacy import demand_missed_steps, examine, same
from wsnsim.testing.table import FIRST, SECOND, Play, Table, another, demand, demand_sound, examined, passed_on, track
from wsnsim.testing.whole_runs import demand_angles, demand_whole_runs

__all__ = [
    "Table",
    "check_battery",
    "check_fault",
    "check_mac",
    "check_motion",
    "check_multi_tracker",
    "check_sensor",
    "check_sync",
    "check_tracker",
    "check_wakeup",
    "check_workload",
    "track",
]


Models: TypeAlias = tuple[MotionModel, SensorModel, int]
"""The motion model, the sensor model and the seed of a check."""


def check_tracker(
    tracker: Tracker[Any] | HeadlessTracker,
    motion: MotionModel | None = None,
    sensor: SensorModel | None = None,
    seed: int = 1,
) -> None:
    """Check a tracker against every rule of the interface between tracker and network.

    Args:
        tracker: An instance of the tracker.
        motion: The motion model, for the target and for the filter; by default `BoundedVelocity`.
        sensor: The sensor model, for the nodes and for the filter; by default `AcousticEnergy`.
        seed: Seed of trajectory, positions, measurements and all keys.

    Raises:
        AssertionError: The tracker breaks a rule, which the message names. sound: estimates are finite, covariances
            symmetric and positive semidefinite, parcels have packets and bits, cycles are numbers, and something is
            sent. repeatable: the same seed gives the same belief. silence: in a silent network the belief does not
            depend on measurements of other members. privacy: `work` reads and changes its own member alone, and
            `work_all` gives the same as `work`. values: payloads are values, and the bits of a parcel suffice for
            them. isolation: while the same parcels arrive, other measurements at some members change neither the
            belief nor what the others send. loss: the first packet of each parcel is lost, the last, some, or all.
            early handover: all of this where the belief is handed over right after the start, and then again, before
            any step.
            whole runs: where it offers them (`wsnsim.plugins.WholeRuns`), they equal the runs that its requests make,
            and a run does not depend on the others of its block.
            missed steps: where the head missed steps (`scene.steps` is above 1), a tracker that predicts does so over
            all of them. angles: where readings have a period, or the tracker says `angles = True`, whole turns in
            readings and turned axes of the nodes move no estimate.
            Of a tracker without a head: sound, repeatable, privacy, values and loss; and locality: in a step a reading
            changes nothing at nodes that are more hops away than there are exchanges, and in a silent network at none.
    """
    target: Any = BoundedVelocity() if motion is None else motion
    nodes: Any = AcousticEnergy() if sensor is None else sensor
    models = target, nodes, seed
    if getattr(tracker, "headless", False):
        check_headless(cast(HeadlessTracker, tracker), *models)
        return
    tracker = examined(cast(Tracker[Any], tracker), Tracker, len(target.columns))
    with demand("sound"):
        _demand_sound(tracker, Table(*models))
    with demand("repeatable"):
        first, again = (list(track(tracker, Table(*models))) for _ in range(2))
        assert _all_equal(first, again), "the same seed gives two different tracks"
    with demand("silence"):
        _demand_silence(tracker, models)
    with demand("privacy"):
        for _ in track(tracker, Table(*models), watch=examine):
            pass
    with demand("values"):
        table = Table(*models)
        record = Isolation(table.known)
        believed = list(track(tracker, table, answer=record.answer))
    with demand("isolation"):
        for altered in _groups():
            _demand_isolation(tracker, models, record, believed, altered)
    for how, lose in _losses(seed).items():
        with demand(f"loss ({how})"):
            demand_sound(track(tracker, Table(*models), lose))
    _demand_early_handover(tracker, models)
    with demand("whole runs"):
        demand_whole_runs(tracker, *models)
    with demand("missed steps"):
        demand_missed_steps(tracker, *models)
    with demand("angles"):
        demand_angles(tracker, *models)


def _demand_sound(tracker: Tracker[Any], table: Table) -> None:
    bits = 0

    def count(source: int, to: int, parcel: Parcel) -> Bools:
        nonlocal bits
        bits += parcel.packets * parcel.packet_bits
        return perfect(source, to, parcel)

    demand_sound(track(tracker, table, count, watch=_ask_for_cycles))
    assert bits > 0, "nothing ever crosses the air: members must send measurements or results to the head"


def _ask_for_cycles(request: Request, members: dict[int, Member]) -> None:
    """Let each member's work be followed by the question how many cycles it took."""
    if isinstance(request, Local) and callable(request.cycles):
        work, cycles = request.work, request.cycles
        request.work, request.work_all = lambda member: (work(member), cycles(member), None)[-1], None


def _demand_early_handover(tracker: Tracker[Any], models: Models) -> None:
    """Hand over before the first step, once and twice, in lossless, lossy and silent networks; then step."""
    for handovers in (1, 2):
        with demand(f"early handover ({handovers} before the first step)"):
            table = Table(*models)
            found = list(passed_on(tracker, Play(table, answer=Isolation(table.known).answer), handovers))
            again = list(passed_on(tracker, Play(Table(*models), watch=examine), handovers))
            assert _all_equal(found, again), "the same seed gives two different tracks"
            demand_sound(found)
        for how, lose in _losses(models[-1]).items():
            with demand(f"early handover ({handovers} before the first step, loss: {how})"):
                demand_sound(passed_on(tracker, Play(Table(*models), lose), handovers))


def _demand_silence(tracker: Tracker[Any], models: Models) -> None:
    heads = (FIRST[0], SECOND[0])
    loud = Table(*models, alter=lambda node, value: value if node in heads else another(value))
    quiet = list(track(tracker, Table(*models), silent))
    assert _all_equal(quiet, list(track(tracker, loud, silent))), (
        "in a silent network the belief depends on readings of other members"
    )


def _groups() -> Iterator[frozenset[int]]:
    """Groups of members, so that of any two members some group holds one and not the other. Heads are in none."""
    nodes = sorted({*FIRST[1:], *SECOND[1:]})
    for bit in range((len(nodes) - 1).bit_length()):
        for side in (0, 1):
            yield frozenset(node for place, node in enumerate(nodes) if place >> bit & 1 == side)


def _demand_isolation(
    tracker: Tracker[Any], models: Models, record: Isolation, believed: list[Estimate], altered: frozenset[int]
) -> None:
    """Repeat a recorded track with other readings at some members; the head gets what it got before."""
    table = Table(*models, alter=lambda node, value: another(value) if node in altered else value)
    again = Isolation(table.known, record.gathered, altered)
    assert _all_equal(believed, list(track(tracker, table, answer=again.answer))), (
        f"the same parcels arrived, and the belief depends on readings of nodes {sorted(altered)} that were not in them"
    )


def _losses(seed: int) -> dict[str, Lose]:
    rng = np.random.default_rng(seed)

    def without(index: int) -> Lose:
        def lose(source: int, to: int, parcel: Parcel) -> Bools:
            mask = np.ones(parcel.packets, dtype=np.bool_)
            mask[index] = False
            return mask

        return lose

    def some(source: int, to: int, parcel: Parcel) -> Bools:
        return rng.random(parcel.packets) > 0.3

    return {"the first packet": without(0), "the last packet": without(-1), "some packets": some, "all packets": silent}


def _all_equal(first: list[Estimate], second: list[Estimate]) -> bool:
    return len(first) == len(second) and all(
        same((a.mean, a.cov), (b.mean, b.cov)) for a, b in zip(first, second, strict=True)
    )
