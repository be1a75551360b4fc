"""Units against hand-made conversions, and against exact fractions."""

from __future__ import annotations

import math
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wsnsim.scenario.units import UnitError, parse, si

QUANTITIES = [
    ("60 m", "m", 60.0),
    ("60m", "m", 60.0),
    ("0.4 km", "m", 400.0),
    ("250 kbit/s", "bit/s", 250e3),
    ("12 B", "bit", 96.0),
    ("50 nJ", "J", 50e-9),
    ("50 nJ/bit", "J/bit", 50e-9),
    ("50 nJ / bit", "J/bit", 50e-9),
    ("100 pJ/bit/m2", "J/bit/m2", 100e-12),
    ("100 pJ/bit/m^2", "J/bit/m2", 100e-12),
    ("100 pJ/bit/m²", "J/bit/m2", 100e-12),
    ("0.0013 pJ/bit/m4", "J/bit/m4", 1.3e-15),
    ("5 min", "s", 300.0),
    ("2 h", "s", 7200.0),
    ("320 us", "s", 320e-6),
    ("320 µs", "s", 320e-6),
    ("320 μs", "s", 320e-6),
    ("0.67 nF", "F", 0.67e-9),
    ("1.5 V", "V", 1.5),
    ("8 MHz", "Hz", 8e6),
    ("8 MHz", "1/s", 8e6),
    ("62 mW", "W", 0.062),
    ("1 J/s", "W", 1.0),
    ("1 mWh", "J", 3.6),
    ("1 Ah", "A*s", 3600.0),
    ("36 km/h", "m/s", 10.0),
    ("30 ppm", "", 30e-6),
    ("25 %", "", 0.25),
    ("180 deg", "rad", math.pi),
    ("-85 dBm", "dBm", -85.0),
    ("1 mW", "dBm", 0.0),
    ("-30 dBm", "W", 1e-6),
    ("3 dB", "dB", 3.0),
    ("7 lx", "lx", 7.0),
    (".inf", "J", math.inf),
    (".inf J", "J", math.inf),
    ("-.inf", "", -math.inf),
    ("1e3 m", "m", 1000.0),
    ("-4.5 m", "m", -4.5),
]


@pytest.mark.parametrize(("text", "unit", "value"), QUANTITIES)
def test_a_quantity_has_the_value_that_one_writes_by_hand(text: str, unit: str, value: float) -> None:
    assert si(text, unit) == value


@given(st.decimals(-1_000_000, 1_000_000, places=6), st.sampled_from(["nJ", "kJ", "us", "pF", "min", "GHz", "km"]))
def test_a_quantity_is_its_exact_product_rounded_once(number, symbol: str) -> None:
    factors = {"nJ": "1e-9", "kJ": "1e3", "us": "1e-6", "pF": "1e-12", "min": "60", "GHz": "1e9", "km": "1e3"}
    unit = {"nJ": "J", "kJ": "J", "us": "s", "pF": "F", "min": "s", "GHz": "Hz", "km": "m"}[symbol]
    assert si(f"{number} {symbol}", unit) == float(Fraction(number) * Fraction(factors[symbol]))


@pytest.mark.parametrize(
    ("text", "unit", "message"),
    [
        ("75 kbit/s", "m", "'kbit/s' is a unit of data rate, expected length (for example '1 m')"),
        ("1 kJ", "m", "'kJ' is a unit of energy, expected length (for example '1 m')"),
        ("1 J/m", "m", "'J/m' is a unit of energy per length, expected length (for example '1 m')"),
        ("3 m", "", "'m' is a unit of length, expected a pure number"),
        ("3 %", "m", "'%' is a pure number, expected length (for example '1 m')"),
        ("3 dB", "dBm", "'dB' is a unit of level, expected power (for example '1 dBm')"),
        ("3 KM", "m", "unknown unit 'KM' (did you mean 'km'?), expected length (for example '1 m')"),
        ("12:30:00", "s", "unknown unit ':30:00', expected time (for example '1 s')"),
        ("far", "m", "expected length (for example '1 m'), got the text 'far'"),
        ("60", "m", "expected length (for example '1 m'), got the text '60': remove the quotes, or name a unit"),
        ("60 12", "", "expected a pure number, got the text '60 12'"),
        ("1e400 m", "m", "'1e400 m' is outside the range of numbers"),
        ("1e99999999999999999999 km", "m", "'1e99999999999999999999 km' is outside the range of numbers"),
        ("0 W", "dBm", "'0 W' is outside the range of numbers"),
        ("2,5", "m", "expected length (for example '1 m'), got the text '2,5': decimals have a point: 2.5"),
        ("1,5 m", "m", "expected length (for example '1 m'), got the text '1,5 m': decimals have a point: 1.5 m"),
        ("1year", "s", "unknown unit 'year' (did you mean '365 d'?), expected time (for example '1 s')"),
        ("1y", "s", "unknown unit 'y' (did you mean '365 d'?), expected time (for example '1 s')"),
        ("4/hour", "Hz", "unknown unit '1/hour' (did you mean '1/h'?), expected frequency (for example '1 Hz')"),
        ("7 lx", "m", "unknown unit 'lx', expected length (for example '1 m')"),
    ],
)
def test_a_wrong_quantity_says_what_is_expected(text: str, unit: str, message: str) -> None:
    with pytest.raises(UnitError) as caught:
        si(text, unit)
    assert str(caught.value) == message


@given(st.text(max_size=40), st.sampled_from(["m", "", "J/bit", "dBm", "lx"]))
def test_any_text_is_a_number_or_a_unit_error(text: str, unit: str) -> None:
    try:
        assert not math.isnan(si(text, unit))
    except UnitError as error:
        assert str(error)


def test_a_long_unit_is_refused_in_no_time() -> None:
    assert parse("m/" * 5000 + "q") is None
