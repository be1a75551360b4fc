"""Batteries: how much nodes have, how much of it they can draw, and what they lose and harvest meanwhile.

    battery.draw(setup, size, sinks, rng) -> BatteryState           the batteries of a run
    battery.advance(state, watts, seconds, income) -> Advance       in closed form, also over years

All kinds are one linear system. With `left` J in a battery, a load P and modes u_j of rate λ_j and weight w_j,

    left' = -P,    u_j' = P - λ_j u_j,    drawable = (left - reserve - Σ w_j u_j) / (1 + Σ w_j)

and the battery is empty when nothing is drawable. A linear battery has no mode, a kinetic one has one, and diffusion
has one per term of its series.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from functools import cached_property
from typing import Annotated, Final, Literal

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.batteries import Advance, BatteryState, Income
from wsnsim.base.errors import Issue, RunError, shortened
from wsnsim.base.part import Quantity, part
from wsnsim.base.setups import RadioSetup, Setup
from wsnsim.models import csvfile
from wsnsim.models.bounds import JOULES, MOST_DEVIATIONS, MOST_NODES, SHARE, number_of_nodes
from wsnsim.models.harvest import Harvester

YEAR: Final = 365.25 * 86400.0
GAS_CONSTANT: Final = 8.314462618
"""J/(mol K)."""
ROOM: Final = 20.0
"""°C for which capacity and self-discharge are stated."""
KELVIN: Final = 273.15
ROUNDING: Final = 1e-13
"""Share of the charge that is rounding error: less is nothing."""
NODES: Final = Quantity("", ge=0, lt=MOST_NODES)
VOLTS: Final = Quantity("V", gt=0.0, le=1e6)
PART: Final = Quantity("", ge=0.0, le=1.0)


@part
class BatteryFields:
    """What batteries of all kinds share: the charge of each node, what of it can be used, mains and self-discharge.

    A node has `energy.battery`, or what `capacities` or the file say. Nodes on mains are never empty; their joules are
    counted. A node with a `residual` of nothing that can be drawn is dead from the start.

    The temperature is constant. Self-discharge is a constant power that follows Arrhenius' law: with the default
    `activation` it doubles from 20 to 30 °C. Below 20 °C a share `cold` of the capacity per kelvin cannot be drawn (our
    linear form; Rodrigues and others (2017) correct capacity and rates by such factors).
    """

    capacities: Annotated[
        tuple[float, ...], Quantity("J", gt=0.0), "capacity of each node, in place of energy.battery"
    ] = ()
    path: Annotated[
        str | None, "CSV file, also .gz, with columns id (name or number of a node), battery and perhaps residual, in J"
    ] = None
    spread: Annotated[
        float, Quantity("", ge=0.0, le=0.3), "standard deviation or half width of capacities, as a share of them"
    ] = 0.0
    law: Annotated[Literal["normal", "uniform"], "distribution of the capacities; a normal ends at 3 deviations"] = (
        "normal"
    )
    residual: Annotated[tuple[float, ...], JOULES, "energy of each node at the start; left out: its capacity"] = ()
    mains: Annotated[tuple[int, ...], NODES, "nodes that are never empty, by number"] = ()
    sink_on_mains: Annotated[bool, "whether sinks are never empty"] = False
    usable: Annotated[float, SHARE, "share of the capacity that can be drawn"] = 1.0
    self_discharge: Annotated[float, PART, "share of the capacity that is lost in a year at 20 °C"] = 0.0
    temperature: Annotated[float, Quantity("", ge=-60.0, le=120.0, label="°C"), "temperature of the batteries"] = ROOM
    cold: Annotated[
        float,
        Quantity("", ge=0.0, le=0.0125, label="1/K"),
        "share of the capacity per kelvin below 20 °C that cannot be drawn",
    ] = 0.006
    activation: Annotated[
        float, Quantity("", ge=0.0, le=5e5, label="J/mol"), "activation energy of the self-discharge"
    ] = 51_200.0

    @cached_property
    def weights(self) -> Floats:
        """(M,) weight of each mode."""
        return np.zeros(0)

    @cached_property
    def rates(self) -> Floats:
        """(M,) rate of each mode in 1/s."""
        return np.zeros(0)

    @property
    def harvest(self) -> Harvester | None:
        """A source that charges the battery: none, unless the kind has one."""
        return None

    @property
    def restart(self) -> float | None:
        """The share of the capacity at which an empty node starts again; None: it is dead."""
        return self.harvest.restart if self.harvest else None

    @property
    def stored(self) -> float:
        """The share of what is harvested that is stored."""
        return self.harvest.charging if self.harvest else 1.0

    def check(self, setup: Setup) -> Iterator[Issue]:
        """Yield an issue if the trace of the harvester cannot be read, or batteries do not fit the network."""
        if not isinstance(setup, RadioSetup) or setup.plain_batteries:
            return
        if (size := number_of_nodes(setup.deploy)) is not None:
            try:
                self.draw(setup, size, (), np.random.default_rng(0))
            except Misfit as error:
                yield Issue(("battery", error.key), str(error))
        try:
            _ = self.harvest and self.harvest.trace
        except RunError as error:
            yield Issue(("battery", "harvest", "path"), str(error))

    def draw(self, setup: RadioSetup, size: int, sinks: tuple[int, ...], rng: np.random.Generator) -> BatteryState:
        """The batteries of all nodes at the start of a run; `rng` is used for a spread alone.

        Raises:
            RunError: the file cannot be used, a list is not as long as there are nodes, or a node has more than its
                capacity.
        """
        capacity, left = np.full(size, self.nominal(setup.energy.battery)), None
        if self.path:
            capacity, left = self._from_file(self.path, setup, size)
        for name in ("capacities", "residual"):
            if len(given := getattr(self, name)) not in (0, size):
                raise Misfit(name, f"{len(given)} values for {size} nodes: give one for each")
        for node in [node for node in self.mains if node >= size][:1]:
            raise Misfit("mains", f"no node {node}: the {size} nodes are numbered from 0")
        capacity = np.array(self.capacities) if self.capacities else capacity
        if self.spread:
            capacity = capacity * (1.0 + self.spread * self._deviations(size, rng))
        left = np.array(self.residual) if self.residual else capacity.copy() if left is None else left
        for node in np.flatnonzero(left > capacity * (1.0 + ROUNDING))[:1].tolist():
            key = "residual" if self.residual else "path"
            raise Misfit(key, f"node {node} has {left[node]:g} J, more than its capacity of {capacity[node]:g} J")
        on_mains = [*self.mains, *(sinks if self.sink_on_mains else ())]
        capacity[on_mains] = left[on_mains] = np.inf
        finite = np.where(np.isfinite(capacity), capacity, 0.0)
        lost, leak = finite * (1.0 - self.share_drawable), finite * self.leakage
        return BatteryState(capacity, lost, leak, left, np.zeros((self.rates.size, size)))

    def _from_file(self, path: str, setup: RadioSetup, size: int) -> tuple[Floats, Floats | None]:
        """(N,) capacities and residual energies from the file, the latter None if it has none."""
        try:
            wanted = csvfile.Wanted({"id": "id"}, {"battery": "battery", "residual": "residual"}, ("residual",))
            rows = csvfile.only_rows(path, wanted, "batteries")
        except RunError as error:
            raise Misfit("path", str(error)) from error
        names = [str(node) for node in range(size)]
        with contextlib.suppress(RunError):  # positions without names
            names = list(getattr(setup.deploy, "names", names))
        found = [rows.texts["id"].names[code] for code in rows.texts["id"].codes]
        for name in (*found, *names):
            if found.count(name) != 1 or name not in names:
                said = "is no node" if name not in names else "is missing" if name not in found else "has two rows"
                hint = f"give each of the {size} nodes a row, by its name, or by its number if it has no name"
                raise Misfit("path", f"{path}: '{shortened(name)}' {said}: {hint}")
        order = [found.index(name) for name in names]
        given, residual = rows.numbers["battery"][order], rows.numbers.get("residual")
        for name, least in (("battery", np.nextafter(0.0, 1.0)), ("residual", 0.0)):
            for row in np.flatnonzero(rows.numbers.get(name, given) < least)[:1].tolist():
                raise Misfit(
                    "path", f"{self.path}:{rows.lines[row]}: {name} must be {'at least' if not least else 'above'} 0 J"
                )
        return given, None if residual is None else residual[order]

    def _deviations(self, size: int, rng: np.random.Generator) -> Floats:
        if self.law == "uniform":
            return rng.uniform(-1.0, 1.0, size)
        return np.clip(rng.standard_normal(size), -MOST_DEVIATIONS, MOST_DEVIATIONS)

    def nominal(self, battery: float) -> float:
        """The capacity in J of a node for which nothing else is given; `battery`: that of the energy model."""
        return battery

    @property
    def share_drawable(self) -> float:
        """The share of the capacity that can be drawn: of what is usable, less in the cold."""
        return self.usable * (1.0 - self.cold * max(ROOM - self.temperature, 0.0))

    @property
    def leakage(self) -> float:
        """Self-discharge as a share of the capacity per s."""
        colder = 1.0 / (ROOM + KELVIN) - 1.0 / (self.temperature + KELVIN)
        return float(self.self_discharge / YEAR * np.exp(self.activation / GAS_CONSTANT * colder))

    def income(self, time: float) -> Income:
        """What the harvester offers at a time in s: nothing, ever, without one."""
        return self.harvest.income(time) if self.harvest else Income(0.0, np.inf)

    def drawable(self, state: BatteryState) -> Floats:
        """(n,) J that can be drawn at once; infinite on mains."""
        drawable: Floats = np.maximum(self._margin(state), 0.0) / (1.0 + self.weights.sum())
        return drawable

    def draw_at_once(self, state: BatteryState, joules: Floats) -> BatteryState:
        """The state after (n,) joules were drawn in no time; negative ones were put back."""
        return state._replace(left=state.left - joules, uneven=state.uneven + joules)

    def advance(
        self, state: BatteryState, watts: Floats, seconds: Floats | float, income: Floats | float = 0.0
    ) -> Advance:
        """What a span of constant load does, however long it is.

        Args:
            state: At its beginning.
            watts: (n,) mean load in W.
            seconds: Length in s of the span, (n,) or one for all.
            income: Mean power in W that the harvester offers, (n,) or one for all.

        Returns:
            The state at its end, or when a battery was empty, and the ledger of the span.
        """
        stored = self.stored * income
        net = watts + state.leak - stored
        died_after = self._lasting(state, net, seconds)
        span = np.minimum(died_after, seconds)
        after = self._after(state, net, span)
        surplus = np.array(stored * span)
        np.subtract(after.left, state.capacity, where=np.isfinite(state.capacity), out=surplus)
        np.maximum(surplus, 0.0, out=surplus)
        offered = income * span
        ledger = watts * span, state.leak * span, offered, offered - stored * span, surplus
        return Advance(after._replace(left=after.left - surplus), died_after, *ledger)

    def _margin(self, state: BatteryState) -> Floats:
        """(n,) J that can be drawn slowly until each battery is empty, if no mode changes."""
        margin: Floats = state.left - state.reserve - self.weights @ state.uneven
        return margin

    def _after(self, state: BatteryState, net: Floats, seconds: Floats) -> BatteryState:
        """The state after a constant net load, without limits."""
        rates = self.rates[:, None]
        uneven = state.uneven - (state.uneven - net / rates) * -np.expm1(-rates * seconds)
        return state._replace(left=state.left - net * seconds, uneven=uneven)

    def _lasting(self, state: BatteryState, net: Floats, seconds: Floats | float) -> Floats:
        """(n,) s until each battery is empty at a constant net load, infinite if it is not within `seconds`.

        The margin never falls faster than it would now if the modes that even out did not, so that no step passes the
        first time at which it is nothing. Where all modes grow, these are the steps of Newton's method.
        """
        time, outlasts = np.zeros_like(state.left), np.zeros(state.left.shape, dtype=np.bool_)
        tiny = ROUNDING * np.where(np.isfinite(state.capacity), state.capacity, 0.0)
        while True:
            now = self._after(state, net, time)
            margin = np.maximum(self._margin(now), 0.0)
            falls = net + self.weights @ np.maximum(net - self.rates[:, None] * now.uneven, 0.0)
            with np.errstate(over="ignore"):  # next to no load lasts for ever
                further = np.divide(margin, falls, where=falls > 0.0, out=np.full_like(time, np.inf))
            outlasts |= time + further > seconds
            unknown = ~outlasts & (margin > tiny) & (further > ROUNDING * time)
            if not unknown.any():
                return np.where(outlasts, np.inf, time)
            time = np.where(unknown, time + further, time)


@part
class Linear(BatteryFields):
    """A battery that gives all that can be drawn, at any load. It can be charged by a harvester.

    With a `cut_off`, its voltage falls linearly with its charge from `full` to `empty`, and what is left at the cut-off
    cannot be drawn: (cut_off² - empty²) / (full² - empty²) of the energy. With `empty: 0 V` that is a capacitor.

    A node whose store is empty goes down, as in a crash, if it has a harvester, and starts again at `harvest.restart`.
    """

    full: Annotated[float, VOLTS, "voltage of a full battery"] = 3.0
    empty: Annotated[float, Quantity("V", ge=0.0, le=1e6), "voltage of a battery without charge"] = 0.0
    cut_off: Annotated[float | None, VOLTS, "voltage below which a node does not work; left out: it always works"] = (
        None
    )
    harvest: Annotated[Harvester | None, "a source that charges the battery"] = None

    def __post_init__(self) -> None:
        """Raises ValueError if the voltages are not in order, or nothing is left to start with."""
        if self.cut_off is not None and not self.empty <= self.cut_off < self.full:
            raise ValueError(
                f"cut_off: {self.cut_off:g} V must be from empty = {self.empty:g} V to full = {self.full:g} V"
            )
        if self.harvest is not None and self.harvest.restart <= 1.0 - self.share_drawable:
            lost = 1.0 - self.share_drawable
            raise ValueError(f"harvest.restart: must be above {lost:g}, the share of the capacity that cannot be drawn")

    @property
    def plain(self) -> bool:
        """Whether all nodes have `energy.battery`, all of which they can draw, and nothing else changes it."""
        return self == Linear()

    @property
    def share_drawable(self) -> float:
        """The share of the capacity that can be drawn."""
        share = super().share_drawable
        if self.cut_off is None:
            return share
        return share * (self.full**2 - self.cut_off**2) / (self.full**2 - self.empty**2)


class Misfit(RunError):
    """What a parameter says does not fit the network; `key` names the parameter."""

    def __init__(self, key: str, message: str) -> None:
        super().__init__(message)
        self.key = key


@part
class OfCharge(BatteryFields):
    """What kinds share whose capacity is a charge at a voltage, which is that of the circuit and stays the same."""

    charge: Annotated[
        float | None, Quantity("A s", gt=0.0, le=1e12), "charge of a full battery; left out: that of energy.battery"
    ] = None
    voltage: Annotated[float, VOLTS, "voltage at which the charge is drawn"] = 3.0

    def nominal(self, battery: float) -> float:
        """The capacity in J: charge times voltage."""
        return battery if self.charge is None else self.charge * self.voltage


@part
class Kinetic(OfCharge):
    """The kinetic battery model: a load draws on available charge, to which bound charge flows.

    The battery is empty when no charge is available, however much is bound, and recovers in idle times. With
    y1 = available charge and y2 = bound charge, y1' = -I + k (y2 / (1 - c) - y1 / c), and k' = k / (c (1 - c)).

    Source: Manwell, McGowan (1993); the parameters are those of Jongerden, Haverkort (2009).
    """

    available: Annotated[float, Quantity("", gt=0.0, lt=1.0), "c: share of the charge that is available"] = 0.166
    rate: Annotated[float, Quantity("Hz", gt=0.0, le=1e6), "k': rate at which available and bound charge even out"] = (
        0.122 / 60
    )

    @cached_property
    def weights(self) -> Floats:
        """(1,) (1 - c) / c."""
        return np.array([(1.0 - self.available) / self.available])

    @cached_property
    def rates(self) -> Floats:
        """(1,) k' in 1/s."""
        return np.array([self.rate])


@part
class Diffusion(OfCharge):
    """The diffusion model: charge reaches the electrode by diffusion, and the battery is empty when none is there.

    σ(t) = ∫ I + 2 Σ_m ∫ I(τ) exp(-β² m² (t - τ)) dτ; the battery is empty when σ = α, its charge. It recovers in idle
    times. The series has `terms` terms, as many as in the paper. A frame is drawn at once: the terms that are faster
    than its duration make it cost 1 + 2 `terms` of its charge for a moment.

    Source: Rakhmatov, Vrudhula (2001, 2003). The default β² is 0.637² per minute, that of the battery of the Itsy
    computer in Rakhmatov, Vrudhula, Wallach (2002).
    """

    rate: Annotated[float, Quantity("Hz", gt=0.0, le=1e6), "β²: rate of the slowest term"] = 0.637**2 / 60
    terms: Annotated[int, Quantity("", ge=1, le=100), "number of terms of the series"] = 10

    @cached_property
    def weights(self) -> Floats:
        """(terms,) 2."""
        return np.full(self.terms, 2.0)

    @cached_property
    def rates(self) -> Floats:
        """(terms,) β² m² in 1/s."""
        return self.rate * np.arange(1.0, self.terms + 1.0) ** 2
