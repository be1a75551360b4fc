import pytest

from wsnsim import scenario
from wsnsim.papers import published, set_ups

SET_UP = {key: value for key, value in set_ups()[0].equal.items() if value is not None and key != "until"}


def figures(name: str, *overrides: str) -> dict[str, float]:
    return published(scenario.resolved(scenario.load(name, overrides)))[0]


def test_the_papers_figures_stand_beside_the_papers_set_up_whatever_the_variant_of_its_tracker():
    assert figures("pso_mhpf") == {"rmse": 2.5347, "energy": 1.82, "clusters": 16.0}
    assert figures("ipf") == {"rmse": 3.371, "energy": 2.33}
    assert figures("ppf", "tracker.filter_noise_scale=100")["rmse"] == 4.5519
    assert figures("pso_mhpf", "until.clusters=16")["clusters"] == 16
    assert figures("pso_mhpf", "tracker.measurements=all")["rmse"] == 2.5347


@pytest.mark.parametrize("noise", ["both", "q_only", "g_only"])
def test_either_reading_of_the_papers_process_noise_is_the_papers(noise):
    assert figures("ipf", f"motion.noise={noise}") == {"rmse": 3.371, "energy": 2.33}


@pytest.mark.parametrize(
    "change",
    [
        "link.loss=0.1",
        "mac.rate=250 kbit/s",
        "deploy.nodes=400",
        "duration=4 s",
        "until.clusters=3",
        "motion.start=[0, 0, 0, 0]",
        "motion.sigma0=2",
        "sensor.reach=50",
        "sensor.gain_spread=0",
        "sensor.noise=2",
        "sensor.intensity=2e4",
        "clusters.handover_fraction=0.5",
        "clusters.minimum_active=4",
        "energy.battery=0.1 J",
        "energy.voltage=3 V",
    ],
)
def test_they_do_not_stand_beside_anything_else(change):
    assert figures("pso_mhpf", change) == {}


def test_a_tracker_that_the_paper_does_not_have_has_no_figures():
    assert figures("central_pf") == {}


@pytest.mark.parametrize(
    "more",
    [
        {"cpu": {"kind": "processor", "rate": None, "cycles_per_flop": 10.0}},
        {"cpu": {"kind": "processor", "rate": 8e6, "cycles_per_flop": 1.0}},
        {"energy": {**SET_UP["energy"], "idle": 0.01}},
        {"clock": {"kind": "drift", "sd": 30e-6}},
        {"detection": {"kind": "imperfect", "missed": 0.1}},
        {"sink": {"kind": "node", "x": 0.0, "y": 0.0}},
        {"faults": [{"kind": "crash", "at": 1.0, "head": 0}]},
    ],
)
def test_nor_beside_a_world_in_which_more_happens_than_in_the_papers(more):
    old = {**SET_UP, "tracker": {"kind": "ipf", "particles": 400}, "step": 0.04, "duration": 28.04}
    nothing = {
        "cpu": {"kind": "processor", "rate": None, "cycles_per_flop": 1.0},
        "sink": {"kind": "none"},
        "faults": [],
    }
    assert published(old)[0] == published({**old, **nothing})[0] == {"rmse": 3.371, "energy": 2.33}
    assert published({**old, **more}) == ({}, "", "")
