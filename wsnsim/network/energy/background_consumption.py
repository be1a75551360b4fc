"""Background consumption: idle listening, sleep, and measurements that look for targets.

No event happens until a node spends energy or is asked for it: then it is *settled*, which means that its consumption
since the last time is computed and booked. The consumption is a function of the state of the node (its mode, and what
its radio does in it: see `power_table`), less the seconds in which its radio or its processor was busy. The totals of
the network are computed without a loop over nodes: see `network_totals`. A node that may run out before the end has a
battery timer.

The consumption of a node that follows a sleep schedule is a closed form of the schedule, and so is that of a radio that
follows a *duty*, which is a duty cycle of its MAC.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import simpy

from wsnsim.base.arrays import Floats, Ints, scalars
from wsnsim.base.radio import Mode
from wsnsim.kernels.nodes import mark_busy
from wsnsim.network.energy.battery_watch import BatteryWatch
from wsnsim.network.energy.ledger import Charges
from wsnsim.network.energy.network_totals import NetworkTotals
from wsnsim.network.energy.power_table import HELD, IDLE, MODES, ON, SENSE, SLEEP, SWITCH, PowerTable, RadioLevels
from wsnsim.network.energy.storage import BatteryRates
from wsnsim.network.node_states import SleepStates


class BackgroundConsumption:
    """The background consumption of all nodes; it is none if the table has zeros only.

    It knows neither the nodes nor their ledger: `Nodes` requests charges and books them. The energy of sending,
    receiving and computing is booked elsewhere: the `mark_` methods exclude that time here.

    Attributes:
        most: Joules that one node can consume at most in the whole run.
        network: The totals of the network.
        levels: What a duty-cycled MAC does with the radios.
        battery_watch: Checks nodes that may run out.
    """

    def __init__(
        self, env: simpy.Environment, table: PowerTable, sleep_states: SleepStates, size: int, horizon: float,
        battery: float, check: Callable[[int], None],
    ) -> None:  # fmt: skip
        """Begin at time 0.

        Args:
            env: The clock.
            table: The power of a node in each state.
            sleep_states: Which nodes are awake; all are in its mode `rest`.
            size: Number of nodes.
            horizon: End of the run in s.
            battery: J that every node has at the start; 0: all are looked at when the run begins.
            check: Called with a node that may have run out, or with EVERYBODY.
        """
        self._env = env
        self._table = table
        model = table.model
        self._sleep_states = sleep_states
        rest = sleep_states.rest
        self._radio, self._radio_cause, self._share = table.radio, table.radio_cause, table.share
        self._processor, self._processor_cause = table.processor, table.processor_cause
        self._scheduled = table.scheduled
        self._per_switch = (model.switching(Mode.AWAKE, Mode.ASLEEP) + model.switching(Mode.ASLEEP, Mode.AWAKE)) / 2.0
        self._states = np.full(size, int(rest), dtype=np.int16)
        # seconds at which each node was settled, and those excluded since then for its radio and its processor
        self._settled_at, self._radio_busy, self._computed = (np.zeros(size) for _ in range(3))
        self._counts = np.zeros(len(self._radio), dtype=np.int64)
        # views of the same arrays for one node at a time, which are faster to index
        self._state, self._since = scalars(self._states), scalars(self._settled_at)
        self._radio_busy_of, self._computed_of = scalars(self._radio_busy), scalars(self._computed)
        self._radio_law = np.array(self._radio), np.array(self._radio_cause, dtype=np.int64)
        self.network = NetworkTotals(table, sleep_states, size, self._per_switch)
        self._network_joules = self.network.joules
        self.levels = RadioLevels(table, size)
        self._duty_cycled = self.levels.active
        self._off = np.array(table.off)
        self._off_of = scalars(self._off)
        self.battery_watch = BatteryWatch(env, table, sleep_states, self._per_switch, horizon, battery, check)
        self.most = self.battery_watch.most
        self._free = not (self.most or self._per_switch or table.duties)
        """Whether nothing is consumed: time costs nothing, or the run is over."""

    def _charges(self, node: int) -> tuple[list[tuple[int, float]], float]:
        """(cause, joules) since the node was settled, negative if paid in advance; and the seconds it was awake."""
        state, passed = self._state[node], self._env.now - self._since[node]
        busy, computed = self._radio_busy_of[node], self._computed_of[node]
        awake = passed
        if self._scheduled[state]:
            awake, switches = self._sleep_states.tally_one(node, self._since[node], self._env.now)
            switched = self._per_switch * switches
            charges = self._table.by_schedule(awake, passed, switched, busy, computed, state // MODES)
        else:
            charges = self._table.by_state(state, passed, busy, computed)
        if self._duty_cycled:  # the last two charges are listening and switching by the duty: see `PowerTable.by_state`
            charges[-2:] = self.levels.with_added(node, charges[-2:])
        return charges, awake

    def pending(self, node: int) -> float:
        """Joules consumed since the node was last settled. Changes nothing."""
        return 0.0 if self._free else sum(max(joules, 0.0) for _, joules in self._charges(node)[0])

    def pending_charges(self, nodes: Ints) -> Iterator[tuple[Ints, int, Floats]]:
        """(nodes, cause, joules) consumed since the nodes were settled, in pieces.

        They are negative if the MAC subtracted more from the consumption of a duty than has accrued since.
        """
        if self._free:
            return
        states, now = self._states[nodes], self._env.now
        for state in np.unique(states).tolist():
            chosen = nodes[states == state]
            passed, busy, computed = now - self._settled_at[chosen], self._radio_busy[chosen], self._computed[chosen]
            if self._scheduled[state]:
                awake, switches = self._sleep_states.tally(chosen, self._settled_at[chosen], now)
                switched = self._per_switch * switches
                charges = self._table.by_schedule(awake, passed, switched, busy, computed, state // MODES)
            else:
                charges = self._table.by_state(state, passed, busy, computed)
            of_duty = [] if not self._duty_cycled else charges[-2:]
            for cause, joules in charges[: len(charges) - len(of_duty)]:
                if cause != SENSE or self._table.sensor[state]:
                    yield chosen, cause, np.maximum(joules, 0.0)
            for cause, joules in of_duty:
                yield chosen, cause, joules + self.levels.added[cause][chosen]

    def settle(self, node: int) -> Charges:
        """Return what a node has consumed since it was last settled, and regard it as booked."""
        if self._free:
            return ()
        charges, passed = self._charges(node)
        state = self._state[node]
        if self._duty_cycled:
            self.levels.settle(node, charges[-2:], passed, state // MODES)
        charges = [(cause, joules) for cause, joules in charges if joules > 0]
        self._since[node] = self._env.now
        self._radio_busy_of[node] = max(self._radio_busy_of[node] - self._share[state] * passed, 0.0)
        self._computed_of[node] = max(self._computed_of[node] - passed, 0.0)
        self.network.note_booked(charges)
        return charges

    def mark_radio_busy(self, node: int, seconds: float) -> None:
        """Exclude the seconds in which the radio of a node sends or receives."""
        if self._free:
            return
        state = self._state[node]
        self._network_joules[self._radio_cause[state]] -= self._radio[state] * seconds
        if self._duty_cycled:
            self._network_joules[ON] += self._off_of[state] * seconds
        self._radio_busy_of[node] += seconds

    def mark_radios_busy(self, nodes: Ints, seconds: float) -> None:
        """`mark_radio_busy` for different nodes (n,)."""
        if self._free:
            return
        mark_busy(nodes, seconds, self._radio_busy, self._states, self._counts, *self._radio_law, self.network.array)
        if self._duty_cycled:
            self._network_joules[ON] += float(self._off @ self._counts) * seconds

    def mark_computing(self, node: int, cycles: float) -> None:
        """Exclude the time in which the processor of a node computes a number of cycles."""
        if self._free:
            return
        seconds = self._table.model.seconds(cycles)
        state = self._state[node]
        self._network_joules[self._processor_cause[state]] -= self._processor[state] * seconds
        self._computed_of[node] += seconds

    def sleep_radio(self, node: int, seconds: float) -> Charges:
        """Return the charges of a radio that sleeps for this time, which the caller has marked as busy."""
        joules = self._table.off_power * seconds
        if not joules:
            return ()
        self._network_joules[SLEEP] += joules
        return ((SLEEP, joules),)

    def switching(self, node: int, mode: Mode) -> float:
        """Joules that the change of a node to a mode costs."""
        return self._table.model.switching(
            self._resolved(node, Mode(self._state[node] % MODES)), self._resolved(node, mode)
        )

    def _resolved(self, node: int, mode: Mode) -> Mode:
        """The mode, or what the schedule says now if it is SCHEDULED."""
        return mode if mode is not Mode.SCHEDULED else self._sleep_states.scheduled(node)

    def change_mode(self, node: int, mode: Mode) -> None:
        """A settled node is in another mode from now on. If it goes down, the state of its duty is lost."""
        level = self._state[node] // MODES
        if mode is Mode.DOWN and self._duty_cycled:
            level = 0
            self.levels.forget(node)
            listened, switched = self.levels.of(node)
            self._add(node, -listened, -switched)
        self._enter(node, level * MODES + int(mode))

    def _enter(self, node: int, after: int) -> None:
        """A settled node is in another state from now on."""
        if not self._free:
            busy, computed = self._radio_busy_of[node], self._computed_of[node]
            self.network.change_state(self._state[node], after, busy, computed, self._env.now)
        self._state[node] = after
        self._since[node] = self._env.now
        if self._duty_cycled:
            self.levels.enter(node, after // MODES, self._scheduled[after])

    def hold_radio(self, node: int, on: bool) -> None:
        """Keep the radio of a settled node on from now on.

        Args:
            node: The node.
            on: Whether the radio was on already, in a wake-up of its duty; if not, its start is charged.
        """
        if self._duty_cycled:
            self.levels.hold(node, self._env.now, on)
            self._enter(node, HELD * MODES + self._state[node] % MODES)
            self._add(node, 0.0, 0.0 if on else self._table.start)

    def release_radio(self, node: int, missed: float | None) -> None:
        """The radio of a settled node that was held follows its duty again.

        Args:
            node: The node.
            missed: How many wake-ups of its duty fell into the time of the hold; None: the average number.
        """
        since, on, level = self.levels.release(node)
        self._enter(node, level * MODES + self._state[node] % MODES)
        self._add(node, 0.0, 0.0 if on else self._table.stop)
        if missed is not None:
            duty = self._table.duties[max(level - 1, 0)]
            wake_ups = (self._env.now - since) / duty.interval - missed
            self.add_listening(node, wake_ups * duty.on, wake_ups * duty.starts)

    def set_duty(self, node: int, index: int) -> None:
        """A settled node follows another of the duties of its MAC, from now on or after the release of a held radio."""
        level = self.levels.set_duty(node, index)
        if not self.levels.is_held(node):
            self._enter(node, level * MODES + self._state[node] % MODES)

    def add_listening(self, node: int, seconds: float, starts: float) -> None:
        """The radio of a node listens for `seconds` in addition to its duty, with `starts` additional starts.

        These seconds are subtracted from its sleep. Both are negative for less than the duty has.
        """
        table, state = self._table, self._state[node]
        if self._duty_cycled:
            self._add(node, table.listen * seconds, (table.start + table.stop) * starts)
            self._network_joules[ON] += seconds
            if table.off[state]:
                self._network_joules[self._radio_cause[state]] -= self._radio[state] * seconds
                self._radio_busy_of[node] += seconds

    def _add(self, node: int, listened: float, switched: float) -> None:
        """Add joules of listening and of switching to what the duty of a node consumes; they may be negative."""
        self.levels.add(node, listened, switched)
        self._network_joules[IDLE] += listened
        self._network_joules[SWITCH] += switched

    def added(self, node: int) -> float:
        """Joules that `_add` has added since the node was settled."""
        return sum(self.levels.of(node))

    def totals(self, settled: list[float]) -> list[float]:
        """The network's totals by cause until now, given the settled ones, without `network.scheduled`."""
        return settled if self._free else self.network.until(self._env.now, settled, self._awake_at())

    def close(self) -> None:
        """The end of a run: everything is booked, and nothing is consumed from now on."""
        self._free = True

    def radio_on(self) -> float | None:
        """Share of the time of all nodes until now in which radios were on: sent, received or listened."""
        return self.network.radio_on(self._env.now, self._awake_at()) if self._duty_cycled else None

    def _awake_at(self) -> list[float]:
        """Seconds for which nodes with schedules were awake, by the level of their radios."""
        return self.levels.awake(self._sleep_states, self._settled_at, self._env.now)

    def watch(self, node: int, left: float, supply: BatteryRates) -> None:
        """Set a timer for a node with `left` joules, if it may run out before the end."""
        self.battery_watch.watch(node, self._state[node], left, supply)

    def runs_out(self, node: int, left: float, supply: BatteryRates) -> bool:
        """Whether `left` joules of a node are only rounding error, so that its battery is empty."""
        return self.battery_watch.runs_out(node, self._state[node], left, supply)
