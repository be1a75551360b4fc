"""The log-normal link that is fitted to recorded links: a known one is recovered, heard pairs alone would mislead."""

from __future__ import annotations

import dataclasses
import json
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

import wsnsim
from tests.models.test_recorded_links import second_half
from wsnsim.base.errors import RunError, UsageError
from wsnsim.fitting.link_sample import delivery
from wsnsim.models.links import LogNormal
from wsnsim.scenario.texts import shipped

GRENOBLE = next(iter(shipped().values())).parent / "recorded" / "links" / "grenoble_first_half.k7.gz"
TRUE = LogNormal(loss_at_1m=50.0, exponent=3.0, shadowing=5.0, asymmetry=2.0, sensitivity=-90.0)
NODES = 40
FRAME = 100


def write(folder: Path, seed: int) -> tuple[str, str]:
    """A K7 file of one round on one channel of the true link, and the places of its nodes."""
    rng = np.random.default_rng(seed)
    places = rng.uniform(0.0, 60.0, (NODES, 2)).round(2)
    first, second = np.triu_indices(NODES, 1)
    distances = np.maximum(np.hypot(*(places[first] - places[second]).T), 1.0)
    mean = TRUE.power - TRUE.loss_at_1m - 10 * TRUE.exponent * np.log10(distances)
    mean += rng.normal(0.0, TRUE.shadowing, len(mean))
    half = rng.normal(0.0, TRUE.asymmetry / 2, len(mean))
    header = {"tx_length": 100, "interframe_duration": 100, "node_count": NODES, "channels": [11]}
    rows = [json.dumps(header), "datetime,src,dst,channel,mean_rssi,pdr,tx_count"]
    begin = datetime(2020, 1, 1)
    powers = [(first, second, mean + half), (second, first, mean - half)]
    for burst in range(NODES):
        for sources, receivers, levels in powers:
            own = sources == burst
            delivered = rng.binomial(100, delivery(levels[own] - TRUE.sensitivity, FRAME))
            when = (begin + timedelta(seconds=20 * burst)).isoformat()
            rows += [
                f"{when},{burst},{receiver},11,{level:.2f},{count / 100},100"
                for receiver, level, count in zip(receivers[own], levels[own], delivered, strict=True)
                if count
            ]
    links, nodes = folder / "links.k7", folder / "places.csv"
    links.write_text("\n".join(rows) + "\n")
    nodes.write_text("\n".join(["id,x,y", *(f"{i},{x},{y}" for i, (x, y) in enumerate(places))]) + "\n")
    return str(links), str(nodes)


@pytest.mark.thorough
def test_a_known_link_is_recovered_within_its_intervals_for_most_seeds(tmp_path: Path) -> None:
    names = ("sensitivity", "asymmetry", "loss_at_1m", "exponent", "shadowing")
    hits = dict.fromkeys(names, 0)
    seeds = 4
    for seed in range(seeds):
        links, nodes = write(tmp_path, seed)
        values = wsnsim.fit(links, nodes, law="log_normal").values
        hits = {name: hits[name] + (values[name].low <= getattr(TRUE, name) <= values[name].high) for name in names}
        assert abs(values["sensitivity"].value - TRUE.sensitivity) < 0.1
    assert min(hits.values()) >= 3, hits
    assert sum(hits.values()) >= 0.75 * seeds * len(names), hits


@pytest.mark.thorough
def test_pairs_that_were_not_heard_count(tmp_path: Path) -> None:
    links, nodes = write(tmp_path, 1)
    found = wsnsim.fit(links, nodes, law="log_normal")
    heard = np.isfinite(found.rows.means)
    assert 0.2 < heard.mean() < 0.9
    naive = -np.polyfit(10 * np.log10(found.rows.distances[heard]), found.rows.means[heard], 1)[0]
    assert naive < TRUE.exponent - 0.4
    assert abs(found.values["exponent"].value - TRUE.exponent) < 0.4


