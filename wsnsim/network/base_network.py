"""What networks with targets and networks without have in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import cast

import numpy as np
import simpy

from wsnsim.base.errors import ResultError, failed_run
from wsnsim.base.initial_conditions import InitialConditions
from wsnsim.base.mac_mechanisms import FollowsRestarts
from wsnsim.base.mechanisms import SensorDefect, SyncMechanism
from wsnsim.base.rng import Streams
from wsnsim.base.rows import RunNow, TrackNow, follower_of
from wsnsim.base.setups import RadioSetup
from wsnsim.base.tables import Recorder
from wsnsim.network.event_log import Acting, EventLog, StepClock
from wsnsim.network.faults import FaultSchedule, FaultSite
from wsnsim.network.mechanisms import NetworkSyncServices, make_mechanism
from wsnsim.network.node_states import Places
from wsnsim.network.radio.datagrams import Forwarding, Hops
from wsnsim.network.radio.radio_stack import RadioStack, make_radio_stack
from wsnsim.network.radio.routing import PathForwarding
from wsnsim.network.radio.transport import Transport
from wsnsim.network.result_rows import ClockErrors, EnergySteps, NetworkOutcome, ReportRows


class BaseNetwork(ABC):
    """A network: its nodes, their radio stack, the faults, and how nodes go down and come back.

    A subclass defines what happens in a step and how a death is logged.
    """

    def __init__(
        self, setup: RadioSetup, replicate: int, conditions: InitialConditions, streams: Streams, recorder: Recorder,
        count_links: bool = False,
    ) -> None:  # fmt: skip
        self._setup = setup
        self._replicate = replicate
        self._recorder = recorder
        self._follower = follower_of(recorder)
        self._event_log = log = EventLog(recorder, replicate)
        self._stack = stack = make_radio_stack(
            setup, conditions.positions, conditions.traits, streams, log, count_links
        )
        self._env, self._nodes = stack.radio.env, stack.radio.nodes
        if conditions.assumed is not conditions.positions:
            self._nodes.assumed = Places(conditions.assumed)
        self._clock = StepClock(self._env, setup.dt)
        hops = Hops(stack.radio, stack.mac)
        self._forwarding = make_forwarding(setup, stack, hops, streams.key("routing"))
        stack.radio.topology.on_change = self._forwarding.forget_links
        self._transport = Transport(stack.radio, stack.mac, hops, self._forwarding)
        self._reports = ReportRows(self._env, log, self._transport)
        self._energy_steps = EnergySteps(self._env, self._nodes, recorder)
        sync = NetworkSyncServices(self._env, self._nodes, stack.clocks, stack.mac, log, streams.key("sync"))
        self._sync: SyncMechanism = make_mechanism("sync", setup.sync, sync)
        self._clock_errors = ClockErrors(stack.clocks, self._nodes, self._sync, recorder)
        self._fault_key, self._defects = streams.key("faults"), dict[int, SensorDefect]()

    def _start(self) -> None:
        """Take down the nodes that died while the network was built, and begin with the faults."""
        actions = self._crash, self._restart, self._head_of
        site = FaultSite(self._env, self._nodes, self._event_log, self._stack.clocks, *actions, self._defects)
        self._faults = faults = FaultSchedule(self._setup.faults, site, self._fault_key, self._setup.dt)
        self._nodes.on_death, self._nodes.on_recharge = self._handle_death, self._handle_recharge
        for node in self._nodes.died_early:
            self._handle_death(node)
        faults.start()
        self._forwarding.start()
        self._sync.begin()

    def _run(self, steps: Acting[None], ended: simpy.Event | None = None) -> NetworkOutcome:
        """Start, take the steps to their end or until `ended`, and return the outcome.

        Errors name the seed, the run and the simulated time.
        """
        self._start()
        process = self._env.process(steps)
        try:
            self._env.run(until=process if ended is None else process | ended)
        except ResultError:
            raise
        except (Exception, SystemExit) as raised:  # a plug-in may exit
            reason = raised.__cause__ or raised
            raise failed_run(self._env.now, self._setup.seed, self._replicate, reason) from reason
        awake, radio_on = self._nodes.sleep_states.awake_fraction(self._env.now), self._nodes.consumption.radio_on()
        self._energy_steps.end(self._clock.step)
        self._energy_steps.write(self._replicate, self._setup.dt, self._recorder)
        self._clock_errors.write(self._replicate, self._recorder)
        self._reports.write(self._replicate, self._recorder)
        if self._stack.links is not None and (links := self._stack.links.columns()):
            self._recorder.write("links", {"replicate": self._replicate, **links})
        counters, fingerprint = self._stack.radio.counters, self._event_log.fingerprint()
        return NetworkOutcome(self._nodes, counters, fingerprint, awake, steps=self._clock.step, radio_on=radio_on)

    def _begin_step(self, step: int) -> None:
        """Close the step before, and count a new one."""
        if step:
            self._energy_steps.close(step - 1)
        self._clock.step = self._event_log.step = step
        self._tell_follower(step)
        self._clock_errors.note(step, self._env.now)

    def _tell_follower(self, step: int) -> None:
        """Write the events of the steps before, all of them if somebody follows the run, who then gets its state."""
        follower, nodes = self._follower, self._nodes
        is_due = follower is not None and follower.due()
        self._event_log.flush(everything=is_due)
        if follower is not None and is_due:
            now = self._env.now
            scheduled = nodes.consumption.network.scheduled(np.array([now]))[0]
            joules = [float(sum(each)) for each in zip(nodes.totals_now(), scheduled, strict=True)]
            left, spent = nodes.residual_energies(), nodes.spent_now()
            follower.follow(RunNow(step, now, self._tracks_now(), joules, left, spent))

    def _head_of(self, target: int) -> int | None:
        """The cluster head of a target; None in a network without targets."""
        return None

    def _tracks_now(self) -> list[TrackNow]:
        """The tracks so far; none in a network without targets."""
        return []

    def _handle_death(self, node: int) -> None:
        """Take down a node whose battery is empty, whatever it is doing: as in a crash if it can be charged again."""
        if self._nodes.is_empty(node):
            self._log_change("crash", node)
            self._crash(node)
            return
        self._nodes.died_at[node] = self._env.now
        self._log_change("death", node)
        self._take_down(node)

    def _handle_recharge(self, node: int) -> None:
        """Bring back a node whose battery was empty, unless a fault holds it down."""
        if not self._faults.holds(node):
            self._log_change("restart", node)
            self._restart(node)

    @abstractmethod
    def _log_change(self, kind: str, node: int) -> None: ...

    def _crash(self, node: int) -> None:
        """Take down a node: end what it does, and forget what it knows."""
        self._stack.mac.silence(node)
        self._nodes.crash(node)
        self._stack.clocks.forget(node)
        self._sync.forget(node)
        if node not in self._nodes.died_at:
            self._take_down(node)

    def _restart(self, node: int) -> None:
        """Bring back a node that was down, at rest and without a role."""
        self._nodes.restart(node, self._env.now)
        if isinstance(self._stack.mac, FollowsRestarts) and self._nodes.alive[node]:
            self._stack.mac.restart(node)
        self._forwarding.restore(node)

    def _take_down(self, node: int) -> None:
        """End what a node that is no longer up was doing."""
        self._forwarding.remove(node)
        self._stack.mac.silence(node)


def make_forwarding(setup: RadioSetup, stack: RadioStack, hops: Hops, key: int) -> Forwarding:
    """Return how the datagrams of a scenario find their way. `key`: the random key of what nodes do for it."""
    if setup.routing.weight == "etx":
        from wsnsim.models.workloads import CollectionTreeProtocol
        from wsnsim.network.radio.collection_tree import CollectionTree

        return CollectionTree(stack, hops, cast(CollectionTreeProtocol, setup.routing), stack.sinks, key)
    return PathForwarding(stack.radio, hops, setup.routing.weight, setup.link.audible, stack.sinks)
