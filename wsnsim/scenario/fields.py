"""From the fields of a component to pydantic fields: types, units and bounds come from its annotations.

    fields_of(class) -> {name: (annotation, Field)}      nested_of(class) -> {name: class of the component within}

A real number takes a quantity with unit ('60 m'), a whole number takes 400.0 but not 400.5, neither takes true or NaN;
infinity is allowed only where there is no bound on that side. A field whose type is a component becomes a mapping of
the fields of that component; one that holds any component of a role (`OfRole`) any mapping, until its kind is known,
or a list of mappings.

A class that lacks a member of the port of its role is refused by `demand_port`, with the place of its kind, instead of
failing during a run.
"""

from __future__ import annotations

import dataclasses
import functools
import math
import types
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from typing import (
    Annotated,
    Any,
    ClassVar,
    Final,
    Generic,
    Literal,
    Protocol,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

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

from wsnsim.base import ports, radio, sleeping, synchronisation
from wsnsim.base.errors import did_you_mean
from wsnsim.base.part import OfRole, Quantity
from wsnsim.scenario.registry import ROLES, load_class
from wsnsim.scenario.units import UnitError, shown, si, wanted

FROZEN: Final = ConfigDict(
    extra="forbid", frozen=True, validate_default=True, protected_namespaces=(), defer_build=True
)
"""A model is built at its first use: most are only parts of a scenario's model, which is built as a whole."""


class PartError(TypeError):
    """A class is not a valid component of a role: no @part, fields of unknown types, or members that are missing."""


class PartModel(BaseModel):
    """The pydantic model of one component; `part` is the component's class."""

    model_config = FROZEN
    part: ClassVar[type[Any]]


def refusal(message: str) -> PydanticCustomError:
    """Return the error that a validator raises to refuse a value; the message is shown as it is."""
    return PydanticCustomError("refused", "{message}", {"message": message})


@dataclass(frozen=True)
class Number:
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


@dataclass(frozen=True)
class Strict:
    """A pydantic annotation: a text or a truth value, without conversion from other types."""

    schema: Literal["str", "bool"]

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.str_schema(strict=True) if self.schema == "str" else core_schema.bool_schema(strict=True)


@dataclass(frozen=True)
class Items:
    """A validator of lists; `count`: their number of items, None: any."""

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


def annotation_of(kind: Any, quantity: Quantity) -> Any:
    """Return the pydantic annotation of a field.

    Raises:
        PartError: a scenario cannot express values of this type.
    """
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
        return Annotated[nested_model(kind), Named()] if getattr(kind, "sheet", "any") else nested_model(kind)
    raise PartError(
        f"has a field of type {kind}, which no scenario can write: use float, int, bool, str, Literal, tuple or a @part"
    )


def _is_part(kind: Any) -> bool:
    return isinstance(kind, type) and dataclasses.is_dataclass(kind)


@functools.cache
def nested_model(part: Any) -> type[PartModel]:
    """Return the model of a component within another. Raises PartError if it has a field named 'part'."""
    return made_model(part, PartModel, fields_of(part))


def made_model(part: type[Any], base: type[PartModel], fields: dict[str, Any]) -> type[PartModel]:
    """Return a model with these fields, named after the component."""
    if "part" in fields:
        raise PartError("has a field named 'part', which is taken")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # pydantic warns of a field named 'copy'
        model = create_model(part.__name__, __base__=base, __module__=part.__module__, **fields)
    model.part = part
    return model


@dataclass(frozen=True)
class About:
    """The description of a field and its unit ('' for a pure number or a text), from its annotation."""

    words: str
    unit: str


def abouts_of(part: type[Any]) -> dict[str, About]:
    """Return the descriptions of a component's fields, by name."""
    hints = get_type_hints(part, include_extras=True)
    return {name: _about(hints[name])[1] for name in names_of(part)}


def _about(hint: Any) -> tuple[Quantity, About]:
    notes = get_args(hint)[1:] if get_origin(hint) is Annotated else ()
    quantity = next((note for note in notes if isinstance(note, Quantity)), Quantity())
    return quantity, About(next((note for note in notes if isinstance(note, str)), ""), quantity.unit)


def names_of(part: type[Any]) -> list[str]:
    """Return the names of a component's fields."""
    return [field.name for field in dataclasses.fields(part) if field.init]


@functools.cache
def nested_of(part: Any) -> Mapping[str, Any]:
    """Return the fields of a component that hold, or may hold, another component, with its class."""
    found = {}
    for name, hint in get_type_hints(part).items():
        inner = next((kind for kind in (hint, *get_args(hint)) if _is_part(kind)), None)
        if inner is not None and name in names_of(part):
            found[name] = inner
    return types.MappingProxyType(found)


@dataclass(frozen=True)
class Inner:
    """The role of the components that a field holds; `several`: a list of them."""

    role: str
    several: bool


def roles_of(part: Any) -> Mapping[str, Inner]:
    """Return the fields of a component that hold a component, or a list of them, of any kind of a role."""
    return _roles_of(part)


@functools.cache
def _roles_of(part: Any) -> Mapping[str, Inner]:
    hints = get_type_hints(part, include_extras=True)
    found = {name: _inner_in(hints[name]) for name in names_of(part)}
    return types.MappingProxyType({name: inner for name, inner in found.items() if inner})


def _inner_in(hint: Any) -> Inner | None:
    held, *notes = get_args(hint) if get_origin(hint) is Annotated else (hint,)
    role = next((note.role for note in notes if isinstance(note, OfRole)), "")
    return Inner(role, get_origin(held) is tuple) if role else None


def fields_of(part: type[Any]) -> dict[str, tuple[Any, Any]]:
    """Return the fields of a component as arguments of pydantic's `create_model`.

    Raises:
        PartError: the class is not a component, or its annotations cannot be read.
    """
    if not dataclasses.is_dataclass(part):
        raise PartError("is not a component: put @wsnsim.part on the class")
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
    kind = get_args(hint)[0] if get_origin(hint) is Annotated else hint
    inner = _inner_in(hint)
    annotation: Any = annotation_of(kind, quantity) if inner is None else dict[str, Any]
    if inner is not None and inner.several:
        annotation = tuple[annotation, ...]
    return annotation, Field(description=" ".join(piece for piece in (about.words, unit) if piece) or None, **default)


PORT_MODULES: Final = (ports, radio, sleeping, synchronisation)


def demand_port(part: type[Any], role: str) -> None:
    """Raise PartError if a class lacks members that the port of its role requires."""
    port = _members(next(vars(module)[ROLES[role].port] for module in PORT_MODULES if ROLES[role].port in vars(module)))
    fields = {field.name for field in dataclasses.fields(part)}
    missing = [
        name
        for name, is_method in port.items()
        if not (callable(getattr(part, name, None)) if is_method else name in fields or hasattr(part, name))
    ]
    if missing:
        raise PartError(f"lacks {', '.join(repr(name) for name in missing)}, which every {role} needs")
    is_built_in = any(kind.path == f"{part.__module__}:{part.__qualname__}" for kind in ROLES[role].kinds)
    if "mechanism" in port and not is_built_in and not callable(getattr(part, "start", None)):
        _demand_mechanism(getattr(part, "mechanism", None), role)


def _members(port: type[Any]) -> dict[str, bool]:
    """Return the public members of a Protocol, and whether each is a method."""
    bases = [base for base in reversed(port.__mro__) if base not in (object, Protocol, Generic)]
    named = {name: callable(member) for base in bases for name, member in vars(base).items() if name[0] != "_"}
    return {name: False for base in bases for name in vars(base).get("__annotations__", {})} | named


def _demand_mechanism(mechanism: Any, role: str) -> None:
    """Raise PartError if a component names no built-in mechanism and so would need a `start` of its own."""
    known = sorted({load_class(kind).mechanism for kind in ROLES[role].kinds})
    if isinstance(mechanism, str) and mechanism not in known:
        hint = did_you_mean(mechanism, known)
        raise PartError(f"lacks 'start', which a {role} needs whose mechanism '{mechanism}' is not built in ({hint})")
