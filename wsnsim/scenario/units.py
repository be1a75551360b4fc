"""Numbers of scenarios, with units: '60 m', '250 kbit/s', '50 nJ/bit', '-85 dBm' become SI floats, exactly.

    si('50 nJ/bit', 'J/bit') -> 5e-8
    Annotated[float, Number(Quantity("m", gt=0))]       the annotation of a pydantic field that takes such quantities

The table is exact: number and factor are multiplied as decimals of 60 digits and rounded once, so '50 nJ' and 5e-8 are
the same float. Quotients and powers compose freely ('100 pJ/bit/m2', 'm^2', 'm²'). A unit that is not in the table
(a plug-in's 'lx') is accepted only where exactly this unit is expected.
"""

from __future__ import annotations

import functools
import math
import re
from decimal import Context, Decimal, localcontext
from pathlib import Path
from typing import Any, Final, NamedTuple

from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from wsnsim.base.errors import did_you_mean
from wsnsim.base.files import read_sections
from wsnsim.base.part import Quantity

BASES: Final = ("m", "kg", "s", "A", "rad", "bit", "dB")
Dimension = tuple[int, ...]
DIMENSIONLESS: Final[Dimension] = (0,) * len(BASES)
EXACT: Final = Context(prec=60, Emax=99_999, Emin=-99_999, traps=[])
PREFIXES: Final = {"p": "1e-12", "n": "1e-9", "u": "1e-6", "m": "1e-3", "c": "1e-2", "k": "1e3", "M": "1e6", "G": "1e9"}
_TABLES: Final = read_sections(Path(__file__).with_name("units.table"))
SYMBOLS: Final = {symbol: (factor, powers, prefixes) for symbol, factor, powers, prefixes in _TABLES[0].rows}
"""The factor of each unit to SI, the powers of `BASES`, and the prefixes that it takes."""
WORDS: Final = {unit: words for unit, words, *_ in _TABLES[1].rows}
"""What units measure."""
MEANT: Final = {word: unit for words, unit in _TABLES[2].rows for word in words.split()}
"""The unit, or the quantity in units, that a word means."""
NUMBER: Final = r"[-+]?(?:\.\d++|\d++(?:\.\d*+)?)(?:[eE][-+]?\d++)?+|[-+]?\.inf"
QUANTITY: Final = re.compile(rf"({NUMBER})\s*([^\d\s].*|1\s*/.*)?", re.ASCII)
FACTOR: Final = re.compile(r"(1$|%|[^\W\d_]+)(?:\^?(-?[1-9]))?")
SPELLING: Final = str.maketrans({"²": "2", "³": "3", "⁴": "4", "µ": "u", "μ": "u", "·": "*", "°": "deg"})


class UnitError(ValueError):
    """A quantity cannot be read or has the wrong dimension. `str(error)` says what is expected."""


class Unit(NamedTuple):
    """A unit: its factor to SI, the powers of `BASES`, the dimension in words, and whether it is dBm, a logarithm."""

    factor: Decimal
    dimension: Dimension
    words: str
    decibel: bool = False


def si(text: str, unit: str) -> float:
    """Return the SI value of a quantity.

    Args:
        text: a number with a unit, such as '60 m'.
        unit: a unit of the expected dimension; '' for a pure number; with 'dBm' the result is in dBm.

    Raises:
        UnitError: no number, an unknown unit, another dimension, or a value too large for a float.
    """
    match = QUANTITY.fullmatch(text.strip())
    if match is None or (match.group(2) or "").startswith(","):
        decimals = f": decimals have a point: {text.strip().replace(',', '.', 1)}" if match else ""
        raise UnitError(f"expected {wanted(unit)}, got the text {shown(text)}{decimals}")
    number, unit_text = match.group(1), match.group(2)
    if number.endswith(".inf"):
        number = number.replace(".inf", "Infinity")
    elif not unit_text:
        raise UnitError(f"expected {wanted(unit)}, got the text {shown(text)}: remove the quotes, or name a unit")
    with localcontext(EXACT):
        written = (unit_text or "").strip()  # "2/h" is 2 1/h
        value = float(_convert(Decimal(number), f"1{written}" if written.startswith("/") else written, unit))
    if math.isnan(value) or (math.isinf(value) and "Inf" not in number):
        raise UnitError(f"{shown(text)} is outside the range of numbers")
    return value


