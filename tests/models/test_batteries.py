"""Batteries: published lifetimes, differential equations, charge that is neither made nor lost, and wrong input."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from wsnsim.base.batteries import Advance, BatteryState
from wsnsim.models.batteries import BatteryFields, Diffusion, Kinetic, Linear
from wsnsim.models.harvest import Harvester

MINUTE: Final = 60.0


def full(battery: BatteryFields, capacity: float, nodes: int = 1) -> BatteryState:
    """Full batteries of one capacity in J."""
    each = np.full(nodes, capacity)
    leak = each * battery.leakage
    return BatteryState(each, each * (1.0 - battery.share_drawable), leak, each, np.zeros((battery.rates.size, nodes)))


def life(battery: BatteryFields, capacity: float, loads: list[float], starts: list[float]) -> float:
    """Minutes for which a full battery (W min) supplies loads (W), each from its start (min) until the next."""
    state = full(battery, capacity * MINUTE)
    for load, start, end in zip(loads, starts, [*starts[1:], 1e9], strict=True):
        done = battery.advance(state, np.array([load]), (end - start) * MINUTE)
        if np.isfinite(done.died_after[0]):
            return start + float(done.died_after[0]) / MINUTE
        state = done.state
    return float("inf")


def repeated(loads: list[float], spans: list[float], times: int, begin: float = 0.0) -> tuple[list[float], list[float]]:
    """Loads in turn, and their starts."""
    starts = begin + np.concatenate([[0.0], np.cumsum(spans * times)[:-1]])
    return loads * times, starts.tolist()


def profile(begin: tuple[list[float], list[float]], *parts: tuple[list[float], list[float]]) -> Any:
    """The loads and starts of several parts, one after the other."""
    parts = (begin, *parts)
    return [load for part in parts for load in part[0]], [start for part in parts for start in part[1]]


RISING, MIDDLE = [0.0843, 0.1083, 0.2045, 0.2227], [0.0755, 0.0949, 0.2045, 0.2227]
VIDEO: Final = [0.628, 0.4947, 0.2523, 0.2341, 0.1379, 0.1139]
VARIABLE: Final[dict[str, tuple[Any, float, float]]] = {
    "C1": (([0.628, 0, 0.628], [0, 19.5, 26]), 55.0, 36.2),
    "C2": (([0.4947, 0, 0.4947], [0, 31, 41.3]), 73.9, 55.8),
    "C3": (([0.4256, 0, 0.4256], [0, 41, 54.6]), 88.8, 71.8),
    "C4": (([0.2923, 0, 0.2923], [0, 74.6, 99.5]), 137.8, 124.9),
    "C5": (([0.2227, 0, 0.2227], [0, 105.7, 140.9]), 185.8, 176.7),
    "C6": (([0.628, 0, 0.628], [0, 19.5, 29.9]), 58.9, 41.0),
    "C7": (([0.628, 0, 0.628], [0, 19.5, 22.1]), 51.1, 30.8),
    "C8": (([0.628, 0, 0.628], [0, 23.4, 29.9]), 55.0, 37.4),
    "C9": (([0.628, 0, 0.628], [0, 15.6, 22.1]), 55.0, 35.2),
    "C10": (([0.3, *VIDEO, 0.2656], [0, 0.5, 5.5, 10.5, 35.5, 60.5, 85.5, 110.5]), 144.3, 132.6),
    "C11": (([0.3, *VIDEO[::-1], 0.2656], [0, 0.5, 25.5, 50.5, 75.5, 100.5, 105.5, 110.5]), 144.3, 107.4),
    "C12": (
        ([0.3, *VIDEO[:0:-1], 0, 0.3, 0.628, 0.2656], [0, 0.5, 25.5, 50.5, 75.5, 100.5, 105.5, 130.5, 131, 136]),
        169.3,
        155.4,
    ),
    "C13": (profile(([0.3], [0]), repeated(VIDEO, [1, 1, 5, 5, 5, 5], 5, 0.5), ([0.2656], [110.5])), 144.3, 131.7),
    "C14": (
        profile(([0.3], [0]), repeated(VIDEO[::-1], [5, 5, 5, 5, 1, 1.5], 5, 0.5), ([0.2656], [112.5])),
        141.5,
        126.3,
    ),
    "C15": (([*RISING[::-1], 0.2227], [0, 50, 100, 150, 200]), 211.4, 209.2),
    "C16": (([*RISING, 0.2227], [0, 50, 100, 150, 200]), 211.4, 200.7),
    "C17": (([*RISING[:3], 0, 0.2227, 0.2227], [0, 50, 100, 150, 200, 250]), 261.4, 251.2),
    "C18": (profile(repeated(RISING, [5.0] * 4, 10), ([0.2227], [200])), 211.4, 204.6),
    "C19": (profile(repeated(MIDDLE, [5.0] * 4, 10), ([0.2227], [200])), 216.4, 208.7),
    "C20": (repeated([0.4947, 0.628], [1.0, 1.0], 50), 55.3, 33.2),
    "C21": (repeated([0.4947, 0.628, 0.0576], [1.0, 1.0, 1.0], 50), 79.6, 55.9),
    "C22": (([0.005 * (i + 1) for i in range(150)], [float(i) for i in range(150)]), 112.2, 94.5),
}
"""Loads (A) from their starts (min), and the lifetimes (min) of two batteries.