def test_without_positions_no_path_loss_is_fitted(tmp_path: Path) -> None:
    links, _ = write(tmp_path, 2)
    found = wsnsim.fit(links, law="log_normal", power=-3.0)
    assert found.link.keys() == {"kind", "power", "sensitivity", "asymmetry", "fitted_on"}
    assert found.link["power"] == -3.0
    assert "Without positions" in found.text() and "defaults" in found.yaml()
    LogNormal(**{key: value for key, value in found.link.items() if key != "kind"})


def test_the_fitted_link_passes_beside_the_datasheet_of_a_radio_and_unknown_ratios_are_said(tmp_path: Path) -> None:
    links, _ = write(tmp_path, 2)
    found = wsnsim.fit(links, law="log_normal")
    assert found.link["sensitivity"] != -95.0
    wsnsim.build(
        wsnsim.load({"extends": "ekf_real", "energy": {"kind": "states", "radio": "cc2420"}, "link": found.link})
    )
    few = dataclasses.replace(found.rows, ratios=np.zeros_like(found.rows.ratios))
    said = dataclasses.replace(found, rows=few).text()
    assert "Recorded delivery ratio: below 0.1, or of too few bursts at each power." in said
    assert "holds beside the datasheet of a radio" in said


def test_links_are_not_judged_on_what_they_were_fitted_to(tmp_path: Path) -> None:
    links, nodes = write(tmp_path, 3)
    (tmp_path / "other").mkdir()
    other, _ = write(tmp_path / "other", 4)
    with pytest.raises(UsageError, match="must not be judged on what it was fitted to"):
        wsnsim.fit(links, nodes, law="log_normal", test=links)
    part = tmp_path / "part.k7"
    top, names, *rows = Path(links).read_text().splitlines()
    for some in (rows[:-1], rows[1:], rows[len(rows) // 2 :]):
        part.write_text("\n".join([top, names, *some]))
        for train, test in ((links, part), (part, links)):
            with pytest.raises(UsageError, match=rf"{test} and {train} share .* must not be judged"):
                wsnsim.fit(train, nodes, law="log_normal", test=test)
    (row,) = wsnsim.fit(links, nodes, law="log_normal", in_sample=True).test
    assert row.in_sample
    (row,) = wsnsim.fit(links, law="log_normal", test=other).test
    assert not row.in_sample
    assert row.ratio_rmse < 0.06


def test_the_shipped_links_give_a_sensitivity_an_asymmetry_and_a_figure(tmp_path: Path) -> None:
    found = wsnsim.fit(GRENOBLE, law="log_normal")
    assert -87.0 < found.values["sensitivity"].value < -85.0
    assert 0.6 < found.values["asymmetry"].value < 1.1
    powers, ratios = found.curve
    assert ratios[powers < -89.0].max() < 0.2 and ratios[powers > -60.0].min() > 0.98
    assert 0.85 < ratios[(powers > -84.0) & (powers < -80.0)].min() < 0.95  # lost to something other than noise
    assert found.plot(tmp_path / "links.png").stat().st_size > 10_000


@pytest.mark.thorough
def test_the_second_half_of_the_shipped_links_gives_the_sensitivity_of_the_whole(tmp_path: Path) -> None:
    whole = wsnsim.fit(GRENOBLE, law="log_normal").values
    later = wsnsim.fit(second_half(tmp_path), law="log_normal").values
    assert later["sensitivity"].value == pytest.approx(whole["sensitivity"].value, abs=0.5)
    assert later["asymmetry"].value == pytest.approx(whole["asymmetry"].value, abs=0.1)


def test_a_node_without_a_place_is_named(tmp_path: Path) -> None:
    links, nodes = write(tmp_path, 5)
    lines = Path(nodes).read_text().splitlines()
    Path(nodes).write_text("\n".join(lines[:-1]) + "\n")
    with pytest.raises(RunError, match="lacks the place of 1 nodes of the links, such as '39'"):
        wsnsim.fit(links, nodes, law="log_normal")
    with pytest.raises(UsageError, match="unknown option 'gains'"):
        wsnsim.fit(links, law="log_normal", gains=True)
