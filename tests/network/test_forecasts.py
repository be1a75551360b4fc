"""Two forecasts of one tracker: where nodes are woken, and where the next head is looked for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.helpers import sleeping_networks
from tests.helpers.centroid_network import Centroid, Run, network_setup, passing
from wsnsim.base.arrays import Estimate
from wsnsim.base.optional_ports import ForecastsSuccession
from wsnsim.base.part import part
from wsnsim.models.clusters import StrongestSignal
from wsnsim.models.links import MinimumHop
from wsnsim.trackers.mixture_pf import MixturePf

HERE = "tests.network.test_forecasts"


class Farsighted(Centroid):
    """A centroid tracker that looks for the next head 20 m ahead of what it predicts."""

    def __init__(self) -> None:
        super().__init__()
        self.sought: list[tuple[int, np.ndarray]] = []

    def forecast(self, belief, scene, ahead):
        raise AssertionError("nodes are not woken, and the next head has a forecast of its own")

    def successor_forecast(self, belief, scene, ahead):
        assert ahead == 1
        found = Centroid.forecast(self, belief, scene, ahead)
        mean = found.mean + np.array([20.0, 0.0, 0.0, 0.0])
        self.sought.append((scene.head, mean[[0, 2]]))
        return Estimate(mean, found.cov)


@pytest.mark.parametrize("rule", ["nearest", "elect"])
def test_the_next_head_of_a_standing_cluster_is_nearest_to_the_forecast_for_succession(rule) -> None:
    tracker, policy = Farsighted(), StrongestSignal(successor_rule=rule, handover_fraction=0.7)
    run = Run(
        network_setup(tracker=tracker, clusters=policy, routing=MinimumHop()),
        truths=[passing((-60.0, -60.0), (40.0, 40.0), 50)],
    )
    handed = run.events("handover") if rule == "nearest" else run.events("send", "wake")
    assert len(handed) >= 3
    for row, (head, point) in zip(handed, tracker.sought, strict=False):
        nearest = int(np.hypot(*(run.positions - point).T).argmin())
        assert (row["node"], row["peer"]) == (head, nearest)


FORECASTS: list[np.ndarray] = []
SOUGHT: list[tuple[int, int, np.ndarray]] = []


@part
class TwoForecasts(MixturePf):
    """A tracker of Li (2012) that looks for the next head 30 m north of where it has nodes woken."""

    def forecast(self, belief, scene, ahead):
        found = super().forecast(belief, scene, ahead)
        FORECASTS.append(found.mean)
        return found

    def successor_forecast(self, belief, scene, ahead):
        found = super().forecast(belief, scene, ahead)
        mean = found.mean.copy()
        mean[list(scene.motion.position)] += np.array([0.0, 30.0])
        SOUGHT.append((scene.step, scene.head, mean[list(scene.motion.position)]))
        return replace(found, mean=mean)


@pytest.mark.thorough
def test_a_moving_head_wakes_nodes_at_one_forecast_and_hands_over_at_the_other() -> None:
    FORECASTS.clear()
    SOUGHT.clear()
    said = sleeping_networks.scenario("cluster", duration=30.0) | {"tracker": {"kind": f"{HERE}:TwoForecasts"}}
    run = sleeping_networks.Run(said)
    nodes = run.table("nodes")
    places = np.stack([nodes["x"], nodes["y"]], axis=1)
    handed = {(row["step"], row["peer"]) for row in run.events("handover")}
    assert len(FORECASTS) >= 3 and len(SOUGHT) >= 3
    for step, head, point in SOUGHT:
        nearest = int(np.hypot(*(places - point).T).argmin())
        assert nearest == head or (step, nearest) in handed, "it gets the belief at once, unless it leads already"


def test_a_tracker_without_the_port_has_one_forecast_for_both() -> None:
    assert not isinstance(Centroid(), ForecastsSuccession)
    tracker = Centroid()
    assert network_setup(tracker=tracker).successor_forecast == tracker.forecast
    tracker = Farsighted()
    assert network_setup(tracker=tracker).successor_forecast == tracker.successor_forecast
