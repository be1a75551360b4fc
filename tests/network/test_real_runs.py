"""Whole scenarios on a lossy radio: the ledger closes, runs repeat, computing takes time, the sink gets reports."""

import concurrent.futures
import itertools
import multiprocessing

import numpy as np
import pytest

from tests.helpers.thorough import thorough
from wsnsim import scenario
from wsnsim.base.tables import CAUSES, EVENT_CAUSES, KIND, Memory
from wsnsim.experiment import simulate_run
from wsnsim.network.radio import radio_stack

SHORT = ["duration=2 s"]
FAULTY = [
    *SHORT,
    "sink.kind=node",
    "faults=[{kind: crash, at: 0.5 s, head: 0, duration: 0.4 s},"
    " {kind: blackout, at: 1 s, region: [0, 0, 80], duration: 0.2 s},"
    " {kind: link_loss, at: 0.2 s, fraction: 0.3, loss: 0.5}, {kind: drain, at: 1.2 s, fraction: 0.1, share: 1.0}]",
]


def simulated(name, *overrides, wanted=None):
    memory = Memory(wanted)
    summary = simulate_run(scenario.load(name, overrides), recorder=memory)
    return summary, memory


def fingerprint(name, overrides):
    return int(simulate_run(scenario.load(name, overrides)).run["fingerprint"])


FEW = [("csma", "states")]
EVERY = list(itertools.product(("ideal", "csma", "tdma"), ("first_order", "first_order_2002", "states")))


@pytest.mark.parametrize(
    ("mac", "energy"),
    [*FEW, *(pytest.param(*pair, marks=pytest.mark.thorough) for pair in EVERY if pair not in FEW)],
)
def test_the_ledger_closes_and_equals_the_events_for_every_mac_and_energy_model(mac, energy):
    changes = [*FAULTY, f"mac.kind={mac}", "packing.kind=none"]
    if energy != "states":
        changes += [f"energy.kind={energy}", "energy.battery=0.05 J", "energy.idle=1 mW", "energy.sleep=0.1 mW"]
    if mac == "ideal":
        changes.append("mac.rate=250 kbit/s")
    run, memory = simulated("ekf_real", *[change for change in changes if change != "energy.kind=states"])
    ledger, nodes, events = memory.table("energy"), memory.table("nodes"), memory.table("events")
    spent = np.zeros(len(nodes["node"]))
    np.add.at(spent, ledger["node"].astype(int), ledger["joules"])
    left = nodes["energy_initial"] - nodes["energy_left"]
    assert np.allclose(spent, left, rtol=1e-9, atol=1e-12 * nodes["energy_initial"].max())
    assert run.run["energy"] == pytest.approx(spent.sum(), rel=1e-9)
    by_step = memory.table("energy_steps")
    assert by_step["joules"].sum() == pytest.approx(spent.sum(), rel=1e-6)
    booked = {cause: ledger["joules"][ledger["cause"] == i].sum() for i, cause in enumerate(CAUSES)}
    booked["tx"] = booked["tx_electronics"] + booked["tx_amplifier"]
    for cause in ("tx", "rx", "overhear", "cpu"):
        logged = events["joules"][events["cause"] == EVENT_CAUSES.index(cause)].sum()
        assert logged == pytest.approx(booked[cause], rel=1e-9, abs=1e-15), cause
    assert {"crash", "restart", "fault"} <= {kind for kind in KIND if (events["kind"] == KIND[kind]).any()}


@pytest.mark.thorough
def test_the_fingerprint_depends_neither_on_the_log_nor_on_workers_nor_on_reading_energy(monkeypatch):
    name, changes = "pso_mhpf_packed", [*FAULTY, "duration=1.24 s"]
    plain = fingerprint(name, changes)
    assert int(simulated(name, *changes, wanted={})[0].run["fingerprint"]) == plain
    assert int(simulated(name, *changes, wanted={"events": True, "links": True})[0].run["fingerprint"]) == plain
    context = multiprocessing.get_context("spawn")
    with concurrent.futures.ProcessPoolExecutor(1, mp_context=context) as pool:
        assert pool.submit(fingerprint, name, changes).result() == plain
    made = radio_stack.make_nodes
    looked = []

    def curious(env, *rest):
        nodes = made(env, *rest)

        def look():
            while True:
                yield env.timeout(0.0173)
                looked.append(
                    (nodes.residual_energies().sum(), nodes.totals_now(), [nodes.residual_energy(i) for i in range(20)])
                )

        env.process(look())
        return nodes

    monkeypatch.setattr(radio_stack, "make_nodes", curious)
    assert fingerprint(name, changes) == plain and len(looked) > 50


