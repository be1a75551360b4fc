"""Power of a network without a target, by node and cause: in closed form where there is one, else from a long run.

    quiet_power(setup, dead) -> QuietPower

In the closed form a node has the power of its state (see `network.energy.power_table`), and each of the broadcasts of
time synchronisation, of routing and of the MAC adds what the MAC says that it takes of its sender and of those that
hear it. Undisturbed broadcasts are assumed: the network has settled, and frames collide or wait for each other rarely.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints
from wsnsim.base.errors import UsageError
from wsnsim.base.medium_access import off_time
from wsnsim.base.optional_ports import defined_together
from wsnsim.base.quiet import Hearing, KnowsLongRun, RadioUse, SendsUpkeep, Upkeep, UsesRadios
from wsnsim.base.radio import Mode, RecordsLinks, continuous_power
from wsnsim.base.rows import RunNow, RunStart
from wsnsim.base.setups import NetworkSetup
from wsnsim.base.tables import CAUSE, CAUSES, Memory
from wsnsim.experiment import replicate_of
from wsnsim.lifetimes.library import without_failures
from wsnsim.network.energy.power_table import HELD, IDLE, MODES, ON, SWITCH
from wsnsim.network.radio.radio_stack import RadioStack, inspect_radio, make_power_table

if TYPE_CHECKING:
    import pandas as pd

SETTLED: Final = 120.0
"""Least time in s that a run settles before its power is measured."""
SPAN: Final = 3600.0
"""Time in s over which a run is measured."""
BLOCKS: Final = 10
"""Equal parts of that time, whose spread tells the error."""
ELECTRONICS, AMPLIFIER, RECEIVED = CAUSE["tx_electronics"], CAUSE["tx_amplifier"], CAUSE["rx"]


@dataclasses.dataclass(frozen=True)
class QuietPower:
    """The power of a network without a target, once it has settled.

    Attributes:
        watts: (causes, N) mean power of each node by cause in W, in the order of `wsnsim.base.tables.CAUSES`.
        error: (causes, N) their standard errors in W; 0 in closed form.
        measured: why it was measured in a run; empty: it is in closed form.
    """

    watts: Floats
    error: Floats
    measured: str = ""

    def frame(self) -> pd.DataFrame:
        """The watts as a data frame: a row per node, and a column per cause that is not zero everywhere."""
        import pandas as pd

        watts = {cause: each for cause, each in zip(CAUSES, self.watts, strict=True) if each.any()}
        return pd.DataFrame(watts, index=pd.RangeIndex(self.watts.shape[1], name="node"))


def quiet_power(
    setup: NetworkSetup, dead: frozenset[int] = frozenset(), number: int = 0, run: bool = False, span: float = SPAN
) -> QuietPower:
    """The quiet power of a network some of whose nodes are dead; batteries are full, and nothing fails.

    Args:
        setup: the scenario.
        dead: the nodes that are dead.
        number: number of the run whose network it is.
        run: measure it in a run in any case.
        span: the seconds that are measured, at least; more if nodes broadcast rarely.

    Raises:
        RunError: a run failed.
        UsageError: a dead node does not exist.
    """
    setup = _without_targets(setup, dead)
    stack = inspect_radio(setup, number)
    size = stack.radio.nodes.size
    if strangers := [node for node in dead if not 0 <= node < size]:
        raise UsageError(f"dead: {min(strangers)} is no node of the network, whose nodes are 0 to {size - 1}")
    living = ~np.isin(np.arange(size), list(dead))
    upkeep, obstacle = _upkeep(setup, stack, living)
    if not run and not obstacle:
        watts = _background(setup, stack) + _of_broadcasts(setup, stack, living, upkeep)
        return QuietPower(watts * living, np.zeros_like(watts))
    settled = max([SETTLED, *[each.settles for each in upkeep]])
    span = max([span, *[BLOCKS * each.period for each in upkeep]])
    return _measured(setup, number, settled, span, obstacle or "on request")


def _without_targets(setup: NetworkSetup, dead: frozenset[int]) -> NetworkSetup:
    """The setup without targets and faults, whose batteries last for ever."""
    energy: Any = setup.energy
    if "battery" in {field.name for field in dataclasses.fields(energy)}:
        energy = dataclasses.replace(energy, battery=math.inf)
    absent = ((),) * len(setup.motions)
    return dataclasses.replace(without_failures(setup, dead), energy=energy, presence=absent, recorded=None)


def _upkeep(setup: NetworkSetup, stack: RadioStack, living: Bools) -> tuple[list[Upkeep], str]:
    """What nodes broadcast, and why the power that it takes has no closed form; empty: it has one."""
    upkeep, unknown = list[Upkeep](), list[str]()
    for role in ("mac", "sync", "routing"):
        component = getattr(setup, role)
        sent = component.upkeep(setup) if isinstance(component, SendsUpkeep) else None
        upkeep += sent or ()
        steady = role == "routing" if sent is None else all(each.steady for each in sent)
        kind: Any = type(component)
        own = hasattr(component, "start") and not defined_together(kind, "start", "upkeep")
        unknown += [] if steady and not own else [role]
    if setup.sleep.rest is Mode.SCHEDULED and not isinstance(setup.sleep, KnowsLongRun):
        unknown.append("sleep")
    if unknown:
        return upkeep, f"{unknown[0]} has no closed form here"
    return upkeep, _disturbed(setup, stack, living) if upkeep else ""


def _disturbed(setup: NetworkSetup, stack: RadioStack, living: Bools) -> str:
    """Why broadcasts do not reach the same nodes every time, or nodes do not send with the same period."""
    if setup.sleep.rest is Mode.SCHEDULED:
        return "broadcasts wait for nodes that sleep"
    if isinstance(setup.link, RecordsLinks):
        return "links change"
    if not isinstance(setup.mac, UsesRadios):
        return "mac does not say what a broadcast takes"
    if setup.routing.weight == "etx" and not {*np.flatnonzero(living).tolist()} <= _reached(stack, living):
        return "nodes that reach no sink look for a route"
    return ""


def _reached(stack: RadioStack, living: Bools) -> set[int]:
    """The living nodes that have a path to a sink."""
    reached, new = set[int](), {sink for sink in stack.sinks if living[sink]}
    while new:
        reached |= new
        near = np.concatenate([stack.radio.topology.neighbours(node).ids for node in new])
        new = {*near[living[near]].tolist()} - reached
    return reached


def _background(setup: NetworkSetup, stack: RadioStack) -> Floats:
    """(causes, N) the power of nodes that neither send nor receive, in W."""
    table, size = make_power_table(setup), stack.radio.nodes.size
    if setup.sleep.rest is not Mode.SCHEDULED:
        return np.repeat(_by_cause(table.powers(int(setup.sleep.rest)))[:, None], size, axis=1)
    assert isinstance(setup.sleep, KnowsLongRun), "other schedules are measured"
    share, switches = setup.sleep.long_run
    model = table.model
    change = (model.switching(Mode.AWAKE, Mode.ASLEEP) + model.switching(Mode.ASLEEP, Mode.AWAKE)) / 2.0
    watts = np.repeat(_by_cause(table.by_schedule(share, 1.0, switches * change))[:, None], size, axis=1)
    watts[:, list(stack.sinks)] = _by_cause(table.powers(int(Mode.AWAKE)))[:, None]
    return watts


def _by_cause(powers: list[tuple[int, float]]) -> Floats:
    """(causes,) sums of pairs of cause and W."""
    watts = np.zeros(ON + 1)
    for cause, each in powers:
        watts[cause] += each
    return watts[:ON]


def _of_broadcasts(setup: NetworkSetup, stack: RadioStack, living: Bools, upkeep: list[Upkeep]) -> Floats:
    """(causes, N) the power that the broadcasts of living nodes add, in W."""
    size = living.size
    watts = np.zeros((len(CAUSES), size))
    if not upkeep:
        return watts
    assert isinstance(setup.mac, UsesRadios), "other MACs are measured"
    topology, clocks = stack.radio.topology, stack.clocks
    found = [topology.neighbours(node) for node in range(size)]
    sources = np.repeat(np.arange(size), [each.ids.size for each in found])
    ids, senses = (np.concatenate([getattr(each, name) for each in found]) for name in ("ids", "senses"))

    def arrives(bits: int) -> Floats:
        return np.concatenate([topology.probabilities(each, bits) for each in found])

    hearing = Hearing(arrives, senses.astype(np.float64), off_time(setup.energy))
    for bits, period, *_ in upkeep:
        rates = living / np.array([clocks.lasts(node, period) for node in range(size)])
        sent, heard = setup.mac.broadcast_use(bits, hearing)
        for cause, joules in _joules(setup, sent, sends=True):
            watts[cause] += joules * rates
        alone = _alone(np.bincount(ids, rates[sources], size) * heard.together, rates * heard.together)
        for cause, joules in _joules(setup, heard, sends=False):
            watts[cause] += np.bincount(ids, joules * rates[sources], size) * alone
    return watts


def _alone(heard: Any, sent: Floats) -> Floats:
    """(N,) the share of broadcasts that a node pays for. In the time in which several cost as one, it has this many."""
    share: Floats = -np.expm1(-heard) / np.where(heard > 0.0, heard, -1.0) * (1.0 - sent) + (heard == 0.0)
    return share


def _joules(setup: NetworkSetup, use: RadioUse, sends: bool) -> Iterator[tuple[int, Any]]:
    """(cause, joules) that the use of a radio adds to those of the state of its node."""
    table, energy, model = make_power_table(setup), setup.energy, continuous_power(setup.energy)
    rest = int(setup.sleep.rest)
    held = HELD * MODES + rest if table.duties else rest
    turnaround = 2.0 * model.turnaround() if model is not None and sends and hasattr(setup.mac, "turnaround") else 0.0
    for bits, seconds, number, is_held in use.frames:
        busy: Any = seconds * number
        state = held if is_held else rest
        if sends:
            electronics, amplifier = energy.transmit(bits, setup.link.reach)
            yield ELECTRONICS, electronics * number
            yield AMPLIFIER, amplifier * number
            yield SWITCH, turnaround * number
            busy = busy + (2.0 * setup.mac.turnaround * number if turnaround else 0.0)  # type: ignore[attr-defined]
        else:
            yield RECEIVED, energy.receive(bits) * number
        yield table.radio_cause[state], -table.radio[state] * busy
    if table.duties:
        for state, spell in ((held, use.held), (rest, -use.held)):
            yield table.radio_cause[state], table.radio[state] * table.share[state] * spell
            yield IDLE, table.listening[state] * spell
            yield SWITCH, table.switching[state] * spell
        yield SWITCH, (table.start + table.stop) * use.starts
        yield IDLE, table.listen * use.listening
        yield table.radio_cause[rest], -table.off[rest] * table.radio[rest] * use.listening


class _Blocks:
    """A recorder that keeps what nodes have spent at the beginning of some steps: `spent`, each (causes, N)."""

    def __init__(self, steps: Ints) -> None:
        self._memory = Memory({})
        self.words, self.state_names, self.wants = self._memory.words, self._memory.state_names, self._memory.wants
        self._steps, self._step = frozenset(steps.tolist()), -1
        self.spent: list[Floats] = []

    def begin(self, start: RunStart) -> None:
        """A run begins."""

    def due(self) -> bool:
        """Whether the step that begins is one of them; called once a step."""
        self._step += 1
        return self._step in self._steps

    def follow(self, now: RunNow) -> None:
        """Keep what nodes have spent."""
        assert now.spent is not None, "networks spend energy"
        self.spent.append(now.spent)

    def write(self, table: str, columns: Mapping[str, Any]) -> None:
        """Drop rows."""


def _measured(setup: NetworkSetup, number: int, settled: float, span: float, reason: str) -> QuietPower:
    """The power of a setup without targets from a long run, in which all that is random is that of run `number`."""
    first, each = math.ceil(settled / setup.dt), max(round(span / BLOCKS / setup.dt), 1)
    steps = first + each * np.arange(BLOCKS + 1)
    recorder = _Blocks(steps)
    replicate_of(dataclasses.replace(setup, steps=int(steps[-1]), record={}), number, recorder)
    watts = np.diff(np.array(recorder.spent), axis=0) / (each * setup.dt)
    return QuietPower(watts.mean(axis=0), watts.std(axis=0, ddof=1) / math.sqrt(BLOCKS), reason)
