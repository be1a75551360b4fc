"""From the arguments of `simulate`, `run`, `sweep` and `compare` to the values that they change in a scenario.

changes_of({"tracker": "ekf", "link": {"reach": "60 m"}}) -> [("tracker.kind", "ekf"), ("link.reach", "60 m")]
"""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Final, TypeAlias, TypedDict

from wsnsim.api.argument_checks import overrides_given, tables_given
from wsnsim.base.errors import UsageError, did_you_mean
from wsnsim.base.tables import TABLES
from wsnsim.scenario.load import Override, Overrides
from wsnsim.scenario.registry import AT_TOP

Choice: TypeAlias = Any
"""A component (`PsoMhpf(particles=200)`), the name of a kind ('pso_mhpf'), or values to change ({'particles': 200})."""


class Changes(TypedDict, total=False):
    """The keyword arguments that change a scenario: one per key at its top.

    A component replaces the whole role. The name of a kind replaces the kind, with its default values, unless the
    scenario has that kind already. A mapping replaces the values that it names, as a scenario does that `extends`
    another one.
    """

    prior: Choice
    deploy: Choice
    motion: Choice
    targets: Choice
    sensor: Choice
    energy: Choice
    link: Choice
    mac: Choice
    packing: Choice
    routing: Choice
    sleep: Choice
    cpu: Choice
    clock: Choice
    sync: Choice
    detection: Choice
    sink: Choice
    workload: Choice
    faults: Choice
    wakeup: Choice
    clusters: Choice
    acquire: Choice
    tracker: Choice
    name: str
    step: float | str
    duration: float | str
    network: str
    lost: Mapping[str, Any]
    until: Mapping[str, Any]
    record: Mapping[str, bool]


KEYS: Final = frozenset(Changes.__annotations__)
"""The names of these arguments."""


def overrides_of(
    function: str, changes: Mapping[str, Any], overrides: Overrides | None, seed: int | None, keep: Iterable[str] | None
) -> tuple[Override, ...]:
    """Return everything that the arguments of a function change in a scenario, the most specific last.

    Raises:
        UsageError: there is no such argument, or no such table.
    """
    unknown = next((key for key in changes if key not in KEYS), None)
    if unknown is not None:
        known = {*KEYS, *_arguments_of(function)}
        raise UsageError(f"{function}() has no argument '{unknown}' ({did_you_mean(unknown, known)})")
    seeded: list[Override] = [] if seed is None else [("seed", seed)]
    return (*_changes_of(changes), *overrides_given(overrides), *seeded, *_kept(keep))


def _arguments_of(function: str) -> list[str]:
    """The arguments that a function of this package names itself, without those that change a scenario."""
    modules = map(importlib.import_module, ("wsnsim.api.running", "wsnsim.api.sweeping"))
    called = next(getattr(module, function) for module in modules if hasattr(module, function))
    parameters = inspect.signature(called).parameters.values()
    return [each.name for each in parameters if each.kind in (each.POSITIONAL_OR_KEYWORD, each.KEYWORD_ONLY)]


def _changes_of(changes: Mapping[str, Any]) -> Iterator[Override]:
    for key, value in changes.items():
        if value is None:
            continue
        if key in AT_TOP and isinstance(value, str):
            yield f"{key}.kind", value
        else:
            yield from _leaves(key, value)


def _leaves(key: str, value: Any) -> Iterator[Override]:
    if not isinstance(value, Mapping):
        yield key, value
        return
    for name, inner in value.items():
        yield from _leaves(f"{key}.{name}", inner)


def _kept(keep: Iterable[str] | None) -> Iterator[Override]:
    for table in tables_given(keep):
        if table not in TABLES:
            raise UsageError(f"keep: there is no table '{table}' ({did_you_mean(table, TABLES)})")
        yield f"record.{table}", True
