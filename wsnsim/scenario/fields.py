"""The fields of a part become pydantic fields: types, units and bounds from the part's own annotations.

    fields_of(part_class) -> {name: (annotation, Field)}

A real number takes a quantity with unit ('60 m'), a whole number takes 400.0 but not 400.5, neither takes true or NaN;
infinity only where nothing bounds it from above.
"""

from __future__ import annotations

import dataclasses
import math
import types
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from pydantic import BeforeValidator, Field, GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from wsnsim.base.part import Quantity
from wsnsim.scenario.units import UnitError, shown, si, wanted


class PartError(TypeError):
    """A class that cannot stand behind a role: no part, or with fields of types that no scenario can write."""


def refusal(message: str) -> PydanticCustomError:
    """The error with which a validator refuses a value; the message is kept as it is."""
    return PydanticCustomError("refused", "{said}", {"said": message})


@dataclass(frozen=True)
class Number:
    """A real or whole number with unit and bounds, as an annotation that pydantic understands."""

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
        """The SI value of what a scenario writes."""
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
        """Whether nothing bounds the number on this side; `lt=inf` says that it must be finite."""
        bounds = (self.quantity.lt, self.quantity.le) if infinity > 0 else (self.quantity.gt, self.quantity.ge)
        return not self.finite and bounds == (None, None)

    def _real(self, number: float | int) -> float:
        try:
            return float(number)
        except OverflowError:
            raise refusal(f"{shown(number)} is beyond what a number can hold") from None

    def _wanted(self) -> str:
        return "a whole number" if self.whole else "a number" if not self.quantity.unit else wanted(self.quantity.unit)


@dataclass(frozen=True)
class Strict:
    """Text or a truth value that is not made from anything else."""

    schema: Literal["str", "bool"]

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.str_schema(strict=True) if self.schema == "str" else core_schema.bool_schema(strict=True)


@dataclass(frozen=True)
class Items:
    """A list, of `count` items if that is a number."""

    count: int | None

    def __call__(self, value: Any) -> Any:
        several = "a list" if self.count is None else f"a list of {self.count} items"
        if not isinstance(value, list | tuple):
            raise refusal(f"expected {several}, got {described(value)}")
        if self.count is not None and len(value) != self.count:
            raise refusal(f"expected {several}, got {len(value)}")
        return value


def described(value: Any) -> str:
    """A wrong value in a message."""
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return f"the text {shown(value)}"
    if isinstance(value, dict):
        return "a mapping"
    return "a list" if isinstance(value, list | tuple) else f"the number {shown(value)}"


def annotation_of(kind: Any, quantity: Quantity) -> Any:
    """The pydantic annotation of a field's type. Raises PartError for a type that a scenario cannot write."""
    origin, arguments = get_origin(kind), get_args(kind)
    if kind is float or kind is int:
        return Annotated[kind, Number(quantity, whole=kind is int)]
    if kind is str or kind is bool:
        return Annotated[kind, Strict("str" if kind is str else "bool")]
    if origin is Literal or kind is type(None):
        return kind
    if origin is tuple:
        inner = tuple(argument if argument is ... else annotation_of(argument, quantity) for argument in arguments)
        items = Items(None if ... in arguments else len(arguments))
        return Annotated[tuple[inner], BeforeValidator(items)]  # type: ignore[valid-type]
    if origin in (Union, types.UnionType):
        return Union[tuple(annotation_of(argument, quantity) for argument in arguments)]  # noqa: UP007
    raise PartError(
        f"has a field of type {kind}, which no scenario can write: use float, int, bool, str, Literal, tuple"
    )


def fields_of(part: type[Any]) -> dict[str, tuple[Any, Any]]:
    """A part's fields as pydantic's `create_model` takes them. Raises PartError if the class is no part."""
    if not dataclasses.is_dataclass(part):
        raise PartError("is no part: put @wsnsim.part on the class")
    try:
        hints = get_type_hints(part, include_extras=True)
    except Exception as reason:
        raise PartError(f"has annotations that cannot be read: {type(reason).__name__}: {reason}") from reason
    return {field.name: _field(field, hints[field.name]) for field in dataclasses.fields(part) if field.init}


def _field(field: dataclasses.Field[Any], hint: Any) -> tuple[Any, Any]:
    notes = get_args(hint)[1:] if get_origin(hint) is Annotated else ()
    quantity = next((note for note in notes if isinstance(note, Quantity)), Quantity())
    words = next((note for note in notes if isinstance(note, str)), "")
    unit = f"[{quantity.unit}]" if quantity.unit else ""
    default: dict[str, Any] = {}
    if field.default is not dataclasses.MISSING:
        default = {"default": field.default}
    elif field.default_factory is not dataclasses.MISSING:
        default = {"default_factory": field.default_factory}
    annotation = annotation_of(get_args(hint)[0] if notes else hint, quantity)
    return annotation, Field(description=" ".join(piece for piece in (words, unit) if piece) or None, **default)
