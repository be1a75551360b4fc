"""The workload in which every node reports to a sink, its table, and tracks whose estimates go to several sinks."""

import numpy as np
import pytest

import wsnsim
from wsnsim.analysis import summary, summary_text
from wsnsim.base.errors import ScenarioError
from wsnsim.base.tables import KIND, RECORDED_BY_DEFAULT, Memory
from wsnsim.experiment import replicate_of
from wsnsim.scenario import build, load

SMALL = (
    "duration=30 s", "deploy={kind: grid, nodes: 16, width: 120 m, height: 120 m, cover: false}",
    "link={kind: disk, reach: 45 m}", "energy={kind: first_order, battery: 2 J}",
    "workload={kind: collection, points: [[-60, -60]], period: 5 s, start_at: 5 s}",
)  # fmt: skip


def tables(*changes):
    """The tables `reports` and `events` of the small network, and the words of events."""
    memory = Memory({**RECORDED_BY_DEFAULT, "reports": True})
    replicate_of(build(load("collection", [*SMALL, *changes])), 0, memory)
    return memory.table("reports"), memory.table("events"), memory.words.all()


@pytest.mark.thorough
@pytest.mark.parametrize("kind", ["ctp", "minimum_hop", "greedy_geographic"])
def test_every_node_but_the_sink_reports_once_per_period(kind):
    reports, events, _ = tables(f"routing.kind={kind}", "mac.max_retries=7")
    assert np.bincount(reports["node"].astype(int), minlength=16).tolist() == [0] + [5] * 15
    assert np.isfinite(reports["received"]).all() and (reports["sink"] == 0).all() and (reports["target"] == -1).all()
    assert (reports["time"] >= 5.0).all() and (reports["received"] > reports["time"]).all()
    arrived = events["kind"] == KIND["report"]
    assert arrived.sum() == 75 and (events["node"][arrived] == 0).all()
    assert sorted(reports["received"]) == pytest.approx(sorted(events["time"][arrived]), abs=2e-3)


def test_the_bits_of_reports_are_those_of_their_frames():
    reports, events, words = tables("routing.kind=ctp")
    sent = np.isin(events["kind"], [KIND["send"], KIND["relay"]]) & (events["what"] == words.index("report"))
    assert reports["bits"].sum() == events["bits"][sent].sum() and (reports["hops"] >= 1).all()


def test_a_report_that_reaches_no_sink_is_dropped_with_a_reason_and_the_summary_says_so(tmp_path):
    places = "deploy={kind: anchors, places: [[-60, -60], [-30, -60], [60, 60]], width: 130 m, height: 130 m}"
    changes = [*SMALL, places, "routing={kind: ctp, patience: 1 s}"]
    report = wsnsim.experiment.run(load("collection", changes), out=tmp_path / "c.h5")
    found = summary.as_json(report)
    assert found["received_share"] == 0.5 and found["dropped"] == {"no_route": 5.0} and found["sinks"] == {"0": 5.0}
    said = summary_text.text(report)
    assert "reports received at a sink" in said and "dropped: no route was found in time" in said


@pytest.mark.thorough
def test_reports_of_beacons_are_none(tmp_path):
    report = wsnsim.experiment.run(load("beacons", ["duration=1 s", "deploy.nodes=20"]), out=tmp_path / "b.h5")
    assert summary.as_json(report)["reports"] == 0.0 and "reports sent" not in summary_text.text(report)


@pytest.mark.thorough
def test_several_sinks_share_the_reports_and_the_summary_counts_them(tmp_path):
    changes = [*SMALL, "workload.points=[[-60, -60], [60, 60]]", "routing.kind=ctp"]
    found = summary.as_json(wsnsim.experiment.run(load("collection", changes), out=tmp_path / "c.h5"))
    assert sorted(found["sinks"]) == ["0", "15"] and sum(found["sinks"].values()) == found["reports"] == 70


@pytest.mark.parametrize("kind", [pytest.param("ctp", marks=pytest.mark.thorough), "minimum_hop"])
def test_estimates_go_to_one_of_several_sinks_and_the_table_says_which(kind):
    changes = ["duration=1 s", "sink={kind: nodes, points: [[-90, -90], [90, 90]]}", f"routing.kind={kind}"]
    memory = Memory({**RECORDED_BY_DEFAULT, "reports": True})
    replicate_of(build(load("ekf_real", changes)), 0, memory)
    reports, estimates, events = (memory.table(name) for name in ("reports", "estimates", "events"))
    arrived = np.isfinite(reports["received"])
    assert arrived.sum() == np.isfinite(estimates["received"]).sum() > 5
    assert (reports["target"] == 0).all() and len(set(reports["sink"][arrived].tolist())) <= 2
    logged = events["node"][(events["kind"] == KIND["report"]) & (events["peer"] >= 0)]
    assert sorted(logged) == sorted(reports["sink"][arrived])


@pytest.mark.parametrize(("points", "says"), [
    ("[[-60, -60], [900, 900]]", r"no route reaches the sink, node 2 at \(900, 900\) m: the nearest other node is"),
    ("[]", "points must list at least one sink"),
])  # fmt: skip
def test_a_sink_that_no_route_reaches_is_refused_with_one_message(points, says):
    places = "deploy={kind: anchors, places: [[-60, -60], [-30, -60], [900, 900]], width: 2 km, height: 2 km}"
    with pytest.raises(ScenarioError, match=says) as raised:
        build(load("collection", [*SMALL, places, f"workload.points={points}"]))
    assert len(raised.value.issues) == 1


@pytest.mark.parametrize("link", ["{kind: disk, reach: 50 m, loss: 0.1}", "{kind: log_normal}"])
def test_a_sink_that_no_link_can_reach_is_refused_on_lossy_and_shadowed_links_too(link):
    places = "deploy={kind: anchors, places: [[-60, -60], [-30, -60], [90000, 900]], width: 200 km, height: 2 km}"
    with pytest.raises(ScenarioError, match=r"no route reaches the sink, node 2 at \(90000, 900\) m") as raised:
        build(load("collection", [*SMALL, places, f"link={link}", "workload.points=[[90000, 900]]"]))
    assert len(raised.value.issues) == 1


def test_acknowledgements_are_needed():
    with pytest.raises(ScenarioError, match="ctp learns of its links from acknowledgements"):
        build(load("collection", [*SMALL, "mac.acks=false", "routing.kind=ctp"]))
