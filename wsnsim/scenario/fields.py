"""From the fields of a component to its pydantic model: types, units and bounds come from its annotations.

part_model(role, kind) -> the model of one kind
names_of, abouts_of, nested_of, roles_of(class) -> its fields, what they mean, the components that they hold

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
import types
import warnings
from collections.abc import Callable, Mapping
from typing import (
    Annotated,
    Any,
    ClassVar,
    Final,
    Generic,
    Literal,
    NamedTuple,
    Protocol,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, create_model, model_serializer, model_validator
from pydantic.types import Strict

from wsnsim.base import batteries, detections, mechanisms, medium_access, network_ports, ports, radio, sleeping
from wsnsim.base.errors import did_you_mean
from wsnsim.base.part import OfRole, Quantity, part
from wsnsim.scenario.registry import ROLES, find, load_class
from wsnsim.scenario.units import Named, Number, demand_items, refusal

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


def is_part(kind: Any) -> bool:
    """Return whether something is the class of a component."""
    return isinstance(kind, type) and dataclasses.is_dataclass(kind)


def names_of(part: type[Any]) -> list[str]:
    """Return the names of a component's fields."""
    return [field.name for field in dataclasses.fields(part) if field.init]


class About(NamedTuple):
    """The description of a field and its unit ('' for a pure number or a text), from its annotation."""

    words: str
    unit: str


def abouts_of(part: type[Any]) -> dict[str, About]:
    """Return the descriptions of a component's fields, by name."""
    hints = get_type_hints(part, include_extras=True)
    return {name: about(hints[name])[1] for name in names_of(part)}


def about(hint: Any) -> tuple[Quantity, About]:
    """Return the unit and bounds, and the description, that the annotation of a field gives."""
    notes = get_args(hint)[1:] if get_origin(hint) is Annotated else ()
    quantity = next((note for note in notes if isinstance(note, Quantity)), Quantity())
    return quantity, About(next((note for note in notes if isinstance(note, str)), ""), quantity.unit)


@functools.cache
def nested_of(part: Any) -> Mapping[str, Any]:
    """Return the fields of a component that hold, or may hold, another component, with its class."""
    found = {}
    for name, hint in get_type_hints(part).items():
        inner = next((kind for kind in (hint, *get_args(hint)) if is_part(kind)), None)
        if inner is not None and name in names_of(part):
            found[name] = inner
    return types.MappingProxyType(found)


class Inner(NamedTuple):
    """The role of the components that a field holds; `several`: a list of them."""

    role: str
    several: bool


def _roles_of(part: Any) -> Mapping[str, Inner]:
    hints = get_type_hints(part, include_extras=True)
    found = {name: inner_in(hints[name]) for name in names_of(part)}
    return types.MappingProxyType({name: inner for name, inner in found.items() if inner})


roles_of: Final[Callable[[Any], Mapping[str, Inner]]] = functools.cache(_roles_of)
"""Returns the fields of a component that hold a component, or a list of them, of any kind of a role."""


def inner_in(hint: Any) -> Inner | None:
    """Return the role that the annotation of a field names; None if it names none."""
    held, *notes = get_args(hint) if get_origin(hint) is Annotated else (hint,)
    role = next((note.role for note in notes if isinstance(note, OfRole)), "")
    return Inner(role, get_origin(held) is tuple) if role else None


def annotation_of(kind: Any, quantity: Quantity) -> Any:
    """Return the pydantic annotation of a field.

    Raises:
        PartError: a scenario cannot express values of this type.
    """
    origin, arguments = get_origin(kind), get_args(kind)
    if kind is float or kind is int:
        return Annotated[kind, Number(quantity, whole=kind is int)]
    if kind is str or kind is bool:
        return Annotated[kind, Strict()]
    if origin is Literal or kind is type(None):
        return kind
    if origin is tuple:
        inner = tuple(argument if argument is ... else annotation_of(argument, quantity) for argument in arguments)
        items = functools.partial(demand_items, None if ... in arguments else len(arguments))
        return Annotated[tuple[inner], BeforeValidator(items)]  # type: ignore[valid-type]
    if origin in (Union, types.UnionType):
        return Union[tuple(annotation_of(argument, quantity) for argument in arguments)]  # noqa: UP007
    if is_part(kind):
        return Annotated[nested_model(kind), Named()] if getattr(kind, "sheet", "any") else nested_model(kind)
    raise PartError(
        f"has a field of type {kind}, which no scenario can write: use float, int, bool, str, Literal, tuple or a @part"
    )


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
    quantity, words = about(hint)
    unit = f"[{words.unit}]" if words.unit else ""
    default: dict[str, Any] = {}
    if field.default is not dataclasses.MISSING:
        written = field.default
        default = {"default": dataclasses.asdict(written) if is_part(type(written)) else written}
    elif field.default_factory is not dataclasses.MISSING:
        default = {"default_factory": field.default_factory}
    kind = get_args(hint)[0] if get_origin(hint) is Annotated else hint
    inner = inner_in(hint)
    annotation: Any = annotation_of(kind, quantity) if inner is None else dict[str, Any]
    if inner is not None and inner.several:
        annotation = tuple[annotation, ...]
    return annotation, Field(description=" ".join(piece for piece in (words.words, unit) if piece) or None, **default)


