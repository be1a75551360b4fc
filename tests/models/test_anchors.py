"""Nodes at named places: their order, the field about them, and what cannot be."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from wsnsim.base.ports import Field
from wsnsim.base.setups import NetworkSetup, TrackingSetup
from wsnsim.models.clusters import StrongestSignal
from wsnsim.models.deploy import Anchors
from wsnsim.models.ranging import Range
from wsnsim.scenario.fields import fields_of

LIU = tuple((x, 10.0) for x in (-1.0, 150.0, 300.0, 450.0, 600.0, 750.0, 900.0, 1000.0))
ROOM = ((0.0, 5.0), (5.0, 10.0), (10.0, 0.0))


def issues(part: Anchors, reach: float = 400.0, kind: type[TrackingSetup] = TrackingSetup) -> list[tuple[str, str]]:
    given: dict[str, Any] = dict.fromkeys(field.name for field in dataclasses.fields(kind))
    given |= {"sensor": Range(reach=reach)} | ({"clusters": StrongestSignal()} if kind is NetworkSetup else {})
    return [(".".join(map(str, issue.path)), issue.message) for issue in part.check(kind(**given))]


def test_nodes_stand_at_the_places_in_their_order_and_nothing_is_drawn() -> None:
    rng = np.random.default_rng(0)
    assert Anchors(places=LIU).draw(400.0, rng).tolist() == [list(place) for place in LIU]
    assert rng.random() == np.random.default_rng(0).random()
    assert Anchors().draw(400.0, rng).tolist() == [[0.0, 0.0]]


def test_the_field_is_what_the_places_span_and_at_least_a_metre() -> None:
    assert Anchors(places=ROOM).field == Field(10.0, 10.0, (5.0, 5.0))
    assert Anchors(places=LIU).field == Field(1001.0, 1.0, (499.5, 10.0))
    assert Anchors().field == Field(1.0, 1.0, (0.0, 0.0))
    for places in (ROOM, LIU):
        assert Anchors(places=places).field.contains(np.array(places)).all()


def test_what_is_said_of_the_field_goes_before_what_the_places_span() -> None:
    assert Anchors(places=LIU, height=40.0).field == Field(1001.0, 40.0, (499.5, 10.0))
    assert Anchors(places=ROOM, width=20.0, centre=(4.0, 6.0)).field == Field(20.0, 10.0, (4.0, 6.0))


def test_a_place_outside_the_field_is_a_fault_that_names_it() -> None:
    found = issues(Anchors(places=ROOM, centre=(4.0, 5.0)))
    assert found == [("deploy.places.2", "(10, 0) m is outside the field of 10 m by 10 m around (4, 5)")]


def test_anchors_must_cover_a_field_wherever_it_lies_if_asked() -> None:
    far = tuple((x + 1e4, y - 2e4) for x, y in ROOM)
    for places in (ROOM, far):
        assert issues(Anchors(places=places, cover=True), reach=7.0) == []
        [(path, message)] = issues(Anchors(places=places, cover=True), reach=5.5)
        assert path == "deploy.cover" and "of the field uncovered" in message
        assert issues(Anchors(places=places), reach=5.5) == []


def test_too_few_anchors_for_a_cluster_are_a_fault_in_a_network_only() -> None:
    assert [path for path, _ in issues(Anchors(), kind=NetworkSetup)] == ["deploy.places"]
    assert issues(Anchors()) == []
    assert issues(Anchors(places=ROOM), kind=NetworkSetup) == []


def test_a_list_without_places_is_refused() -> None:
    with pytest.raises(ValueError, match="at least one node"):
        Anchors(places=())


def test_a_scenario_can_write_places() -> None:
    annotation, _ = fields_of(Anchors)["places"]
    reader: TypeAdapter[Any] = TypeAdapter(annotation)
    assert reader.validate_python([["1 km", 2], [3, "4 m"]]) == ((1000.0, 2.0), (3.0, 4.0))
    for wrong in ([[1.0]], [1.0, 2.0], [[1.0, 1e9]], "none"):
        with pytest.raises(ValidationError):
            reader.validate_python(wrong)
