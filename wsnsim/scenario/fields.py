"""The fields of a part become pydantic fields: types, units and bounds from the part's own annotations.

    fields_of(part_class) -> {name: (annotation, Field)}    nested_of(part_class) -> {name: the part that stands in it}

A real number takes a quantity with unit ('60 m'), a whole number takes 400.0 but not 400.5, neither takes true or NaN;
infinity only where nothing bounds it from above. A field whose type is a part itself becomes a mapping of that part's
fields.
"""

from __future__ import annotations

import dataclasses
import functools
import math
import types
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Final, Literal, Union, get_args, get_origin, get_type_hints

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    create_model,
)
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from wsnsim.base.part import Quantity
from wsnsim.scenario.units import UnitError, shown, si, wanted

FROZEN: Final = ConfigDict(extra="forbid", frozen=True, validate_default=True, protected_namespaces=())


class PartError(TypeError):
    """A class that cannot stand behind a role: no part, or with fields of types that no scenario can write."""


class PartModel(BaseModel):
    """The fields of one part; `part` is its class."""

    model_config = FROZEN
    part: ClassVar[type[Any]]


def refusal(message: str) -> PydanticCustomError:
    """The error with which a validator refuses a value; the message is kept as it is."""
    return PydanticCustomError("refused", "{message}", {"message": message})


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
        """Whether nothing bounds the number on this side; `lt=inf` says that it must be finite."""
        bounds = (self.quantity.lt, self.quantity.le) if infinity > 0 else (self.quantity.gt, self.quantity.ge)
        return not self.finite and bounds == (None, None)

    def _real(self, number: float | int) -> float:
        try:
            return float(number)
        except OverflowError:
            raise refusal(f"{shown(number)} is too large for a number") from None

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
        """Return the list as it is, or refuse the value."""
        several = "a list" if self.count is None else f"a list of {self.count} items"
        if not isinstance(value, list | tuple):
            raise refusal(f"expected {several}, got {described(value)}")
        if self.count is not None and len(value) != self.count:
            raise refusal(f"expected {several}, got {len(value)}")
        return value


@dataclass(frozen=True)
class Named:
    """Says in the JSON Schema that the name of a datasheet may stand in place of its fields."""

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {"anyOf": [handler(schema), {"type": "string", "description": "name of a datasheet"}]}


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
    if _is_part(kind):
        return Annotated[nested_model(kind), Named()]
    raise PartError(
        f"has a field of type {kind}, which no scenario can write: use float, int, bool, str, Literal, tuple, a part"
    )


def _is_part(kind: Any) -> bool:
    return isinstance(kind, type) and dataclasses.is_dataclass(kind)


@functools.cache
def nested_model(part: Any) -> type[PartModel]:
    """The model of a part that stands in a field of another. Raises PartError if it has a field named 'part'."""
    return made_model(part, PartModel, fields_of(part))


def made_model(part: type[Any], base: type[PartModel], fields: dict[str, Any]) -> type[PartModel]:
    """A model of these fields, with the part's name."""
    if "part" in fields:
        raise PartError("has a field named 'part', which is taken")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a part may call a field 'copy', which pydantic would rather not
        model = create_model(part.__name__, __base__=base, __module__=part.__module__, **fields)
    model.part = part
    return model


@dataclass(frozen=True)
class About:
    """What a part's annotation says of a field: in words, and its unit ('' for a pure number or a text)."""

    words: str
    unit: str


def abouts_of(part: type[Any]) -> dict[str, About]:
    """What the annotations say of a part's fields."""
    hints = get_type_hints(part, include_extras=True)
    return {name: _about(hints[name])[1] for name in names_of(part)}


def _about(hint: Any) -> tuple[Quantity, About]:
    notes = get_args(hint)[1:] if get_origin(hint) is Annotated else ()
    quantity = next((note for note in notes if isinstance(note, Quantity)), Quantity())
    return quantity, About(next((note for note in notes if isinstance(note, str)), ""), quantity.unit)


def names_of(part: type[Any]) -> list[str]:
    """The names of a part's fields."""
    return [field.name for field in dataclasses.fields(part) if field.init]


@functools.cache
def nested_of(part: Any) -> Mapping[str, Any]:
    """The fields of a part in which another part stands, or may stand."""
    found = {}
    for name, hint in get_type_hints(part).items():
        inner = next((kind for kind in (hint, *get_args(hint)) if _is_part(kind)), None)
        if inner is not None and name in names_of(part):
            found[name] = inner
    return types.MappingProxyType(found)


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
    quantity, about = _about(hint)
    unit = f"[{about.unit}]" if about.unit else ""
    default: dict[str, Any] = {}
    if field.default is not dataclasses.MISSING:
        written = field.default
        default = {"default": dataclasses.asdict(written) if _is_part(type(written)) else written}
    elif field.default_factory is not dataclasses.MISSING:
        default = {"default_factory": field.default_factory}
    annotation = annotation_of(get_args(hint)[0] if get_origin(hint) is Annotated else hint, quantity)
    return annotation, Field(description=" ".join(piece for piece in (about.words, unit) if piece) or None, **default)
