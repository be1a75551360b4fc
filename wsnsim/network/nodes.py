"""The nodes of a network as arrays: how they change their modes, what they spend, and what is left.

What is *spent* is in the energy ledger; what is left is derived from it, and reading it changes nothing. Background
consumption is settled when a node next spends: see `energy.background_consumption`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
import simpy

from wsnsim.base.arrays import Bools, Floats, Ints
from wsnsim.base.radio import Mode, NoPower
from wsnsim.base.tables import CAUSE
from wsnsim.network.energy.background_consumption import BackgroundConsumption
from wsnsim.network.energy.battery_watch import EVERYBODY, LOAD_ALONE
from wsnsim.network.energy.ledger import AMPLIFIER, ELECTRONICS, IDLE, Charges, EnergyLedger, affordable
from wsnsim.network.energy.power_table import PowerTable
from wsnsim.network.energy.storage import ROUNDING, Storage
from wsnsim.network.node_states import NodeStates, SleepStates

RECEIVE, SWITCH = CAUSE["rx"], CAUSE["switch"]
BELOW_BATTERY: Final = 1.0 - 4e-16
"""Share of a battery that no sum of charges rounds up to the whole battery."""


class Nodes(NodeStates):
    """The nodes of a network. Where they stand and which of them listen is inherited.

    Attributes:
        battery: Initial charge of a node in J, or the greatest of what nodes can draw at the start.
        storage: The batteries of nodes that do not all have `battery`, or that time changes; None: there are none.
        on_death: Called with a node whose battery is empty (since `died_at`); until set, `died_early` collects them.
        on_recharge: Called with a node whose battery was empty, and is charged so that the node can start again.
    """

    def __init__(  # noqa: PLR0913
        self, positions: Floats, traits: Floats, battery: float, reach: float,
        sleep_states: SleepStates | None = None, env: simpy.Environment | None = None, table: PowerTable | None = None,
        horizon: float = 0.0, storage: Storage | None = None,
    ) -> None:  # fmt: skip
        """By default time costs nothing.

        Args:
            positions: (N, 2) in m.
            traits: (N, T) constants of the sensors.
            battery: Initial charge of a node in J; not used with a storage.
            reach: Communication range in m.
            sleep_states: Which nodes are awake; by default all.
            env: The clock.
            table: The power of a node in each state.
            horizon: End of the run in s.
            storage: The batteries, if they are not all of `battery` and nothing else.
        """
        super().__init__(positions, traits, reach, SleepStates() if sleep_states is None else sleep_states)
        self.battery = battery if storage is None else storage.full
        self.storage = storage
        self.died_at: dict[int, float] = {}
        self.ledger = EnergyLedger(self.size)
        self.died_early: list[int] = []
        self.on_death: Callable[[int], None] = self.died_early.append
        self.on_recharge: Callable[[int], None] = lambda node: None
        self._spent = self.ledger.spent_by
        self._timed = storage if storage is not None and storage.timed else None
        if storage is not None:
            storage.begin(self.ledger)
        self.consumption = BackgroundConsumption(
            env or simpy.Environment(), table or PowerTable(NoPower()), self.sleep_states, self.size, horizon,
            battery if storage is None else storage.least, self._check,
        )  # fmt: skip
        # A node owes at most `most` until it is settled, and may still consume as much: below twice that, settle first.
        self._reserve, self._tight = self.consumption.most, 2.0 * self.consumption.most
        if self._timed is not None:  # what is left is known only when a node is settled
            self._reserve = self._tight = np.inf
        if storage is not None:
            for node in np.flatnonzero(self.ledger.spent >= self.battery).tolist():
                self._die(node, ())

    def note_clock(self, node: int) -> None:
        """The clock of a node has been stepped or corrected: its schedule changes at other times than expected."""
        self.sleep_states.note_clock(node)
        if self.alive[node] and self.battery - self._spent[node] <= self._reserve:
            self._watch(node)

    def keep_awake(self, node: int) -> None:
        """Keep a node awake for the whole run, whatever its schedule says."""
        if self.follows_schedules:
            self._always_awake.add(node)
            self.set_mode(node, Mode.AWAKE)

    def begin_sending(self, node: int) -> None:
        """A node has a frame to send: it stays awake until `end_sending`, even if its schedule ends before."""
        if self.follows_schedules and self.sleep_states.begin_sending(node):
            self._change_mode(node, Mode.AWAKE)

    def end_sending(self, node: int) -> None:
        """A node has nothing more to send."""
        if self.follows_schedules and self.sleep_states.end_sending(node):
            self._change_mode(node, self.rest_of(node))

    def hold_radio(self, node: int, on: bool = False) -> None:
        """Switch the radio of a node on, until `release_radio`; nothing happens if it is held already.

        It listens, and pays for it, while it neither sends nor receives. Only for duty-cycled MACs (see
        `base.medium_access`): a radio that follows no duty always listens. A node with a sleep schedule must be held
        awake meanwhile: see `begin_sending`.

        Args:
            node: The node.
            on: Whether the radio is on already, in a wake-up of its duty. Neither start nor stop are then charged,
                which belong to that wake-up.
        """
        if self.alive[node] and not self.consumption.levels.is_held(node) and self._settle(node):
            self.consumption.hold_radio(node, on)
            self._pay_added(node)

    def release_radio(self, node: int, missed: float | None = None) -> None:
        """Let the radio of a node follow its duty again; nothing happens if it is not held.

        Args:
            node: The node.
            missed: In how many wake-ups of its duty it was held: they were not charged. None: as many as there are on
                average in that time.
        """
        if self.consumption.levels.is_held(node) and self._settle(node):
            self.consumption.release_radio(node, missed)
            self._pay_added(node)

    def set_duty(self, node: int, index: int) -> None:
        """Let the radio of a node follow another of the duties of its MAC from now on, given the number of the duty."""
        if self.alive[node] and self._settle(node):
            self.consumption.set_duty(node, index)
            self._pay_added(node)

    def spend_listening(self, node: int, seconds: float, starts: float = 0.0) -> None:
        """Charge a radio that follows a duty for listening and for starts in addition to that; less if negative.

        The frames that such a radio sends and receives are charged in addition to its duty, too: a MAC gives back the
        listening whose place they take.
        """
        if self.alive[node]:
            self.consumption.add_listening(node, seconds, starts)
            self._pay_added(node)

    def _pay_added(self, node: int) -> None:
        """Book at once what was added to a node's consumption if it may run out."""
        left = self.battery - self._spent[node] - self.consumption.added(node)
        if left <= self._tight and self._settle(node):
            self._watch(node)

    def set_mode(self, node: int, mode: Mode) -> None:
        """A node has a task that needs a mode, or none. It pays for the change of mode and may die of it."""
        if self.alive[node] and self.sleep_states.may_change(node, mode):
            self._change_mode(node, mode)

    def _change_mode(self, node: int, mode: Mode) -> None:
        joules = self.consumption.switching(node, mode)
        self._settle(node)
        if self.alive[node]:
            self._enter(node, mode)
            if joules:
                self.spend(node, SWITCH, joules)
            else:
                self._watch(node)

    def _enter(self, node: int, mode: Mode) -> None:
        """A settled node is in another mode from now on."""
        self.consumption.change_mode(node, mode)
        self.sleep_states.note(node, mode)

    def crash(self, node: int) -> None:
        """A node that is up goes down and keeps its charge."""
        self._settle(node)
        if self.alive[node]:
            self._go_down(node)

    def restart(self, node: int, now: float) -> None:
        """A node that crashed comes back, with nothing to do. What is on the air has begun without it."""
        if not self.alive[node] and not self.is_empty(node):
            self._mark_up(node, now)
            self._settle(node)
            self._enter(node, self.rest_of(node))
            self._watch(node)

    def _go_down(self, node: int) -> None:
        self._mark_down(node)
        self._enter(node, Mode.DOWN)

    def spend(self, node: int, cause: int, joules: float) -> float:
        """Book joules on a node that is up; returns those that were spent, fewer if the node died of it."""
        if self.battery - self._spent[node] - joules <= self._tight and not self._settle(node):
            return 0.0
        spent = self._spent[node]
        left = self.battery - spent
        if spent + joules >= self.battery:
            self._die(node, ((cause, left),))
            return float(left)
        self.ledger.book(node, cause, joules)
        if self.battery - self._spent[node] <= self._reserve:
            self._watch(node)
        return joules

    def spend_transmit(self, node: int, electronics: float, amplifier: float, bits: int, seconds: float = 0.0) -> int:
        """Book the joules of a transmission of `seconds`, during which the radio is not idle.

        Returns the whole bits that were paid for: fewer than `bits` if the node died of it.
        """
        if seconds:
            self.consumption.mark_radio_busy(node, seconds)
        joules = electronics + amplifier
        if self.battery - self._spent[node] - joules <= self._tight and not self._settle(node):
            return 0
        spent = self._spent[node]
        if spent + joules >= self.battery:
            paid = min(int(bits * (self.battery - spent) / joules), bits)
            share = paid / bits
            self._die(node, ((ELECTRONICS, electronics * share), (AMPLIFIER, amplifier * share)))
            return paid
        self.ledger.book_transmission(node, electronics, amplifier)
        if self.battery - self._spent[node] <= self._reserve:
            self._watch(node)
        return bits

    def spend_receive(self, node: int, joules: float, bits: int, cause: int = RECEIVE, seconds: float = 0.0) -> int:
        """Book a reception; returns the whole bits that were paid for, fewer if the node died of it."""
        if seconds:
            self.consumption.mark_radio_busy(node, seconds)
        if self.battery - self._spent[node] - joules <= self._tight and not self._settle(node):
            return 0
        spent = self._spent[node]
        if spent + joules >= self.battery:
            paid = min(int(bits * (self.battery - spent) / joules), bits)
            self._die(node, ((cause, joules * paid / bits),))
            return paid
        self.ledger.book(node, cause, joules)
        if self.battery - self._spent[node] <= self._reserve:
            self._watch(node)
        return bits

    def can_all_receive(self, nodes: Ints, joules: float) -> bool:
        """Whether none of the nodes (n,) could die of a reception: `receive_all` may book it."""
        limit = self.battery * BELOW_BATTERY - joules - self._reserve
        below = self.ledger.ceiling < limit or self.ledger.lower_ceiling(self.living) < limit
        return below or self.ledger.all_below(limit, nodes)

    def receive_all(self, nodes: Ints, joules: float, cause: int, seconds: float) -> None:
        """Book a reception that kills none of the different nodes (n,)."""
        self.ledger.book_same(nodes, cause, joules)
        self.consumption.mark_radios_busy(nodes, seconds)

    def sleep_radios(self, nodes: Ints, seconds: float) -> None:
        """The radios of nodes sleep for a while instead of listening. Switching them is not charged."""
        chosen = nodes[self.living[nodes]]
        self.consumption.mark_radios_busy(chosen, seconds)
        for node in chosen.tolist():
            tight = self.battery - self._spent[node] <= self._tight
            if not tight or self._settle(node):
                self._book_consumed(node, self.consumption.sleep_radio(node, seconds))
            if tight and self.alive[node]:
                self._watch(node)

    def close(self) -> None:
        """Settle all nodes: the end of a run, after which nothing is consumed."""
        living = np.flatnonzero(self.living)
        tight = self.battery - self.ledger.spent[living] <= self._reserve
        for node in living[tight].tolist():
            if self._settle(node) and self._runs_out(node):
                self._die(node, ())
        for nodes, cause, joules in self.consumption.pending_charges(living[~tight]):
            self.ledger.book_each(nodes, cause, np.maximum(joules, -self.ledger.joules[cause][nodes]))
        if self._timed is not None:
            for node in set(np.flatnonzero(~self.living).tolist()) - set(self.died_at):
                self._timed.elapse(node, 0.0, up=False)
        self.consumption.close()
        self._reserve = self._tight = 0.0

    def _settle(self, node: int) -> bool:
        """Book what a node has consumed until now; return whether it is up, as it may have run out of it."""
        charges = self.consumption.settle(node)
        if self._timed is not None:
            self._book_over_time(node, charges, self._timed)
        elif charges:
            self._book_consumed(node, charges)
        return bool(self.alive[node])

    def _book_over_time(self, node: int, charges: Charges, storage: Storage) -> None:
        """Book what a node has consumed evenly since it was settled, and what its battery lost and gained meanwhile."""
        if not self.alive[node]:
            return
        joules = sum(amount for _, amount in charges)
        given = storage.elapse(node, joules)
        spent = self._spent[node]
        if spent < self.battery and joules - given <= ROUNDING * joules:  # what it lacks may be rounded
            self.ledger.book_charges(node, charges)
            self._spent[node] = spent  # with the charges, which the storage has counted
            return
        paid = affordable(charges, given)
        self._spent[node] = self.battery - sum(amount for _, amount in paid)
        self._die(node, paid)
        self._correct(charges, paid)

    def _book_consumed(self, node: int, charges: Charges) -> None:
        joules = sum(amount for _, amount in charges)
        left = self.battery - self._spent[node]
        if joules < left:
            self.ledger.book_charges(node, charges)
            return
        paid = affordable(charges, left)
        self._die(node, paid)
        self._correct(charges, paid)

    def _correct(self, charges: Charges, paid: Charges) -> None:
        """Correct the totals of the network for charges that a node that died of them paid in part."""
        for (cause, amount), (_, part) in zip(charges, paid, strict=True):
            self.consumption.network.correct(cause, part - amount)

    def _die(self, node: int, charges: Charges) -> None:
        """Book the last charges of a node. What remains, less than the price of a bit, is lost: booked as idle."""
        self.consumption.network.correct(IDLE, self.ledger.book_last(node, charges, self.battery))
        storage = self.storage
        if storage is not None and storage.restarts:
            storage.empty.add(node)
        elif storage is not None:
            storage.lose_rest(node)
        self._go_down(node)
        self.on_death(node)
        if storage is not None and storage.restarts:
            self._await_charge(node, storage)

    def is_empty(self, node: int) -> bool:
        """Whether the battery of a node is empty: the node is dead, or down until it is charged."""
        return node in self.died_at or (self.storage is not None and node in self.storage.empty)

    def _await_charge(self, node: int, storage: Storage) -> None:
        """Set a timer for an empty node that may start again."""
        if (due := storage.charged_at(node)) < np.inf:
            self.consumption.battery_watch.timers.set(due, node)

    def _charge(self, node: int, storage: Storage) -> None:
        """The timer of an empty node has fired: it starts again, or gets its next timer."""
        storage.elapse(node, 0.0, up=False)
        if storage.needs(node):
            self._await_charge(node, storage)
        else:
            storage.empty.discard(node)
            self.on_recharge(node)

    def _watch(self, node: int) -> None:
        """Set a timer for a node that may run out before the end."""
        supply = LOAD_ALONE if self._timed is None else self._timed.supply(node)
        self.consumption.watch(node, self.battery - self._spent[node], supply)

    def _runs_out(self, node: int) -> bool:
        """Whether what a node can draw is only rounding error."""
        supply = LOAD_ALONE if self._timed is None else self._timed.supply(node)
        return self.consumption.runs_out(node, self.battery - self._spent[node], supply)

    def _check(self, node: int) -> None:
        """The timer of a node, or of EVERYBODY, has fired: the node is dead, or gets its next timer."""
        if node == EVERYBODY:
            for one in np.flatnonzero(self.living).tolist():
                self._check(one)
            return
        if self.alive[node]:
            self._settle(node)
        if self.alive[node] and self._runs_out(node):
            self._die(node, ())
        elif self.alive[node]:
            self._watch(node)
        elif self.storage is not None and node in self.storage.empty:
            self._charge(node, self.storage)

    def initial_energies(self) -> Floats:
        """(N,) joules in the batteries at the start."""
        return np.broadcast_to(float(self.battery), self.size) if self.storage is None else self.storage.initial

    def residual_energy(self, node: int) -> float:
        """Joules left in a node now, drawable or not."""
        if self.storage is not None:
            pending = np.array([self.consumption.pending(node)])
            return max(float(self.storage.left(np.array([node]), pending)[0]), 0.0)
        return max(float(self.battery - self._spent[node] - self.consumption.pending(node)), 0.0)

    def residual_energies(self) -> Floats:
        """(N,) joules left now, drawable or not."""
        pending = np.zeros(self.size)
        for nodes, _, joules in self.consumption.pending_charges(np.arange(self.size)):
            pending[nodes] += np.maximum(joules, 0.0)
        if self.storage is None:
            left = self.battery - self.ledger.spent - pending
        else:
            left = self.storage.left(np.arange(self.size), pending)
        return np.maximum(left, 0.0, out=left)

    def holds_more(self, node: int, joules: float) -> bool:
        """Whether a node has more than `joules` left. Its consumption is computed only where it may matter."""
        return self.battery - self._spent[node] - self._reserve > joules or self.residual_energy(node) > joules

    def able(self, threshold: float) -> Bools:
        """(N,) which nodes are up and have more than `threshold` joules left."""
        if self._timed is None and bool((self.battery - self.ledger.spent - self._reserve > threshold).all()):
            return self.living.copy()
        return self.living & (self.residual_energies() > threshold)

    def spent_now(self) -> Floats:
        """(causes, N) joules that each node has spent on each cause until now."""
        spent = self.ledger.joules.copy()
        for nodes, cause, joules in self.consumption.pending_charges(np.flatnonzero(self.living)):
            spent[cause, nodes] += joules
        return spent

    def totals_now(self) -> list[float]:
        """Joules that the network has spent on each cause until now, without `consumption.network.scheduled`."""
        return self.consumption.totals(self.ledger.totals)