From Rakhmatov, Vrudhula, Wallach (2002), as ns-3's rv-battery-model-test lists them. In that list some times are off:
the last load of C18 and C19 begins at 200 s in place of 200 min, and a period of C13 takes 22.5 min, though its loads
last for 22. C14 has the times of the list, since those of the paper give another lifetime, as the list says.
"""
ITSY: Final = 35.22, Diffusion(rate=0.637**2 / MINUTE)
DUALFOIL: Final = 40.027, Diffusion(rate=0.276**2 / MINUTE)


@pytest.mark.parametrize(
    ("load", "seconds"), [(0.640, 2844), (0.320, 6146), (0.128, 16_052), (0.064, 32_561), (0.032, 65_580)]
)
def test_diffusion_has_the_published_lifetimes_at_constant_loads(load: float, seconds: float) -> None:
    capacity, battery = ITSY
    # the list has whole seconds, upwards
    assert life(battery, capacity, [load], [0.0]) * MINUTE == pytest.approx(seconds - 0.5, abs=0.51)


@pytest.mark.parametrize("name", VARIABLE)
def test_diffusion_has_the_published_lifetimes_at_variable_loads(name: str) -> None:
    loads, itsy, dualfoil = VARIABLE[name]
    found = [life(battery, capacity, *loads) for capacity, battery in (ITSY, DUALFOIL)]
    # C22 on the Itsy battery differs by 1.3 min in 112; all others by what 0.1 min of rounding leaves
    assert found[0] == pytest.approx(itsy, abs=1.3 if name == "C22" else 0.11)
    # 10 terms of the series, which matter more to the slower battery: at most 0.4 %
    assert found[1] == pytest.approx(dualfoil, abs=0.06, rel=0.0045)


B1: Final = 5.5, Kinetic(available=0.166, rate=0.122 / MINUTE)


@pytest.mark.parametrize(
    ("loads", "starts", "minutes"),
    [([0.25], [0.0], 4.53), ([0.5], [0.0], 2.02), ([0.25, 0.0] * 30, [float(i) for i in range(60)], 10.80)],
)
def test_kinetic_battery_has_the_lifetimes_of_jongerden_and_haverkort(
    loads: list[float], starts: list[float], minutes: float
) -> None:
    capacity, battery = B1
    assert life(battery, capacity, loads, starts) == pytest.approx(minutes, abs=0.005)


def test_kinetic_battery_solves_its_differential_equations() -> None:
    capacity, battery, c, k = 330.0, B1[1], 0.166, 0.122 / MINUTE * 0.166 * 0.834
    wells, state = np.array([c, 1.0 - c]) * capacity, full(B1[1], 330.0)
    for load, seconds in [(0.25, 100.0), (0.0, 70.0), (0.4, 20.0), (0.1, 60.0)]:
        flow = lambda _, y, load=load: [k * (y[1] / (1 - c) - y[0] / c) - load, -k * (y[1] / (1 - c) - y[0] / c)]  # noqa: E731
        wells = solve_ivp(flow, (0.0, seconds), wells, rtol=1e-11, atol=1e-11).y[:, -1]
        state = battery.advance(state, np.array([load]), seconds).state
        assert battery.drawable(state)[0] == pytest.approx(wells[0], rel=1e-6)
        assert state.left[0] == pytest.approx(wells.sum(), rel=1e-6)


@pytest.mark.parametrize(("capacity", "months"), [(250.0, 1.45), (1000.0, 5.78), (3000.0, 17.35)])
def test_a_mote_lives_as_long_as_its_manual_computes(capacity: float, months: float) -> None:
    """Crossbow, MPR/MIB User's Manual 7430-0021-06, table 6-3: currents in mA, duty cycles in %, 730 h a month."""
    duties = [
        (8.0, 1.0),
        (8e-3, 99.0),
        (8.0, 0.75),
        (12.0, 0.25),
        (2e-3, 99.0),
        (2e-3, 100.0),
        (5.0, 1.0),
        (5e-3, 99.0),
    ]
    load = sum(milliamperes * share / 100.0 for milliamperes, share in duties)
    battery = Linear()
    lasts = battery.advance(full(battery, capacity * 3.6 * 3.0), np.array([load * 3e-3]), 1e9).died_after[0]
    assert lasts / 3600.0 / 730.0 == pytest.approx(months, abs=0.02)  # its mA h an hour have four digits


