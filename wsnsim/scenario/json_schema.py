"""The JSON Schema of scenarios, for editors: every role as one of its kinds, installed plug-ins included.

    json_schema() -> dict

A file that `extends` another may leave out what the other says, so keys are demanded only of files that extend nothing.
"""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, Field, create_model

from wsnsim.scenario.build import plain_json
from wsnsim.scenario.catalog import ROLES, kinds
from wsnsim.scenario.fields import PartError
from wsnsim.scenario.schema import PartModel, Scenario, part_model

DIALECT = "https://json-schema.org/draft/2020-12/schema"
REF = "#/$defs/"


def json_schema() -> dict[str, Any]:
    """The schema, as plain JSON values. A plug-in that cannot be imported is left out."""
    alternatives = {role: _alternatives(role) for role in ROLES}
    fields: dict[str, Any] = {
        role: (_either(models), Field(description=ROLES[role].purpose)) for role, models in alternatives.items()
    }
    target: Any = _either(alternatives["motion"])
    fields["targets"] = (list[target], Field(description="how each target moves"))
    model: type[BaseModel] = create_model("Scenario", __base__=Scenario, **fields)
    schema = model.model_json_schema()
    strict = _demands(schema)
    for definition in schema["$defs"].values():
        definition.pop("required", None)
    schema["properties"]["extends"] = {
        "type": "string",
        "description": "the scenario, a file or shipped, that this changes",
    }
    whole = {"$schema": DIALECT, **schema, "if": {"required": ["extends"]}, "then": {}, "else": strict}
    return plain_json(whole)


def _alternatives(role: str) -> list[type[PartModel]]:
    models = []
    for kind in kinds(role):
        try:
            models.append(part_model(role, kind))
        except (ImportError, PartError):
            continue
    return models


def _either(models: list[type[PartModel]]) -> Any:
    """Any of these models, as an annotation."""
    result: Any = dict
    for i, model in enumerate(models):
        result = model if i == 0 else result | model
    return result


def _demands(schema: dict[str, Any]) -> dict[str, Any]:
    """What a file that extends nothing must say. Takes `required` from the top of the schema."""
    given = [name for name in schema.pop("required") if name not in ("motion", "targets")]
    top = [name for name in given if name not in ROLES or ROLES[name].default is None]
    roles = {name: _fields_demanded(schema, name) for name in ROLES}
    either = [{"required": ["motion"]}, {"required": ["targets"]}]
    of_network = [name for name in top if name in ROLES and (ROLES[name].of_network or ROLES[name].bench_default)]
    always = [name for name in top if name not in of_network]
    bench = {"required": ["network"], "properties": {"network": {"const": "none"}}}
    demanded = {"if": bench, "then": {}, "else": {"required": of_network}}
    kinds_of = {name: demand for name, demand in roles.items() if demand}
    return {"required": always, **demanded, "oneOf": either, "properties": kinds_of}


def _fields_demanded(schema: dict[str, Any], role: str) -> dict[str, Any]:
    place = schema["properties"][role]
    names = [choice["$ref"].removeprefix(REF) for choice in place.get("anyOf", [place]) if "$ref" in choice]
    definitions = [schema["$defs"][name] for name in names]
    each = [
        {"properties": {"kind": definition["properties"]["kind"]}, "required": definition.get("required", [])}
        for definition in definitions
    ]
    return {"anyOf": each} if each else {}
