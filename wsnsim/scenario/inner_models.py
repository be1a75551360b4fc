"""The pydantic models of components that hold other components.

with_inner(model, {field: kinds}) -> the model with fields of these kinds      inner_models(model) -> {path: model}
"""

from __future__ import annotations

import functools
from typing import Any, get_args

from pydantic import Field, create_model

from wsnsim.scenario.fields import PartModel, roles_of
from wsnsim.scenario.located_values import Keys

InnerKinds = type[PartModel] | None | tuple[type[PartModel] | None, ...]
"""The model of the component that a field holds, or those of a list; None for one whose kind has an issue."""


@functools.cache
def with_inner(model: type[PartModel], inner: tuple[tuple[str, InnerKinds], ...]) -> type[PartModel]:
    """Return the model of a kind whose fields hold components of these kinds."""
    fields: dict[str, Any] = {
        name: (_annotation_of_kinds(chosen), Field(description=model.model_fields[name].description))
        for name, chosen in inner
        if chosen != ()  # an empty list is of the same model as none
    }
    return create_model(model.__name__, __base__=model, __module__=model.__module__, **fields) if fields else model


def _annotation_of_kinds(chosen: InnerKinds) -> Any:
    if isinstance(chosen, tuple):
        return tuple[tuple(kind or Any for kind in chosen)]  # type: ignore[misc]
    return chosen or Any


def inner_models(model: type[PartModel]) -> dict[Keys, type[PartModel]]:
    """Return the models of the components that a component holds, by their paths in it, where the kinds are known."""
    found: dict[Keys, Any] = {}
    for name, inner in roles_of(model.part).items():
        held = model.model_fields[name].annotation
        if inner.several:
            found.update(((name, i), kind) for i, kind in enumerate(get_args(held)))
        else:
            found[name,] = held
    return {path: kind for path, kind in found.items() if isinstance(kind, type) and issubclass(kind, PartModel)}