KINDS: Final = {
    "linear": Linear(self_discharge=0.3, usable=0.9),
    "kinetic": Kinetic(self_discharge=0.3, usable=0.9),
    "diffusion": Diffusion(self_discharge=0.3, usable=0.9),
}


def balance(before: BatteryState, done: Advance) -> Any:
    """What a span made of nothing, in J: zero."""
    lost = done.spent + done.leaked + done.unstored + done.surplus
    return before.left + done.harvested - lost - done.state.left


@pytest.mark.parametrize("kind", KINDS)
def test_a_span_is_the_sum_of_its_parts_and_loses_nothing(kind: str) -> None:
    battery, watts = KINDS[kind], np.array([1e-4, 2e-3, 0.02, 0.5])
    start = battery.draw_at_once(full(battery, 2000.0, 4), np.array([0.0, 3.0, 1.0, 2.0]))
    whole = battery.advance(start, watts, 4e4)
    first = battery.advance(start, watts, 1e4)
    second = battery.advance(first.state, watts, 3e4)
    lived = np.isinf(whole.died_after)
    assert lived.tolist() == [True, True, True, False]
    np.testing.assert_allclose(second.state.left[lived], whole.state.left[lived], rtol=1e-12)
    np.testing.assert_allclose(second.state.uneven[:, lived], whole.state.uneven[:, lived], rtol=1e-9)
    assert np.abs(balance(start, whole)).max() < 1e-9
    assert battery.drawable(whole.state)[3] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_a_lifetime_of_years_is_found_in_one_span(kind: str) -> None:
    battery, watts = KINDS[kind], np.array([1e-4, 1e-3, 0.1, 5.0])
    died = battery.advance(full(battery, 2e4, 4), watts, 1e12).died_after
    just = battery.advance(full(battery, 2e4, 4), watts, died * (1.0 - 1e-9))
    assert np.isinf(just.died_after).all()
    power = watts + full(battery, 2e4).leak
    assert (battery.drawable(just.state) <= 2e-9 * power * died + 1e-8).all()
    np.testing.assert_allclose(died[:2], (0.9 * 2e4 / power)[:2], rtol=1e-2)  # slow loads leave hardly anything


