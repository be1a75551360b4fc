"""All nodes as arrays: where they stand, who lives and listens, and the ledger of every joule by node and cause.

What was *spent* is stored, what is left is derived, so the ledger closes: for each node the sum over causes is what
it spent. Arrays of zeros cost no memory before they are written to: a node that never does anything costs nothing.
Reading energy changes nothing. What time costs (idle listening, sleep) is settled when a node next spends: see `drain`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
import simpy
from scipy.spatial import KDTree

from wsnsim.base.arrays import Bools, Floats, Ints, scalars
from wsnsim.base.radio import ContinuousPower, Mode
from wsnsim.base.rng import derive_all
from wsnsim.base.setups import NetworkSetup, RadioSetup
from wsnsim.base.tables import CAUSE, CAUSES
from wsnsim.network.energy.consumption import FEW, BackgroundConsumption
from wsnsim.network.energy.duty_cycles import DutyCycles

ELECTRONICS, AMPLIFIER = CAUSE["tx_electronics"], CAUSE["tx_amplifier"]
RECEIVE, IDLE, SWITCH = CAUSE["rx"], CAUSE["idle"], CAUSE["switch"]
SPENT: Final = len(CAUSES)
LINGER: Final = 1.0
"""s: whoever sends less than so long before its schedule ends is kept awake. Hardly a frame waits longer."""


class Nodes:
    """The nodes. `on_death(node)` is called at the instant a charge reaches zero.

    `living` (N,): neither dead nor down; `alive[i]` is the same, one at a time. `listening` (N,): alive, and the radio
    is on, where nobody sleeps; else see `hears`. `jammed` (N,): the radio neither hears nor is heard. `loss` (N,): a
    fault's share of packets lost at a node. `rota`: who is awake, where there are schedules of sleep. `rest`: the mode
    of a node that has nothing to do, but for the `sleepless`, which are always awake.
    """

    def __init__(self, positions: Floats, traits: Floats, battery: float, reach: float) -> None:
        self.positions = positions
        self.traits = traits
        self.size = size = len(positions)
        self.x, self.y = (scalars(np.ascontiguousarray(positions[:, i], dtype=np.float64)) for i in range(2))
        self.battery = battery
        self.reach = reach
        self.tree = KDTree(positions)
        self.living = np.ones(size, dtype=np.bool_)
        self.listening = np.ones(size, dtype=np.bool_)
        self.jammed = np.zeros(size, dtype=np.bool_)
        self.loss = np.zeros(size)
        self.alive = scalars(self.living)
        self.died_at: dict[int, float] = {}
        self.ledger = np.zeros((len(CAUSES), size))
        self.spent = np.zeros(size)
        self.totals: list[float] = [0.0] * len(CAUSES)
        self.drain: BackgroundConsumption | None = None
        self.duty_cycles: DutyCycles | None = None
        self.rest = Mode.DORMANT
        self.sleepless: set[int] = set()
        self.disturbed = False
        self.all_listen = True
        self.on_death: Callable[[int], None] = lambda node: None
        self._ledger = [scalars(row) for row in self.ledger]
        self._spent = scalars(self.spent)
        self._ceiling = 0.0
        self._look_again_in = 0
        self._tasked: set[int] = set()
        self._sending: set[int] = set()

    def distance(self, a: int, b: int) -> float:
        """Metres between two nodes."""
        dx, dy = self.x[a] - self.x[b], self.y[a] - self.y[b]
        return float((dx * dx + dy * dy) ** 0.5)

    def rest_of(self, node: int) -> Mode:
        """The mode of a node that has nothing to do."""
        return Mode.AWAKE if node in self.sleepless else self.rest

    def hears(self, ids: Ints, since: float) -> Bools:
        """(n,) which nodes live and have been listening since an instant of the past, or since now."""
        if self.duty_cycles is None:
            return self.listening[ids]
        heard: Bools = self.duty_cycles.hears(ids, since) & self.living[ids]
        return heard

    def is_awake(self, node: int) -> bool:
        """Whether a node is up, and listens now."""
        return self.alive[node] and (self.duty_cycles is None or self.duty_cycles.is_awake(node))

    def spend(self, node: int, cause: int, joules: float) -> float:
        """Book joules on a living node; give what was spent: less if the charge did not suffice, and it died."""
        if self.drain is not None:
            self.drain.touch(node, joules)
            if not self.alive[node]:
                return 0.0
        spent = self._spent[node]
        left = self.battery - spent
        if spent + joules >= self.battery:
            self._exhaust(node, ((cause, left),))
            return left
        self._ledger[cause][node] += joules
        self._book(node, spent + joules)
        self.totals[cause] += joules
        if self.drain is not None:
            self.drain.watch(node)
        return joules

    def _book(self, node: int, spent: float) -> None:
        self._spent[node] = spent
        if spent > self._ceiling:
            self._ceiling = spent

    def spend_transmit(self, node: int, electronics: float, amplifier: float, bits: int, seconds: float = 0.0) -> int:
        """Book a transmission on its two causes; give the whole bits that were paid: fewer if the node died of it.

        `seconds`: for how long the radio sent, and so did not idle.
        """
        if self.drain is not None:
            self.drain.occupy(node, seconds)
            if not self.alive[node]:
                return 0
        spent = self._spent[node]
        joules = electronics + amplifier
        left = self.battery - spent
        if spent + joules >= self.battery:
            paid = min(int(bits * left / joules), bits)
            share = paid / bits
            self._exhaust(node, ((ELECTRONICS, electronics * share), (AMPLIFIER, amplifier * share)))
            return paid
        ledger = self._ledger
        ledger[ELECTRONICS][node] += electronics
        ledger[AMPLIFIER][node] += amplifier
        self._book(node, spent + joules)
        self.totals[ELECTRONICS] += electronics
        self.totals[AMPLIFIER] += amplifier
        if self.drain is not None:
            self.drain.watch(node)
        return bits

    def spend_receive(self, node: int, joules: float, bits: int, cause: int = RECEIVE, seconds: float = 0.0) -> int:
        """Book a reception; give the whole bits that were paid: fewer if the node died of it."""
        if self.drain is not None:
            self.drain.occupy(node, seconds)
            if not self.alive[node]:
                return 0
        spent = self._spent[node]
        left = self.battery - spent
        if spent + joules >= self.battery:
            paid = min(int(bits * left / joules), bits)
            self._exhaust(node, ((cause, joules * paid / bits),))
            return paid
        self._ledger[cause][node] += joules
        self._book(node, spent + joules)
        self.totals[cause] += joules
        if self.drain is not None:
            self.drain.watch(node)
        return bits

    def can_all_receive(self, nodes: Ints, listed: list[int], joules: float) -> bool:
        """Whether none of the nodes could die of a reception that costs so much: `receive_all` may book it."""
        nearly = self.battery * (1.0 - 4e-16)  # so that no sum is rounded up to the battery
        most = nearly - joules - (self.drain.most if self.drain is not None else 0.0)
        if self._ceiling < most or self._lower_ceiling() < most:
            return True
        if len(listed) < FEW:
            spent = self._spent
            return not [node for node in listed if spent[node] >= most]
        return bool((self.spent[nodes] < most).all())

    def _lower_ceiling(self) -> float:
        """What no living node has spent more than: looked up anew now and then, since `receive_all` only raises it."""
        self._look_again_in -= 1
        if self._look_again_in < 0:
            self._look_again_in = self.size
            self._ceiling = float(self.spent.max(where=self.living, initial=0.0))
        return self._ceiling

    def receive_all(self, nodes: Ints, listed: list[int], joules: float, cause: int, seconds: float) -> None:
        """Book the same reception on different nodes (given twice: as array and list) that it cannot kill."""
        if len(listed) < FEW:
            spent, book = self._spent, self._ledger[cause]
            for node in listed:
                spent[node] += joules
                book[node] += joules
        else:
            self.spent[nodes] += joules
            self.ledger[cause][nodes] += joules
        self.totals[cause] += joules * len(listed)
        self._ceiling += joules
        if self.drain is not None:
            self.drain.occupy_all(nodes, listed, seconds)

    def doze(self, nodes: Ints, seconds: float) -> None:
        """Nodes turn the radio off for so long, and sleep instead of listening; what turning it costs is left out."""
        if self.drain is not None:
            self.drain.doze(nodes[self.living[nodes]], seconds)

    def book_drawn(self, node: int, charges: tuple[tuple[int, float], ...]) -> None:
        """Book what time has cost a node since it was last settled, the drain's work alone."""
        joules = sum(amount for _, amount in charges)
        left = self.battery - self._spent[node]
        if joules >= left:
            share = left / joules if joules else 0.0
            self._exhaust(node, tuple((cause, amount * share) for cause, amount in charges))
            if self.drain is not None:
                for cause, amount in charges:
                    self.drain.forgo(cause, amount * (1.0 - share))
            return
        for cause, amount in charges:
            self._ledger[cause][node] += amount
            self.totals[cause] += amount
        self._book(node, self._spent[node] + joules)

    def exhaust(self, node: int) -> None:
        """A node's charge is gone: what rounding left of it is lost."""
        self._exhaust(node, ())

    def _exhaust(self, node: int, charges: tuple[tuple[int, float], ...]) -> None:
        """A node's last charges. What remains, less than a bit's worth, is lost: booked as idle."""
        rest = self.battery - self._spent[node] - sum(joules for _, joules in charges)
        for cause, joules in (*charges, (IDLE, max(rest, 0.0))):
            self._ledger[cause][node] += joules
            self.totals[cause] += joules
        self._spent[node] = self.battery
        if self.drain is not None:
            self.drain.lose(max(rest, 0.0))
        self._fall_silent(node)
        self.on_death(node)

    def _fall_silent(self, node: int) -> None:
        self.living[node] = self.listening[node] = False
        self._tasked.discard(node)
        self._sending.discard(node)
        self.all_listen = False
        self._enter(node, Mode.DOWN)

    def _enter(self, node: int, mode: Mode) -> None:
        """A settled node is in another mode from now on."""
        if self.drain is not None:
            self.drain.change(node, mode)
        if self.duty_cycles is not None:
            self.duty_cycles.note(node, mode)

    @property
    def follows_schedules(self) -> bool:
        """Whether nodes without a task sleep and wake by a schedule."""
        return self.duty_cycles is not None

    def is_scheduled_awake(self, node: int) -> bool:
        """Whether a node's schedule, if it has one, says that it is awake now."""
        return self.duty_cycles is not None and self.duty_cycles.scheduled(node) is Mode.AWAKE

    def keep_awake(self, node: int) -> None:
        """Keep a node awake for the whole run, whatever its schedule says."""
        if self.follows_schedules:
            self.sleepless.add(node)
            self.set_mode(node, Mode.AWAKE)

    def mark_computing(self, node: int, cycles: float) -> None:
        """Exclude the processor time of a computation from background consumption: it is booked by the caller."""
        if self.drain is not None:
            self.drain.compute(node, cycles)

    def begin_sending(self, node: int) -> None:
        """A node has a frame to send: it stays awake until that is done, though its schedule may end before."""
        if self.duty_cycles is None or node in self._sending:
            return
        if node in self._tasked:
            self._sending.add(node)
        elif self.duty_cycles.may_fall_asleep(node, LINGER):
            self._sending.add(node)
            self._apply(node, Mode.AWAKE)

    def end_sending(self, node: int) -> None:
        """A node has nothing more to send."""
        if node in self._sending:
            self._sending.discard(node)
            if node not in self._tasked:
                self._apply(node, self.rest_of(node))

    def set_mode(self, node: int, mode: Mode) -> None:
        """A node has a task that keeps it awake, or has none; it pays for a change of mode and may die of it."""
        if not self.alive[node]:
            return
        if self.duty_cycles is not None:
            (self._tasked.discard if mode is Mode.SCHEDULED else self._tasked.add)(node)
            if node in self._sending:
                return
        self._apply(node, mode)

    def _apply(self, node: int, mode: Mode) -> None:
        if self.drain is None:
            self._enter(node, mode)
            return
        joules = self.drain.switching(node, mode)
        self.drain.settle(node)
        if not self.alive[node]:
            return
        self._enter(node, mode)
        if joules:
            self.spend(node, SWITCH, joules)
        else:
            self.drain.watch(node)

    def crash(self, node: int) -> None:
        """A living node goes down, its charge kept."""
        if self.drain is not None:
            self.drain.settle(node)
        if self.alive[node]:
            self._fall_silent(node)

    def restart(self, node: int) -> None:
        """A node that is down, and not dead, comes back at rest."""
        if node in self.died_at or self.alive[node]:
            return
        self.living[node] = self.listening[node] = True
        self.all_listen = self.duty_cycles is None and bool(self.listening.all())
        if self.drain is not None:
            self.drain.settle(node)
        self._enter(node, self.rest_of(node))
        if self.drain is not None:
            self.drain.watch(node)

    def spent_by(self, node: int) -> float:
        """Joules booked on a node so far."""
        return self._spent[node]

    def holds_more(self, node: int, joules: float) -> bool:
        """Whether a node has more than so much left. What time has cost it is looked up only where it may matter."""
        most = self.drain.most if self.drain is not None else 0.0
        return self.battery - self._spent[node] - most > joules or self.left(node) > joules

    def left(self, node: int) -> float:
        """Joules left in a node now."""
        pending = self.drain.pending(node) if self.drain is not None else 0.0
        return max(self.battery - self._spent[node] - pending, 0.0)

    def able(self, threshold: float) -> Bools:
        """(N,) which nodes live and hold more than `threshold` joules."""
        most = self.drain.most if self.drain is not None else 0.0
        if bool((self.battery - self.spent - most > threshold).all()):
            return self.living.copy()
        return self.living & (self.all_left() > threshold)

    def all_left(self) -> Floats:
        """(N,) joules left now."""
        if self.drain is None:
            return self.battery - self.spent
        return np.maximum(self.battery - self.spent - self.drain.all_pending(), 0.0)

    def totals_now(self) -> list[float]:
        """What the network has spent on each cause until now, what is not yet settled included."""
        return self.totals if self.drain is None else self.drain.totals(self.totals)

    def awake_fraction(self, until: float) -> float:
        """The share of the nodes' time from 0 to `until`, which is now, that they were awake; 1 where nobody sleeps.

        A node that is down counts as asleep where nodes sleep by a schedule.
        """
        return 1.0 if self.duty_cycles is None else self.duty_cycles.awake_fraction(until)

    def scheduled_totals(self, times: Floats) -> Floats:
        """(T, causes) what all nodes would have drawn by each time, had they done nothing but follow their schedules.

        `totals_now` leaves that out.
        """
        none = np.zeros((times.size, len(CAUSES)))
        return none if self.drain is None else self.drain.scheduled_totals(times)

    def close(self) -> None:
        """Settle every node: the end of a run, after which nothing is drawn."""
        if self.drain is not None:
            self.drain.settle_all()
            self.drain = None

    @property
    def books(self) -> dict[int, list[float]]:
        """{node: joules by cause, then what it spent} of every node that spent something."""
        touched = np.flatnonzero(self.spent)
        columns = np.concatenate([self.ledger[:, touched], self.spent[None, touched]]).T
        return dict(zip(touched.tolist(), columns.tolist(), strict=True))


