"""The parameters of components, for readers and for editors, from the annotations of their classes.

parameters_of(Disk) -> ParameterInfo("reach", "number", "m", "0.001 to 1e7", "75", "R_c: communication range"), ...
json_schema() -> the JSON Schema of scenarios: every role as one of its kinds, installed plug-ins included

Keys are required by the schema only in files that extend no other file.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final, Literal, Union, final, get_args, get_origin, get_type_hints

from pydantic import BaseModel, Field, create_model
from pydantic.json_schema import GenerateJsonSchema

from wsnsim.base.part import Quantity
from wsnsim.scenario.build import plain_json
from wsnsim.scenario.fields import COMMON, PartError, PartModel, about, names_of, nested_of, part_model, roles_of
from wsnsim.scenario.messages import unwrapped
from wsnsim.scenario.registry import AT_TOP, ROLES, kinds
from wsnsim.scenario.schema import WITHOUT_TARGETS, Scenario

DIMENSIONLESS: Final = "dimensionless"


@dataclass(frozen=True)
class ParameterInfo:
    """One parameter of a kind.

    Attributes:
        name: its key in a scenario; with a dot if it belongs to a component within.
        type: what it takes: 'number', 'whole number', 'text', 'true or false', 'list of 4 numbers', ...
        unit: its SI unit, 'dimensionless', or '' if it is no number.
        allowed: its bounds or its values: '> 0', '0 to 1', 'own | all'; '' if there are none.
        default: the default as a scenario writes it; None if the parameter must be given.
        meaning: what it is.
    """

    name: str
    type: str
    unit: str
    allowed: str
    default: str | None
    meaning: str

    @property
    def takes(self) -> str:
        """What a scenario may write: 'number in m, > 0', 'own | all', 'true | false'."""
        if self.type == "true or false":
            return "true | false"
        if self.type == "text" and self.allowed:
            return self.allowed
        unit = f" ({self.unit})" if self.unit == DIMENSIONLESS else f" in {self.unit}" if self.unit else ""
        return f"{self.type}{unit}" + (f", {self.allowed}" if self.allowed else "")


def has_no_default(field: dataclasses.Field[Any]) -> bool:
    """Return whether a scenario must give the field."""
    return field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING


def common_parameters(role: str) -> list[ParameterInfo]:
    """Return the parameters that every kind of a role has: of trackers, what its filter assumes about the models."""
    return list(parameters_of(*COMMON[role])) if role in COMMON else []


def parameters_of(part: Any, prefix: str = "") -> Iterator[ParameterInfo]:
    """Yield the parameters of a component's class, those of the components within it with a prefix."""
    hints = get_type_hints(part, include_extras=True)
    nested, inner = nested_of(part), roles_of(part)
    fields = {field.name: field for field in dataclasses.fields(part)}
    for name in names_of(part):
        held, (quantity, (meaning, _)) = unwrapped(hints[name]), about(hints[name])
        default = _default(fields[name])
        if name in inner:
            kind = f"{'list of components' if inner[name].several else 'component'} of the role {inner[name].role}"
            default = default and f"{{kind: {ROLES[inner[name].role].default}}}"
            yield ParameterInfo(prefix + name, kind, "", "", default, meaning)
        elif name in nested and vars(nested[name]).get("sheet", "any"):
            yield ParameterInfo(prefix + name, "datasheet", "", "", default, meaning)
        elif name in nested:
            yield from parameters_of(nested[name], f"{prefix}{name}.")
        else:
            kind = type_in_words(held)
            unit = _unit(part, quantity, held) if "number" in kind else ""
            yield ParameterInfo(prefix + name, kind, unit, _allowed(held, quantity), default, meaning)


def _unit(part: Any, quantity: Quantity, kind: Any) -> str:
    """Return the unit of a number; those of the state's columns for a list with a number for each of them."""
    units = getattr(part, "units", ())
    if quantity.label == "SI" and get_origin(kind) is tuple and len(get_args(kind)) == len(units):
        return ", ".join(unit or "1" for unit in units)
    return quantity.unit or quantity.label or DIMENSIONLESS


def type_in_words(kind: Any) -> str:
    """Return the type of a field as documentation names it: 'whole number', 'list of 2 numbers'."""
    origin, arguments = get_origin(kind), get_args(kind)
    names = {float: "number", int: "whole number", bool: "true or false", str: "text"}
    if kind in names:
        return names[kind]
    if origin is Literal:
        return "text" if isinstance(arguments[0], str) else "whole number"
    if origin is tuple:
        count = "" if ... in arguments else f"{len(arguments)} "
        inner = dict.fromkeys(type_in_words(argument) for argument in arguments if argument is not ...)
        items = " or ".join(_plural(word) for word in inner)
        return f"list of {count}{items}" if count != "1 " else f"list of 1 {next(iter(inner))}"
    if arguments:
        return " or ".join(type_in_words(argument) for argument in arguments if argument is not type(None))
    return getattr(kind, "__name__", str(kind))


