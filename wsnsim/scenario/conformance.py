"""Conformance of a class to the port of its role, by the names of its members.

A plug-in that lacks a member is refused by `check`, with the place of its kind, instead of failing during a run.
"""

from __future__ import annotations

import dataclasses
from typing import Any, Final, Generic, Protocol

from wsnsim.base import ports, radio, sleeping, synchronisation
from wsnsim.base.errors import did_you_mean
from wsnsim.scenario.fields import PartError
from wsnsim.scenario.registry import ROLES, load_class

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
    if "mechanism" in port and not callable(getattr(part, "start", None)):
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
