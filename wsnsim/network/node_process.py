"""A sensor node as one SimPy process, created at its first wake-up.

A node that sleeps waits on one event: the target came into range, or a frame gave it a role. It falls asleep again
when it neither senses nor has a role, and dies when its battery is empty, in the middle of whatever it does.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, Final

import simpy

from wsnsim.base.radio import Mode
from wsnsim.network.event_log import Acting, ProtocolLog, then
from wsnsim.network.nodes import Nodes

TARGET: Final = "target"
FRAME: Final = "frame"
"""Why a node wakes or falls asleep."""
Change = Callable[[], Any]


class NodeProcess:
    """One node that has been awake at least once.

    `senses`: the targets that it senses; `serves`: those for which it has a role in a cluster; `awake_until`: those for
    which it stays awake until a time.
    """

    def __init__(self, processes: NodeProcesses, index: int) -> None:
        self.index = index
        self.senses: set[int] = set()
        self.serves: set[int] = set()
        self.awake_until: dict[int, float] = {}
        self._processes = processes
        self._env = processes.env
        self._awake = False
        self._changes: list[tuple[int, str, Change]] = []
        self._changed = self._env.event()
        self._activities: list[simpy.Process] = []
        self._process = self._env.process(self._run())

    def hear_target(self, target: int) -> None:
        """Note that the target came into sensing range."""
        self._change(target, TARGET, lambda: self.senses.add(target))

    def lose_target(self, target: int) -> None:
        """Note that the target left the sensing range."""
        self._change(target, TARGET, lambda: self.senses.discard(target))

    def serve(self, target: int) -> None:
        """Take a role, as member or as head."""
        self._change(target, FRAME, lambda: self.serves.add(target))

    def dismiss(self, target: int) -> None:
        """Give up the role: the cluster was dissolved."""
        self._change(target, FRAME, lambda: self.serves.discard(target))

    def keep_awake(self, target: int, until: float, why: str = FRAME) -> None:
        """Stay awake for a target at least until a time, because of a frame or a call."""
        known = self.awake_until.get(target)
        if known is not None and known >= until:
            return
        self.awake_until[target] = until
        if known is None:
            self._change(target, why, lambda: None)
            self._check_at(target, until)

    def release(self, target: int) -> None:
        """End `keep_awake` for a target."""
        if self.awake_until.pop(target, None) is not None:
            self._change(target, TARGET, lambda: None)

    def begin(self, activity: Acting[None]) -> None:
        """Run a generator in a process of its own, so that it ends with the node at whatever instant it goes down."""
        self._activities = [process for process in self._activities if process.is_alive]
        self._activities.append(self._env.process(activity))

    def stop(self) -> None:
        """Interrupt every process of a node that died or went down; the active one checks for itself."""
        for process in (self._process, *self._activities):
            if process.is_alive and process is not self._env.active_process:
                process.interrupt("death")

    def _check_at(self, target: int, until: float) -> None:
        """Follow the schedule again at a time, unless `keep_awake` was extended by then."""
        then(self._env.timeout(max(until - self._env.now, 0.0)), self._check, target, until)

    def _check(self, target: int, until: float) -> None:
        known = self.awake_until.get(target)
        if known is None:
            return
        if known > until:
            self._check_at(target, known)
        else:
            self.release(target)

    def _change(self, target: int, why: str, change: Change) -> None:
        if not self._processes.nodes.alive[self.index]:
            return
        self._changes.append((target, why, change))
        if not self._changed.triggered:
            self._changed.succeed()

    def _run(self) -> Acting[None]:
        try:
            while True:
                yield self._changed
                self._changed = self._env.event()
                changes, self._changes = self._changes, []
                for _, _, change in changes:
                    change()
                self._wake_or_sleep(*changes[0][:2])
                if not self._processes.nodes.alive[self.index]:
                    return
        except simpy.Interrupt:
            self._awake = False

    def _wake_or_sleep(self, target: int, why: str) -> None:
        busy = bool(self.senses or self.serves or self.awake_until)
        if busy == self._awake:
            return
        self._awake = busy
        nodes, log = self._processes.nodes, self._processes.log
        if nodes.is_scheduled_awake(self.index):
            log.add("stay" if busy else "resume", target, self.index, why if busy else "schedule")
        else:
            why = "schedule" if nodes.follows_schedules and not busy else why
            log.add("wake" if busy else "sleep", target, self.index, why)
            if busy:
                self._processes.on_wake(self.index, target, why != TARGET)
        nodes.set_mode(self.index, Mode.AWAKE if busy else nodes.rest_of(self.index))


class NodeProcesses:
    """The processes of all nodes that have been awake, by index.

    `on_wake(node, target, by_frame)` is called at each wake-up.
    """

    def __init__(
        self, env: simpy.Environment, nodes: Nodes, log: ProtocolLog, on_wake: Callable[[int, int, bool], None]
    ) -> None:  # fmt: skip
        self.env, self.nodes, self.log, self.on_wake = env, nodes, log, on_wake
        self._processes: dict[int, NodeProcess] = {}

    def of(self, index: int) -> NodeProcess:
        """The process of a node, created at the first call."""
        process = self._processes.get(index)
        if process is None:
            process = self._processes[index] = NodeProcess(self, index)
        return process

    def find(self, index: int) -> NodeProcess | None:
        """The process of a node, None if it has not been created."""
        return self._processes.get(index)

    def stop(self, index: int) -> None:
        """Interrupt what a node that went down is doing."""
        process = self._processes.get(index)
        if process is not None:
            process.stop()

    def forget(self, index: int) -> None:
        """Delete the process of a node that crashed: it restarts without a role."""
        self._processes.pop(index, None)

    def enlist(self, members: Iterable[int], target: int) -> None:
        """Give nodes a role for a target."""
        for index in members:
            self.of(index).serve(target)

    def dismiss(self, members: Iterable[int], target: int) -> None:
        """Take the role for a target from nodes."""
        for index in members:
            self.of(index).dismiss(target)
