"""Values far beyond any network are refused as faults: none ends as an internal error, none is computed with."""

from __future__ import annotations

import math
from collections.abc import Iterator

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.helpers.scenario_components import base_scenario, faults_of
from tests.helpers.thorough import THOROUGH
from wsnsim.scenario.fields import fields_of, nested_of
from wsnsim.scenario.registry import ROLES, load_class


@pytest.mark.parametrize(
    ("override", "fault"),
    [
        ("sensor.reach=1e200", "sensor.reach: error: must be at most 1e+07, is 1e+200"),
        ("sensor.reach=1e-200", "sensor.reach: error: must be at least 0.001, is 1e-200"),
        ("sensor.reach=.inf", "sensor.reach: error: must be finite"),
        ("link.reach=.inf", "link.reach: error: must be finite"),
        ("link.reach=1e200", "link.reach: error: must be at most 1e+07, is 1e+200"),
        ("motion.start=[0,1e200,0,0]", "motion.start.1: must be at most 1e+07, is 1e+200"),
        ("deploy.nodes=1000000000", "deploy.nodes: error: must be at most 1e+07, is 1e+09"),
        ("deploy.width=1e200", "deploy.width: error: must be at most 1e+07, is 1e+200"),
        ("step=1e-300", "step: error: must be at least 1e-06, is 1e-300"),
        ("replicates=1000000000", "replicates: error: must be at most 100000, is 1e+09"),
        (
            "duration=4e7",
            "duration: error: 4e+07 s is 1e+09 steps of 0.04 s; 1 to 1e+07 are allowed",
        ),
        (
            "energy.battery=1 nJ",
            "energy.battery: error: 1e-09 J is too little for any head: a head must hold more than ",
        ),
    ],
)
def test_a_value_beyond_sense_is_a_fault_at_its_key(override: str, fault: str) -> None:
    found = [one for one in faults_of("pso_mhpf", override) if fault in one]
    assert found and all(len(one) < 250 for one in found)


def test_a_whole_number_that_no_float_holds_is_a_fault() -> None:
    (fault,) = faults_of(base_scenario(replicates=10**400))
    assert fault.startswith("replicates: error: must be at most 100000, is 1000") and len(fault) < 120


def test_the_smallest_reach_in_the_largest_field_is_a_short_fault() -> None:
    (fault,) = faults_of("pso_mhpf", "sensor.reach=1e-3", "deploy.width=1e7", "deploy.height=1e7")
    assert "at least 3.849e+19 are needed" in fault


CHOSEN = {"states": ("energy.radio=cc2420", "energy.processor=msp430f1611")}


def _numbers() -> Iterator[tuple[str, str, str]]:
    """(role, kind, field) of everything that a scenario can set, those of datasheets included."""
    for role in ROLES.values():
        for row in role.kinds if role.name != "tracker" else ():
            part = load_class(row)
            nested = nested_of(part)
            for name in fields_of(part):
                inner = [f"{name}.{field}" for field in fields_of(nested[name])] if name in nested else [name]
                yield from ((role.name, row.kind, path) for path in inner if path != "path")


def _written(value: float) -> str:
    return ".inf" if value == math.inf else "-.inf" if value == -math.inf else repr(value)


NUMBERS = list(_numbers())
EXTREMES = [1e300, 1e100, 5e-324, 1e-300, -1e300, math.inf]


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("role", "kind", "name"),
    [*NUMBERS[::5], *(pytest.param(*one, marks=pytest.mark.thorough) for i, one in enumerate(NUMBERS) if i % 5)],
)
@settings(max_examples=len(EXTREMES) if THOROUGH else 4)
@given(st.sampled_from(EXTREMES))
def test_no_number_of_a_model_ends_as_an_internal_error(role: str, kind: str, name: str, value: float) -> None:
    """With any one number of any kind at an extreme, a scenario is refused in words or is built."""
    if role == "fault":
        overrides = [f"faults=[{{kind: {kind}, at: 1, {name}: {_written(value)}}}]"]
        overrides = [override.replace("at: 1, at:", "at:") for override in overrides]
    else:
        given_kind = [f"{role}.kind={kind}"] if kind != "file" else []
        overrides = [*given_kind, *CHOSEN.get(kind, ()), f"{role}.{name}={_written(value)}"]
    for fault in faults_of("central_pf", *overrides):
        assert len(fault) < 400
