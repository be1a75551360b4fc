"""A run without a network: one cluster of all sensors, every packet arrives, nothing takes time or energy.

    OfflineRun(setup, replicate, conditions, recorder, reports).run() -> RunResult

Trajectories, measurements and the tracker's random draws are the same as in a network with the same seed: a
measurement is a function of (seed, replicate, target, step, sensor). The first sensor is always the cluster head.
Frames and packets are counted as a network would have to send them. `RequestCosts` counts them.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from wsnsim.base import requests
from wsnsim.base.arrays import Bools, Estimate
from wsnsim.base.errors import ResultError, RunError, failed_run
from wsnsim.base.initial_conditions import InitialConditions
from wsnsim.base.ports import Scene
from wsnsim.base.results import RunResult, RunTotals, TrackResult
from wsnsim.base.rng import Streams
from wsnsim.base.rows import NAN, Issued, RunNow, TrackNow, follower_of, wants_belief, write_belief, write_readings
from wsnsim.base.sensing import gain_factors
from wsnsim.base.setups import TrackingSetup
from wsnsim.base.tables import Recorder
from wsnsim.offline.loopback import HEAD, Lose, OfflineCluster, ReportsOf, answer_to, perfect, perform


@dataclass
class RequestCosts:
    """Frames, packets and operations of all requests so far, and the measurements that entered the last flow."""

    frames: int = 0
    packets: int = 0
    cycles: float = 0.0
    readings: int = 0

    def answer(self, request: requests.Request, members: dict[int, requests.Member], head: int, lose: Lose) -> Any:
        """The answer to a request, which is counted. A broadcast is one frame for all receivers."""
        if isinstance(request, requests.GatherReadings):  # without a call for each measurement
            answer = answer_to(request, members, head, perfect)
            sent = len(answer.ids) - (head in answer.ids)
            self.frames += sent
            self.packets += sent
            self.readings = len(answer.ids) or self.readings
            return answer
        if isinstance(request, requests.Gather):
            return self._gathered(request, members, head)
        if isinstance(request, requests.Broadcast):
            self._add(request.parcel)
            return answer_to(request, members, head, perfect)
        answer = answer_to(request, members, head, self._carry)
        if isinstance(request, requests.Compute):
            self.cycles += request.cycles
        elif isinstance(request, requests.Local):
            cycles = request.cycles
            self.cycles += sum(cycles(members[node]) if callable(cycles) else cycles for node in answer)
            if request.uses_readings:
                self.readings = sum(members[node].reading is not None for node in answer)
        return answer

    def _gathered(self, request: requests.Gather, members: dict[int, requests.Member], head: int) -> Any:
        """The answer to a Gather, whose parcels say how many readings they carry."""
        parcel_of, sent = request.parcel_of, dict[int, int]()

        def noted(member: requests.Member) -> requests.Parcel | None:
            parcel = parcel_of(member)
            if parcel is not None:
                sent[member.id] = parcel.readings_of(member)
            return parcel

        request.parcel_of = noted
        answer = answer_to(request, members, head, self._carry)
        request.parcel_of = parcel_of
        self.readings = sum(sent.get(node, 0) for node in answer) or self.readings
        return answer

    def _carry(self, source: int, to: int, parcel: requests.Parcel) -> Bools:
        self._add(parcel)
        return requests.all_arrived(parcel.packets)

    def _add(self, parcel: requests.Parcel) -> None:
        self.frames += 1
        self.packets += parcel.packets


ASLEEP = {"woken": 0, "ineffective": 0}
"""No node is woken without a network."""
UNCALLED = {"reacquired": 0, "called": 0, "dismissed": 0, "handover_bits": float("nan")}


class OfflineRun:
    """One run of a tracker without a network."""

    def __init__(
        self,
        setup: TrackingSetup,
        replicate: int,
        conditions: InitialConditions,
        recorder: Recorder,
        reports: ReportsOf | None = None,
    ) -> None:
        self._setup, self._replicate, self._recorder = setup, replicate, recorder
        self._conditions, self._reports = conditions, reports
        self._streams = Streams(setup.seed, replicate)
        self._means = hashlib.blake2b(digest_size=8)
        self._costs = RequestCosts()

    def run(self, progress: Callable[[float], None] | None = None) -> RunResult:
        """Follow every target from start to end. A failure names seed, replicate and simulated time."""
        setup, costs = self._setup, self._costs
        heads = [HEAD] * (setup.steps + 1)
        targets = range(len(setup.motions))
        tracks = [TrackResult(self._follow(target, progress), heads, ASLEEP, UNCALLED) for target in targets]
        if self._recorder.wants("nodes"):
            self._recorder.write("nodes", node_rows(setup, self._conditions, self._replicate))
        totals = RunTotals(
            event_fingerprint=int.from_bytes(self._means.digest(), "little"),
            alive=len(self._conditions.positions),
            frames_sent=costs.frames,
            packets_sent=costs.packets,
            in_range=costs.frames,
            delivered=costs.frames,
            cycles=costs.cycles,
        )
        return RunResult(setup.steps, tracks, totals, {})

    def _follow(self, target: int, progress: Callable[[float], None] | None) -> dict[int, Issued]:
        """The estimates of one target by step."""
        setup, tracker, step = self._setup, self._setup.tracker, 0
        cluster = OfflineCluster(setup, target, self._conditions, self._streams, self._reports)
        estimates: dict[int, Issued] = {}
        follower = follower_of(self._recorder)
        try:
            scene = cluster.scene(0, 0)
            self._write_readings(scene, cluster)
            belief = self._perform(tracker.start(self._conditions.priors[target], scene), cluster)
            for step in range(1, setup.steps + 1):
                scene = cluster.scene(step, 1)
                self._write_readings(scene, cluster)
                belief = self._perform(tracker.step(belief, scene), cluster)
                estimates[step] = self._issue(scene, tracker.estimate(belief))
                if wants_belief(self._recorder):
                    key = {"replicate": self._replicate, "target": target, "step": step}
                    members = list(cluster.members.values())
                    write_belief(self._recorder, key, tracker, belief, members, setup.motions[target].columns)
                if follower is not None and follower.due():
                    follower.follow(RunNow(step + 1, scene.time, [TrackNow(target, estimates, [HEAD] * (step + 1))]))
                if progress:
                    progress(scene.time)
        except ResultError:  # the file cannot be written: the run itself is not to blame
            raise
        except (Exception, SystemExit) as reason:  # a plug-in may exit
            raise failed_run(step * setup.dt, setup.seed, self._replicate, reason) from reason
        return estimates

    def _write_readings(self, scene: Scene, cluster: OfflineCluster) -> None:
        if self._recorder.wants("readings"):
            taken = {node: cluster.members[node].reading for node in scene.ids}
            key = {"replicate": self._replicate, "target": scene.target, "step": scene.step, "time": scene.time}
            write_readings(self._recorder, key, {node: value for node, value in taken.items() if value is not None})

    def _perform(self, flow: requests.Flow[Any], cluster: OfflineCluster) -> Any:
        self._costs.readings = 0
        return perform(flow, cluster.members, HEAD, answer_of=self._costs.answer)

    def _issue(self, scene: Scene, estimate: Estimate) -> Issued:
        if not np.all(np.isfinite(estimate.mean)):
            raise RunError(f"the tracker's estimate at step {scene.step} is not finite: {estimate.mean}")
        self._means.update(np.ascontiguousarray(estimate.mean).tobytes())
        return Issued(scene.step, scene.time, estimate, HEAD, scene.active, len(scene.roster), self._costs.readings)


def node_rows(setup: TrackingSetup, conditions: InitialConditions, replicate: int) -> dict[str, Any]:
    """The rows of the table `nodes` of a run."""
    traits = conditions.traits
    unknown = np.full(len(traits), NAN)
    return {
        "replicate": replicate,
        "node": np.arange(len(traits)),
        "x": conditions.positions[:, 0],
        "y": conditions.positions[:, 1],
        "x_assumed": conditions.assumed[:, 0],
        "y_assumed": conditions.assumed[:, 1],
        "gain": gain_factors(setup.sensor.trait_names, traits),
        "energy_initial": unknown,
        "energy_left": unknown,
        "died_at": unknown,
    }
