"""The Fisher information of readings that have not been taken, as cluster policies and trackers ask for it."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from wsnsim.base.expected_readings import informations
from wsnsim.models.ranging import Range
from wsnsim.models.sensing import AcousticEnergy

PLACES = np.array([[0.0, 3.0], [20.0, -5.0], [-7.0, 11.0]])
POINTS = np.array([[4.0, 5.0], [-2.0, 9.0]])


def test_a_variance_that_does_not_depend_on_the_position_tells_nothing_whoever_says_so():
    sensor = Range(sd=2.0)
    said = informations(sensor, POINTS, PLACES, np.empty((3, 0)))
    unsaid = informations(SimpleNamespace(linearise=sensor.linearise), POINTS, PLACES, np.empty((3, 0)))
    assert said.shape == (3, 2, 2, 2)
    assert unsaid == pytest.approx(said, rel=1e-12)


def test_a_variance_that_depends_on_the_position_tells_more():
    sensor, traits = AcousticEnergy(), np.ones((3, 1))
    said = informations(sensor, POINTS, PLACES, traits)
    unsaid = informations(SimpleNamespace(linearise=sensor.linearise), POINTS, PLACES, traits)
    assert (np.trace(said, axis1=1, axis2=2) > np.trace(unsaid, axis1=1, axis2=2)).all()


def test_components_of_a_reading_add_up():
    def linearise(points, positions, traits):
        slopes = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 1.0], [2.0, 0.0]])[:, :, None]
        return np.zeros((4, 1)), slopes, np.array([[1.0], [2.0], [4.0], [1.0]])

    told = informations(SimpleNamespace(linearise=linearise), POINTS[:, :1], PLACES[:2], np.empty((2, 0)))
    assert told[..., 0].tolist() == [[[1.0, 0.0], [0.0, 0.5]], [[4.25, 0.25], [0.25, 0.25]]]