PORT_MODULES: Final = (ports, network_ports, radio, medium_access, sleeping, mechanisms, batteries, detections)


def demand_port(part: type[Any], role: str) -> None:
    """Raise PartError if a class lacks members that the port of its role requires."""
    name = (ports.port_of(part) if role == "tracker" else "") or ROLES[role].port
    port = _members(next(vars(module)[name] for module in PORT_MODULES if name in vars(module)))
    fields = {field.name for field in dataclasses.fields(part)}
    missing = [
        member
        for member, is_method in port.items()
        if not (callable(getattr(part, member, None)) if is_method else member in fields or hasattr(part, member))
    ]
    if missing:
        raise PartError(f"lacks {', '.join(map(repr, missing))}, which every {role} needs")
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


SHORT_FORMS: Final = {"gains": "gains", "inflate": "inflate", "filter_noise_scale": "noise_scale"}
_Flag = Annotated[bool, Strict()]
_Scale = Annotated[float, Number(Quantity("", ge=1e-9, le=1e9))]


@part
class Assumes:
    """What the filter assumes about the models of the ground truth."""

    gains: Annotated[
        Literal["known", "unknown", "estimated"],
        "whether the filter knows each sensor's gain, ignores it or estimates it beside the state",
    ] = "known"
    inflate: Annotated[bool, "widen the reading's variance for unknown gains and shadowing"] = False
    noise_scale: Annotated[float, Quantity("", ge=1e-9, le=1e9), "factor on the filter's process covariance"] = 1.0


class TrackerModel(PartModel):
    """The model of a tracker, with the assumptions of its filter; short forms are merged into `assumes`."""

    assumes: nested_model(Assumes) = Field(  # type: ignore[valid-type]
        nested_model(Assumes).model_construct(),
        description="what the filter assumes about the models of the ground truth",
    )
    gains: Literal["known", "unknown", "estimated"] | None = Field(
        None, exclude=True, description="short for assumes.gains"
    )
    inflate: _Flag | None = Field(None, exclude=True, description="short for assumes.inflate")
    filter_noise_scale: _Scale | None = Field(None, exclude=True, description="short for assumes.noise_scale")

    @model_validator(mode="after")
    def _fold(self) -> TrackerModel:
        own = names_of(self.part)
        short = {name: value for name in SHORT_FORMS if name not in own and (value := getattr(self, name)) is not None}
        if not short:
            return self
        twice = [name for name in short if SHORT_FORMS[name] in self.assumes.model_fields_set]
        if twice:
            raise refusal(f"'{twice[0]}' and 'assumes.{SHORT_FORMS[twice[0]]}' are the same: give one of them")
        folded = self.assumes.model_copy(update={SHORT_FORMS[name]: value for name, value in short.items()})
        return self.model_copy(update={"assumes": folded, **dict.fromkeys(short)})


@part
class Presence:
    """What every motion of a target has, beside its own fields."""

    presence: Annotated[
        tuple[tuple[float, float], ...] | None,
        Quantity("s", ge=0.0),
        "intervals [begin, end] in which the target is present, both ends within; none in []; left out: always",
    ] = None


COMMON: Final = {"tracker": (Assumes, "assumes."), "motion": (Presence, "")}
"""What the kinds of a role have beside their own fields, and the prefix of its keys."""


class MotionPartModel(PartModel):
    """The model of a motion, with the fields of `Presence`."""

    @model_serializer(mode="wrap")
    def _without_default(self, handler: Callable[[Any], dict[str, Any]]) -> dict[str, Any]:
        """Leave out a presence that nobody gave."""
        return {name: value for name, value in handler(self).items() if name != "presence" or value is not None}


@functools.cache
def part_model(role: str, kind: str) -> type[PartModel]:
    """Return the model of one kind.

    Raises:
        LookupError: there is no such kind.
        ImportError: its module cannot be imported.
        PartError: its class is not a valid component of the role.
    """
    info = find(role, kind)
    part = load_class(info)
    try:
        fields = fields_of(part)
        demand_port(part, role)
        if {"kind", "assumes", "presence", "part"} & set(fields):
            raise PartError("has a field named 'kind', 'assumes', 'presence' or 'part', which are reserved")
        choice: Any = (Literal[kind], kind) if kind == ROLES[role].default else (Literal[kind], ...)
        bases: dict[str, type[PartModel]] = {"tracker": TrackerModel, "motion": MotionPartModel}
        common = fields_of(Presence) if role == "motion" else {}
        return made_model(part, bases.get(role, PartModel), {"kind": choice, **fields, **common})
    except PartError as error:
        raise PartError(f"{info.path} {error}") from None
