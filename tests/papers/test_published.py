import pytest

from wsnsim import scenario
from wsnsim.papers import published


def figures(name: str, *overrides: str) -> tuple[dict[str, float], str]:
    values, paper, reason = published(scenario.resolved(scenario.load(name, overrides)))
    assert bool(reason) == bool(paper) and len(f"  published: {reason}") <= 100
    return values, paper


def test_each_papers_figures_stand_beside_its_own_set_up():
    assert figures("pso_mhpf")[1] == "Jiang 2013"
    assert figures("ungm_ics_pf") == ({"rmse_x": 3.1075}, "Wei 2022")
    assert figures("ungm_pf", "tracker.particles=30") == ({"rmse_x": 6.0001}, "Wei 2022")
    assert figures("range_cs_pf")[0] == {"rmse_px": 1.1406, "rmse_vx": 0.0615, "rmse_py": 1.0103, "rmse_vy": 0.0608}
    assert figures("indoor_gsa_gpf", "tracker.particles=200") == ({"rmse": 0.3119}, "Ruan 2020")
    assert figures("indoor_gsa_gpf", "tracker.acceptance=greedy")[0] == {"rmse": 0.3599}


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("pso_mhpf", "network=none"),
        ("ungm_pf", "motion.q=10"),
        ("ungm_pf", "tracker.particles=50"),
        ("range_pf", "sensor.sd=2"),
        ("range_pf", "tracker.particles=100"),
        ("indoor_pf", "sensor.sd=1"),
        ("indoor_pf", "step=3.1"),
        ("indoor_surrogate", "seed=1"),
        ("ungm_grid", "seed=1"),
        ("ungm_pf", "deploy.places=[[0, 0], [1, 0], [2, 0]]"),
        ("ungm_pf", "prior.mean=[3]"),
        ("ungm_ics_pf", "tracker.filter_noise_scale=100"),
        ("range_pf", "tracker.filter_noise_scale=10"),
        ("indoor_gsa_gpf", "tracker.filter_noise_scale=100"),
        ("indoor_gsa_gpf", "deploy.places=[[0, 5], [5, 10]]"),
    ],
)
def test_another_set_up_has_no_published_figures(name, change):
    assert figures(name, change) == ({}, "")