def _plural(word: str) -> str:
    if word.startswith("list"):
        return word.replace("list", "lists", 1)
    return f"{word}s" if word in ("number", "whole number", "text") else word


def _allowed(kind: Any, quantity: Quantity) -> str:
    if get_origin(kind) is Literal:
        return " | ".join(str(value) for value in get_args(kind))
    bounds = {name: getattr(quantity, name) for name in ("gt", "ge", "lt", "le")}
    given = {name: bound for name, bound in bounds.items() if bound is not None and math.isfinite(bound)}
    if set(given) == {"ge", "le"}:
        return f"{short_number(given['ge'])} to {short_number(given['le'])}"
    signs = {"gt": "> ", "ge": "≥ ", "lt": "< ", "le": "≤ "}
    return ", ".join(f"{signs[name]}{short_number(bound)}" for name, bound in given.items())


def short_number(value: float, digits: int = 6) -> str:
    """Return a number without needless characters: 1e7 for 10000000.0."""
    return re.sub(r"e\+?(-?)0*(?=\d)", r"e\1", f"{value:.{digits}g}")


def _default(field: dataclasses.Field[Any]) -> str | None:
    if has_no_default(field):
        return None
    return as_written(field.default if field.default_factory is dataclasses.MISSING else field.default_factory())


def as_written(value: Any) -> str:
    """Return a value as a scenario writes it; 'null' for None."""
    if value is None:
        return "null"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return short_number(value, 12) if math.isfinite(value) else f"{'-' * (value < 0)}.inf"
    if isinstance(value, tuple | list):
        return f"[{', '.join(as_written(item) for item in value)}]"
    if isinstance(value, str):
        return value or "''"
    return str(value)


DIALECT = "https://json-schema.org/draft/2020-12/schema"
REF = "#/$defs/"


def json_schema() -> dict[str, Any]:
    """Return the schema as plain JSON values, without plug-ins that cannot be imported."""
    fields: dict[str, Any] = {}
    for role in ROLES.values():
        models = _alternatives(role.name)
        one: Any = Union[tuple(models)] if models else dict  # noqa: UP007
        about = Field(description=role.purpose)
        fields |= {key: (list[one] if key == role.listed else one, about) for key in role.keys}
    model: type[BaseModel] = create_model("Scenario", __base__=Scenario, **fields)
    schema = model.model_json_schema(schema_generator=_Generator)
    strict = _demands(schema)
    for definition in schema["$defs"].values():
        definition.pop("required", None)
    schema["properties"]["extends"] = {
        "type": ["string", "array"],
        "items": {"type": "string"},
        "description": "the scenario (a file or a shipped name) that this one changes, or several; later ones count",
    }
    whole = {"$schema": DIALECT, **schema, "if": {"required": ["extends"]}, "then": {}, "else": strict}
    plain: dict[str, Any] = plain_json(whole)
    return plain


@final
class _Generator(GenerateJsonSchema):
    """Writes default values whose classes pydantic has not built yet; before 2.14 it cannot do so itself."""

    def encode_default(self, dft: Any) -> Any:
        if isinstance(dft, BaseModel):
            type(dft).model_rebuild(force=True)
        return super().encode_default(dft)


def _alternatives(role: str) -> list[type[PartModel]]:
    models = []
    for kind in kinds(role):
        try:
            models.append(part_model(role, kind))
        except (ImportError, PartError):
            continue
    return models


def _demands(schema: dict[str, Any]) -> dict[str, Any]:
    """Return what is required in a file that extends no other. Removes `required` from the top of the schema."""
    demanded = [key for key in schema.pop("required") if key not in AT_TOP]
    alone = [role for role in ROLES.values() if not role.listed and not role.inner]
    missing = [role for role in alone if role.default is None]
    of_targets = [role.name for role in missing if role.of_targets]
    of_network = [role.name for role in missing if role.of_network or role.offline_default]
    either = [{"required": [key]} for key in ROLES["motion"].keys]
    bench = {"required": ["network"], "properties": {"network": {"const": "none"}}}
    beacons = {"properties": {"kind": {"enum": [*WITHOUT_TARGETS]}}, "required": ["kind"]}
    without_target = {"required": ["workload"], "properties": {"workload": beacons}}
    kinds_of = {role.name: demand for role in alone if (demand := _fields_demanded(schema, role.name))}
    cases = [
        {"if": bench, "then": {}, "else": {"required": of_network}},
        {"if": without_target, "then": {}, "else": {"required": of_targets, "oneOf": either}},
    ]
    return {"required": demanded, "allOf": cases, "properties": kinds_of}


def _fields_demanded(schema: dict[str, Any], role: str) -> dict[str, Any]:
    place = schema["properties"][role]
    names = [choice["$ref"].removeprefix(REF) for choice in place.get("anyOf", [place]) if "$ref" in choice]
    definitions = [schema["$defs"][name] for name in names]
    each = [
        {"properties": {"kind": definition["properties"]["kind"]}, "required": definition.get("required", [])}
        for definition in definitions
    ]
    return {"anyOf": each} if each else {}