def test_self_discharge_doubles_in_ten_kelvin_and_cold_takes_capacity() -> None:
    rates = [Linear(self_discharge=0.1, temperature=each).leakage for each in (20.0, 30.0)]
    assert rates[0] * 365.25 * 86400.0 == pytest.approx(0.1)
    assert rates[1] / rates[0] == pytest.approx(2.0, rel=1e-3)
    assert Linear(temperature=-10.0, cold=0.01).share_drawable == pytest.approx(0.7)


def test_a_capacitor_holds_half_of_the_square_of_its_voltage() -> None:
    battery = Linear(full=2.7, cut_off=1.8)
    assert battery.share_drawable == pytest.approx(1.0 - (1.8 / 2.7) ** 2)


@pytest.mark.parametrize("repeats", [False, True])
def test_the_income_is_that_of_the_rows_of_the_trace_which_may_repeat(repeats: bool, tmp_path: Path) -> None:
    (tmp_path / "sun.csv").write_text("time,irradiance\n1,100\n4,0\n6,50\n")
    battery = Linear(harvest=Harvester(path=str(tmp_path / "sun.csv"), area=0.1, efficiency=0.2, repeats=repeats))
    time, joules = 0.5, 0.0
    while time < 21.0:
        income = battery.income(time)
        until = min(income.until, 21.0)
        joules, time = joules + income.watts * (until - time), until
    # 2 W for 3 s, nothing for 2 s, 1 W for 2.5 s: the median of the intervals; from 17 s on the third turn
    assert joules == pytest.approx(2 * 8.5 + 6.0 if repeats else 8.5)


def test_a_store_takes_no_more_than_its_capacity_and_says_so() -> None:
    battery, state = Linear(harvest=Harvester(path="none", charging=0.8)), full(Linear(), 10.0, 2)
    state = state._replace(left=np.array([2.0, 9.0]))
    done = battery.advance(state, np.array([0.1, 0.1]), 10.0, 1.0)
    assert done.state.left == pytest.approx([9.0, 10.0])
    assert done.surplus == pytest.approx([0.0, 6.0])
    assert done.unstored == pytest.approx([2.0, 2.0])
    assert np.abs(balance(state, done)).max() < 1e-12


@given(
    st.sampled_from([Kinetic(rate=0.01), Diffusion(rate=0.01), Diffusion(rate=1e-4, usable=0.8)]),
    st.lists(st.tuples(st.floats(0.0, 0.4), st.floats(0.1, 300.0)), min_size=1, max_size=4),
    st.floats(0.0, 8.0),
    st.floats(1e-3, 1.0),
)
def test_no_battery_is_empty_before_it_dies_whatever_it_gave_before(battery, loads, at_once, last):
    state = full(battery, 300.0)
    for load, seconds in loads:  # in the end, some modes grow and others even out
        state = battery.advance(state, np.array([load]), seconds).state
    at_once = min(at_once, 0.9 * float(battery.drawable(state)[0]))
    state = battery.draw_at_once(state, np.array([at_once]))
    died = float(battery.advance(state, np.array([last]), 1e7).died_after[0])
    assert np.isfinite(died)
    times = died * np.append(np.linspace(0.0, 0.999, 200), 1.0 - 1e-6)
    states = BatteryState(*(np.repeat(column, 201, axis=-1) for column in state))
    drawable = battery.drawable(battery.advance(states, np.full(201, last), times).state)
    already = float(battery.drawable(state)[0]) < 1e-9
    assert already or (drawable[:-1] > 0.0).all()
    assert drawable[-1] <= 2e-6 * last * died + 1e-9
