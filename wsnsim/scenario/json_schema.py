"""The JSON Schema of scenarios, for editors: every role as one of its kinds, installed plug-ins included.

    json_schema() -> dict

Keys are required only in files that extend no other file.
"""

from __future__ import annotations

from typing import Any, final

from pydantic import BaseModel, Field, create_model
from pydantic.json_schema import GenerateJsonSchema

from wsnsim.scenario.build import plain_json
from wsnsim.scenario.fields import PartError, PartModel, part_model
from wsnsim.scenario.registry import AT_TOP, ROLES, kinds
from wsnsim.scenario.schema import WITHOUT_TARGETS, Scenario

DIALECT = "https://json-schema.org/draft/2020-12/schema"
REF = "#/$defs/"


def json_schema() -> dict[str, Any]:
    """Return the schema as plain JSON values, without plug-ins that cannot be imported."""
    fields: dict[str, Any] = {}
    for role in ROLES.values():
        one: Any = _either(_alternatives(role.name))
        about = Field(description=role.purpose)
        fields |= {key: (list[one] if key == role.listed else one, about) for key in role.keys}
    model: type[BaseModel] = create_model("Scenario", __base__=Scenario, **fields)
    schema = model.model_json_schema(schema_generator=_Generator)
    strict = _demands(schema)
    for definition in schema["$defs"].values():
        definition.pop("required", None)
    schema["properties"]["extends"] = {
        "type": "string",
        "description": "the scenario (a file or a shipped name) that this one changes",
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


def _either(models: list[type[PartModel]]) -> Any:
    """Return the annotation of a value that follows any of these models."""
    result: Any = dict
    for i, model in enumerate(models):
        result = model if i == 0 else result | model
    return result


def _demands(schema: dict[str, Any]) -> dict[str, Any]:
    """Return what is required in a file that extends no other. Removes `required` from the top of the schema."""
    demanded = [key for key in schema.pop("required") if key not in AT_TOP]
    alone = [role for role in ROLES.values() if not role.listed]
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