@pytest.mark.thorough
@pytest.mark.parametrize(
    "name", ["pso_mhpf_real", *thorough(["ipf_real"]), "ppf_real", "central_pf_real", "pso_mhpf_packed"]
)
def test_estimates_on_a_contended_radio_are_late_or_missing_and_the_delay_is_reported(name):
    run, memory = simulated(name, "duration=3.04 s")
    estimates, (track,) = memory.table("estimates"), run.tracks
    issued = np.isfinite(estimates["issued"])
    assert len(issued) == 75 and track["reports"] == issued.sum()
    late = estimates["issued"] > estimates["time"] + 0.04 + 1e-12
    assert (estimates["late"][issued] == late[issued]).all() and (estimates["late"][~issued] == 1).all()
    assert track["late"] == estimates["late"].sum() > 0
    if issued.any():
        assert track["delay"] == pytest.approx(np.median((estimates["issued"] - estimates["time"])[issued]))
    assert run.run["collided"] > 0 and run.run["retries"] > 0


@pytest.mark.thorough
def test_packing_and_a_gaussian_handover_give_more_estimates_than_the_plain_radio():
    plain, packed = simulated("pso_mhpf_real", "duration=4 s")[0], simulated("pso_mhpf_packed", "duration=4 s")[0]
    assert packed.tracks[0]["reports"] > 3 * plain.tracks[0]["reports"]


@pytest.mark.thorough
def test_computing_delays_the_estimate_by_its_duration():
    quick = simulated("ekf_real", *SHORT, "mac.kind=ideal", "packing.kind=none", "sink.kind=none")[1].table("estimates")
    slow, memory = simulated(
        "ekf_real", *SHORT, "mac.kind=ideal", "packing.kind=none", "sink.kind=none", "cpu.cycles_per_flop=1000"
    )
    late = memory.table("estimates")
    assert np.nanmax(quick["issued"] - quick["time"]) < 1e-3
    cycles = slow.run["cycles"] / slow.tracks[0]["reports"] * 1000
    assert np.nanmedian(late["issued"] - late["time"]) == pytest.approx(cycles / 64e6, rel=0.3)


@pytest.mark.thorough
def test_the_sink_receives_only_issued_estimates_and_none_without_a_path():
    _, memory = simulated("ekf_real", *SHORT)
    estimates, events = memory.table("estimates"), memory.table("events")
    told = np.isfinite(estimates["received"])
    assert told.sum() > 30 and (estimates["received"] >= estimates["issued"])[told].all()
    assert (events["kind"] == KIND["report"]).sum() == told.sum()
    places = [[-60, -60], [-40, -60], [-60, -40], [-45, -50], [-30, -70], [190, 190]]
    alone = [*SHORT, "deploy.kind=anchors", f"deploy.places={places}", "deploy.width=400 m", "deploy.height=400 m",
             "deploy.centre=[0, 0]", "sink.x=195 m", "sink.y=195 m", "mac.kind=csma"]  # fmt: skip
    run, memory = simulated("ekf_real", *alone)
    assert run.tracks[0]["reports"] > 0 and run.tracks[0]["received"] == 0
    words, events = memory.words.all(), memory.table("events")
    lost = events["what"][events["kind"] == KIND["drop"]]
    assert "no_path" in {words[int(code)] for code in lost}


@pytest.mark.thorough
def test_two_targets_have_a_track_each_and_readings_of_their_own():
    run, memory = simulated("two_targets", "duration=2 s")
    truth, estimates = memory.table("truth"), memory.table("estimates")
    assert sorted(set(estimates["target"].tolist())) == [0, 1] and len(run.tracks) == 2
    for target in (0, 1):
        mine = estimates["target"] == target
        assert np.nanmedian(estimates["error"][mine]) < 8.0, "the prior is 5 m off"
        other = truth["target"] == 1 - target
        there = np.array([truth[name][other][-1] for name in ("px", "py")])
        here = np.array([estimates[name][mine][-1] for name in ("px", "py")])
        assert np.linalg.norm(here - there) > 50.0, "nobody follows the other's target, though they have met"


def test_one_node_may_lead_the_tracks_of_two_targets_that_meet():
    one = "{kind: bounded_velocity, bound: 180 m, start: [-45, -20, -50, -35]}"
    run, memory = simulated("two_targets", "duration=1 s", f"targets=[{one}, {one}]")
    heads = memory.table("estimates")
    pairs = zip(heads["head"][heads["target"] == 0], heads["head"][heads["target"] == 1], strict=True)
    assert sum(a == b for a, b in pairs) > 10 and len(run.tracks) == 2


@pytest.mark.thorough
def test_the_same_seed_gives_the_same_bytes_on_every_radio_and_the_same_truth_on_all():
    runs = {}
    for name, again in itertools.product(("pso_mhpf_packed", "ekf_real", "pso_mhpf"), range(2)):
        runs[name, again] = simulated(name, *SHORT)[1].table("events" if again else "truth")
        events = simulated(name, *SHORT)[1].table("events")
        if again:
            assert all(np.array_equal(events[key], runs[name, again][key]) for key in events)
    truths = [runs[name, 0]["px"] for name in ("pso_mhpf_packed", "ekf_real", "pso_mhpf")]
    assert all(np.array_equal(truth, truths[0]) for truth in truths)
