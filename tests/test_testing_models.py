"""`check_motion` and `check_sensor`: every kind keeps the rules, and what breaks one is found."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wsnsim.models.bearing import Bearing
from wsnsim.models.mobility import GaussMarkov
from wsnsim.models.ranging import Range
from wsnsim.models.recorded_track import RecordedTrack
from wsnsim.models.waypoints import Waypoints
from wsnsim.scenario import build, load
from wsnsim.scenario.kind_info import TRACK
from wsnsim.scenario.registry import ROLES, load_class
from wsnsim.testing import check_motion, check_sensor

MOTIONS = [row for row in ROLES["motion"].kinds if row.kind not in ("waypoints", "recorded_track", "visits")]
SENSORS = [row for row in ROLES["sensor"].kinds if row.kind not in ("recorded", "quantised")]


@pytest.mark.parametrize("row", MOTIONS, ids=lambda row: row.kind)
def test_every_motion_model_keeps_the_rules(row: Any) -> None:
    check_motion(load_class(row)())


def test_motion_models_with_a_given_trajectory_keep_the_rules(tmp_path: Path) -> None:
    check_motion(Waypoints(points=((0.0, -50.0, 0.0), (10.0, 50.0, 0.0), (20.0, 50.0, 80.0))))
    (tmp_path / "track.csv").write_text(TRACK)
    check_motion(RecordedTrack(path=str(tmp_path / "track.csv")))


@pytest.mark.parametrize("row", SENSORS, ids=lambda row: row.kind)
def test_every_sensor_model_keeps_the_rules(row: Any) -> None:
    check_sensor(load_class(row)(), columns=1 if row.kind == "squared" else 2)


@pytest.mark.parametrize("row", SENSORS, ids=lambda row: row.kind)
def test_every_sensor_model_is_built_checked_and_joined_with_the_names_of_nodes(row: Any) -> None:
    kind, state = {"squared": ("ungm", [1.0])}.get(row.kind, ("constant_velocity", [9.0, 1.0, 9.0, 1.0]))
    needs = {"deploy": {"kind": "anchors", "places": [[0, 0], [20, 0], [0, 20]]}} if state[1:] else {}
    scenario = {"name": "x", "network": "none", "duration": 3, "sensor": {"kind": row.kind}, "motion": {"kind": kind}}
    setup = build(load(scenario | needs | {"tracker": {"kind": "central_pf"}, "prior": {"sd": state}}))
    assert getattr(setup.sensor, "with_nodes", lambda names: setup.sensor)("abc") == setup.sensor


def cheat(model: type, name: str, altered: Callable[..., Any]) -> Any:
    """A model in which one method is altered; it gets the right result and the arguments."""

    def method(self: Any, *arguments: Any) -> Any:
        return altered(getattr(model, name)(self, *arguments), *arguments)

    return type("Cheat", (model,), {name: method})()


def by_place(result: Any, states: Any, *_: Any) -> Any:
    return result + np.arange(states.shape[1])


def in_place(result: Any, states: Any, *_: Any) -> Any:
    states += 1.0
    return result


@pytest.mark.parametrize(
    ("name", "altered", "rule"),
    [
        ("truth", lambda result, *_: result[1:], "truth"),
        ("truth", lambda result, *_: result + np.random.default_rng().normal(), "truth"),
        ("advance", lambda result, *_: result.T, "shapes"),
        ("advance", in_place, "shapes"),
        ("propagate", by_place, "keys"),
        ("matrices", lambda result, *_: (result[0] * 1.1, result[1]), "linearisation"),
        ("matrices", lambda result, *_: (result[0], -result[1]), "linearisation"),
        ("matrices", lambda result, *_: (result[0], 4.0 * result[1]), "noise"),
        ("propagate", lambda result, *_: result + 1.0, "noise"),
        ("log_transition", lambda result, *_: -result, "density"),
        ("assumed", lambda result, *_: GaussMarkov(), "assumed"),
    ],
)
def test_a_motion_model_that_breaks_a_rule_is_found(name: str, altered: Callable[..., Any], rule: str) -> None:
    with pytest.raises(AssertionError, match=f"demand '{rule}'"):
        check_motion(cheat(GaussMarkov, name, altered))


@pytest.mark.parametrize(
    ("model", "name", "altered", "rule"),
    [
        (Range, "draw_traits", lambda result, *_: result[1:], "traits"),
        (Range, "measure", lambda result, *_: result[:, None], "measure"),
        (Range, "measure", lambda result, *_: np.floor(result) * 0.0, "measure"),
        (Range, "measure", lambda result, *_: result + 0.5, "linearisation"),
        (Bearing, "linearise", lambda result, *_: (result[0], -result[1], result[2]), "linearisation"),
        (Range, "linearise", lambda result, *_: (result[0], result[1], -result[2]), "linearisation"),
        (Range, "log_likelihood", lambda result, *_: result + 1.0, "likelihood"),
        (Bearing, "log_likelihood", lambda result, *_: np.nan_to_num(result), "likelihood"),
        (Bearing, "log_likelihood", lambda result, *_: -np.where(np.isfinite(result), result, np.inf), "truth"),
        (
            Bearing,
            "log_likelihood",
            lambda result, _, readings, *__: result - (np.max(np.abs(readings)) > 3.5),
            "likelihood",
        ),
        (Bearing, "detects", lambda result, *_: result.T, "detects"),
        (Range, "assumed", lambda result, *_: None, "assumed"),
    ],
)
def test_a_sensor_model_that_breaks_a_rule_is_found(
    model: type, name: str, altered: Callable[..., Any], rule: str
) -> None:
    with pytest.raises(AssertionError, match=f"demand '{rule}'"):
        check_sensor(cheat(model, name, altered))


@pytest.mark.parametrize("unit", [1.0, 180.0 / np.pi], ids=["rad", "degrees"])
def test_a_bearing_that_says_no_period_is_found(unit: float) -> None:
    class WithoutPeriod(Bearing):
        periods = (0.0,)

        def measure(self, *arguments: Any) -> Any:
            return unit * super().measure(*arguments)

        def linearise(self, *arguments: Any) -> Any:
            expected, gradients, variances = super().linearise(*arguments)
            return unit * expected, unit * gradients, unit**2 * variances

    with pytest.raises(AssertionError, match=r"demand 'angles': the component 'bearing' .* jump by .* `periods`"):
        check_sensor(WithoutPeriod())