def make_nodes(env: simpy.Environment, parts: RadioSetup, positions: Floats, traits: Floats, key: int) -> Nodes:
    """The nodes of a scenario, when they sleep, and what time costs them, if it costs anything. `key`: of `sleep`."""
    energy = parts.energy
    fleet = Nodes(positions, traits, energy.battery, parts.link.reach)
    fleet.rest = parts.sleep.rest
    if fleet.rest is Mode.SCHEDULED:
        fleet.duty_cycles = DutyCycles(env, parts.sleep, derive_all(key, np.arange(fleet.size)))
        fleet.all_listen = False
    looking = _looking(parts)
    if isinstance(energy, ContinuousPower) and (_time_costs(energy) or looking):
        fleet.drain = BackgroundConsumption(env, fleet, energy, (parts.steps + 1) * parts.dt, looking)
    return fleet


def _looking(parts: RadioSetup) -> float:
    """W that a node which is awake spends on looking for targets: a reading each time, on the average."""
    if not isinstance(parts, NetworkSetup) or not parts.nodes_search:
        return 0.0
    return parts.energy.sense() / (parts.acquire.poll or parts.dt)


def _time_costs(energy: ContinuousPower) -> bool:
    """Whether waiting or changing over costs anything in any mode."""
    draws = [energy.draw(mode) for mode in Mode]
    return any(draw.radio or draw.processor for draw in draws) or any(
        energy.switching(before, after) for before in Mode for after in Mode
    )