def _convert(number: Decimal, unit_text: str, unit: str) -> Decimal:
    """Return the number in SI units, or in dBm if `unit` is dBm."""
    expected = parse(unit)
    if not unit_text or (unit_text == unit and (expected is None or expected.decibel)):
        return number  # infinity, dBm, or a unit outside the table
    given = parse(unit_text)
    if given is None:
        raise UnitError(f"unknown unit {shown(unit_text)}{_suggestion(unit_text)}, expected {wanted(unit)}")
    if expected is None or given.dimension != expected.dimension:
        what = "a pure number" if given.dimension == DIMENSIONLESS else f"a unit of {given.words}"
        raise UnitError(f"{shown(unit_text)} is {what}, expected {wanted(unit)}")
    if given.decibel:
        return Decimal(10) ** ((number - 30) / 10)
    value = number * given.factor
    return 10 * value.log10() + 30 if expected.decibel else value


@functools.lru_cache(maxsize=1024)
def parse(text: str) -> Unit | None:
    """Return the unit of a text such as 'nJ/bit/m2', or None if it is unknown."""
    if not text:
        return Unit(Decimal(1), DIMENSIONLESS, "pure number")
    if text == "dBm":
        return Unit(Decimal(1), _dimension({"kg": 1, "m": 2, "s": -3}), "power", decibel=True)
    factor, dimension = Decimal(1), DIMENSIONLESS
    words: list[str] = []
    pieces = [piece.strip() for piece in re.split(r"([/*])", text.translate(SPELLING))]
    for sign, piece in zip(["*", *pieces[1::2]], pieces[::2], strict=True):
        match = FACTOR.fullmatch(piece)
        known = _table().get(match.group(1)) if match else None
        if match is None or known is None:
            return None
        power = int(match.group(2) or 1)
        joint, own = "" if not words else " per " if sign == "/" else " times ", _to_power(known[1], power)
        words.append(joint + ("one" if own == DIMENSIONLESS else _dimension_names().get(own, piece)))
        power = -power if sign == "/" else power
        factor = EXACT.multiply(factor, EXACT.power(known[0], power))
        dimension = tuple(a + b for a, b in zip(dimension, _to_power(known[1], power), strict=True))
    return Unit(factor, dimension, _dimension_names().get(dimension) or "".join(words))


def wanted(unit: str) -> str:
    """Return how an error message names the expected quantity: "length (for example '1 m')"."""
    known = parse(unit)
    if known is None:
        return f"a number (of {unit})"
    return "a pure number" if known.dimension == DIMENSIONLESS else f"{known.words} (for example '1 {unit}')"


def shown(value: object) -> str:
    """Return a value as a message quotes it: on one line, shortened to at most 60 characters."""
    text = repr(value) if not isinstance(value, str) else f"'{''.join(c if c.isprintable() else '?' for c in value)}'"
    return text if len(text) <= 60 else f"{text[:50]}…{text[-8:]}"


def _suggestion(unit_text: str) -> str:
    meant = "".join(MEANT.get(piece.strip().lower(), piece) for piece in re.split(r"([/*])", unit_text))
    guess = f"did you mean '{meant}'?" if meant != unit_text else did_you_mean(unit_text, [*_table(), "dBm"])
    return f" ({guess})" if guess.startswith("did") else ""


def _to_power(dimension: Dimension, power: int) -> Dimension:
    return tuple(power * exponent for exponent in dimension)


def _dimension(powers: dict[str, int]) -> Dimension:
    return tuple(powers.get(base, 0) for base in BASES)


@functools.cache
def _table() -> dict[str, tuple[Decimal, Dimension]]:
    """Return every symbol, with and without its prefixes."""
    table = {}
    for symbol, (factor, powers, prefixes) in SYMBOLS.items():
        dimension = _dimension({match[1]: int(match[2] or 1) for match in FACTOR.finditer(powers)})
        for prefix in ["", *prefixes]:
            scale = Decimal(PREFIXES[prefix]) if prefix else Decimal(1)
            assert prefix + symbol not in table, f"two units are written {prefix + symbol}"
            table[prefix + symbol] = (EXACT.multiply(scale, Decimal(factor)), dimension)
    return table


@functools.cache
def _dimension_names() -> dict[Dimension, str]:
    """Return the name of each dimension."""
    words = {}
    for text, word in WORDS.items():
        dimension = DIMENSIONLESS
        for sign, piece in zip(["*", *re.findall(r"[/*]", text)], re.split(r"[/*]", text), strict=True):
            match = FACTOR.fullmatch(piece)
            assert match, f"{text} in the table of words is not a unit"
            power = int(match.group(2) or 1) * (-1 if sign == "/" else 1)
            factor = _to_power(_table()[match.group(1)][1], power)
            dimension = tuple(a + b for a, b in zip(dimension, factor, strict=True))
        words[dimension] = word
    return words


def refusal(message: str) -> PydanticCustomError:
    """Return the error that a validator raises to refuse a value; the message is shown as it is."""
    return PydanticCustomError("refused", "{message}", {"message": message})


class Number(NamedTuple):
    """A pydantic annotation: a real or whole number with unit and bounds."""

    quantity: Quantity
    whole: bool = False
    finite: bool = False

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        given = {name: getattr(self.quantity, name) for name in ("gt", "ge", "lt", "le")}
        bounds = {name: bound for name, bound in given.items() if bound is not None and math.isfinite(bound)}
        if not self.whole:
            return core_schema.no_info_before_validator_function(self.read, core_schema.float_schema(**bounds))
        whole = {name: math.floor(b) if name in ("gt", "le") else math.ceil(b) for name, b in bounds.items()}
        return core_schema.no_info_before_validator_function(self.read, core_schema.int_schema(**whole))

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        number = handler(schema)
        return {"anyOf": [number, {"type": "string", "description": wanted(self.quantity.unit)}]}

    def read(self, value: Any) -> float | int:
        """Return the SI value of what a scenario writes."""
        if isinstance(value, bool) or not isinstance(value, int | float | str):
            raise refusal(f"expected {self._wanted()}, got {described(value)}")
        number = self._si(value)
        if isinstance(number, float) and math.isnan(number):
            raise refusal(f"expected {self._wanted()}, got not-a-number")
        if isinstance(number, float) and math.isinf(number) and (self.whole or not self._takes(number)):
            raise refusal("must be finite")
        if self.whole and number != math.floor(number):
            raise refusal(f"expected a whole number, got {number:g}")
        return int(number) if self.whole else self._real(number)

    def _si(self, value: float | str) -> float | int:
        if not isinstance(value, str):
            return value
        try:
            return si(value, self.quantity.unit)
        except UnitError as error:
            raise refusal(str(error)) from None

    def _takes(self, infinity: float) -> bool:
        """Return whether there is no bound on the side of this infinity; `lt=inf` demands a finite number."""
        bounds = (self.quantity.lt, self.quantity.le) if infinity > 0 else (self.quantity.gt, self.quantity.ge)
        return not self.finite and bounds == (None, None)

    def _real(self, number: float | int) -> float:
        try:
            return float(number)
        except OverflowError:
            raise refusal(f"{shown(number)} is too large for a number") from None

    def _wanted(self) -> str:
        return "a whole number" if self.whole else "a number" if not self.quantity.unit else wanted(self.quantity.unit)


def demand_items(length: int | None, value: Any) -> Any:
    """Return a list as it is; refuse other values, and lists of another length (None: any length will do)."""
    several = "a list" if length is None else f"a list of {length} items"
    if not isinstance(value, list | tuple):
        raise refusal(f"expected {several}, got {described(value)}")
    if length is not None and len(value) != length:
        raise refusal(f"expected {several}, got {len(value)}")
    return value


class Named(NamedTuple):
    """A pydantic annotation: the JSON Schema allows the name of a datasheet in place of its fields."""

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {"anyOf": [handler(schema), {"type": "string", "description": "name of a datasheet"}]}


def described(value: Any) -> str:
    """Return a value as a message describes it: "the text 'x'", "the number 3", "nothing"."""
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return f"the text {shown(value)}"
    if isinstance(value, dict):
        return "a mapping"
    return "a list" if isinstance(value, list | tuple) else f"the number {shown(value)}"
