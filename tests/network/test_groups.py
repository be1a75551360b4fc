"""Groups of tracks: they begin, move, merge, split and end, and survive what happens to their heads."""

from __future__ import annotations

import gc
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wsnsim.base.scans import TrackEstimate
from wsnsim.base.tables import KIND, Memory
from wsnsim.experiment import simulate_run
from wsnsim.network.clusters.groups import GroupLead
from wsnsim.network.clusters.track import outdone

WANTED = dict.fromkeys(("truth", "estimates", "events", "clusters", "energy", "nodes"), True)
STEPS = 30


def crossing(**others: Any) -> dict[str, Any]:
    """Two targets that cross in the middle of a field that no head oversees, without clutter."""
    paths = [[[0, -60, -45], [STEPS, 60, 45]], [[0, -60, 45], [STEPS, 60, -45]]]
    return {
        "name": "groups", "seed": 11, "duration": f"{STEPS} s", "step": "1 s",
        "deploy": {"kind": "grid", "nodes": 36, "width": "150 m", "height": "150 m", "cover": False},
        "targets": [{"kind": "waypoints", "points": path} for path in paths], "energy": {"kind": "first_order"},
        "sensor": {"kind": "range_bearing", "range_sd": "1 m", "bearing_sd": "2 deg", "reach": "40 m"},
        "detection": {"kind": "unlabelled", "probability": 0.95}, "link": {"kind": "disk", "reach": "80 m"},
        "clusters": {"kind": "strongest_signal", "handover_fraction": 0.5},
        "tracker": {"kind": "jpda", "filter": {"kind": "ekf"}}, **others,
    }  # fmt: skip


def recorded(**others: Any) -> Memory:
    memory = Memory(WANTED)
    simulate_run(crossing(**others), 0, memory)
    return memory


def events(memory: Memory, kind: str) -> dict[str, np.ndarray]:
    table = memory.table("events")
    return {name: column[table["kind"] == KIND[kind]] for name, column in table.items()}


def followed(memory: Memory, step: int) -> list[float]:
    """The distance from each target to the nearest confirmed track at a step."""
    truth, table = memory.table("truth"), memory.table("estimates")
    here = (table["step"] == step) & (table["confirmed"] == 1)
    there = truth["step"] == step
    targets = np.column_stack([truth["px"][there], truth["py"][there]])
    tracks = np.column_stack([table["px"][here], table["py"][here]])
    assert len(tracks), f"no confirmed track at step {step}"
    return [float(np.hypot(*(tracks - point).T).min()) for point in targets]


def test_groups_move_with_their_tracks_merge_where_these_cross_and_split_behind() -> None:
    memory = recorded()
    assert max(error for step in (6, 14, 22, STEPS - 1) for error in followed(memory, step)) < 4.0
    merges, splits = events(memory, "merge"), events(memory, "split")
    assert merges["time"].size and splits["time"].size
    assert merges["time"].min() <= STEPS / 2 + 3 and splits["time"].max() >= STEPS / 2
    assert (merges["sequence"] < merges["target"]).all() and (splits["sequence"] > splits["target"]).all()
    heads = memory.table("estimates")["head"]
    assert np.unique(heads).size > 2
    sent = memory.table("events")
    assert (
        (sent["kind"] == KIND["send"]) & (sent["node"] == merges["node"][0]) & (sent["time"] == merges["time"][0])
    ).any()


def test_a_merge_or_a_split_is_paid_for_and_a_track_keeps_its_number() -> None:
    memory = recorded()
    table, merges = memory.table("estimates"), events(memory, "merge")
    before, after = (set(table["track"][table["step"] == int(merges["time"][0]) + shift]) for shift in (0, 1))
    assert len(before & after) >= 2
    energy, nodes = memory.table("energy"), memory.table("nodes")
    each = np.bincount(energy["node"], energy["joules"], 36)
    np.testing.assert_allclose(each, nodes["energy_initial"] - nodes["energy_left"], rtol=1e-9, atol=1e-15)


def test_a_group_whose_head_crashes_ends_and_another_begins_from_detections() -> None:
    memory = recorded(
        targets=[{"kind": "waypoints", "points": [[0, -60, -45], [STEPS, 60, 45]]}],
        faults=[{"kind": "crash", "at": "8.5 s", "head": 0}],
    )
    assert (events(memory, "lost")["time"] >= 8.5).any()
    assert (events(memory, "begin")["time"] > 8.5).any()
    assert followed(memory, STEPS - 1)[0] < 4.0


def test_a_group_ends_with_its_last_track() -> None:
    path = [[0, -60, -45], [STEPS, 60, 45]]
    memory = recorded(targets=[{"kind": "waypoints", "points": path, "presence": [[0, 12]]}])
    ends = events(memory, "end")
    assert ((ends["time"] > 12) & (ends["time"] < 12 + 10)).any()
    assert memory.table("estimates")["step"].max() < 12 + 10
    released = memory.table("clusters")["released"]
    assert np.isfinite(released).all()


@pytest.mark.thorough(fast=["csma"])
@pytest.mark.parametrize("mac", ["csma", "tdma", "xmac", "contikimac", "tsch"])
def test_groups_live_with_radios_that_lose_frames_and_take_time(mac) -> None:
    memory = recorded(mac={"kind": mac}, faults=[{"kind": "link_loss", "at": "0 s", "fraction": 1.0, "loss": 0.1}])
    energy, nodes = memory.table("energy"), memory.table("nodes")
    each = np.bincount(energy["node"], energy["joules"], 36)
    np.testing.assert_allclose(each, nodes["energy_initial"] - nodes["energy_left"], rtol=1e-9, atol=1e-12)
    assert events(memory, "begin")["time"].size


RADIOS: dict[str, dict[str, Any]] = {
    "ideal": {"energy": {"kind": "first_order"}, "link": {"kind": "disk", "reach": "80 m"}},
    "csma": {"mac": {"kind": "csma", "rate": "250 kbit/s"}},
    "tdma": {"mac": {"kind": "tdma"}},
    "xmac": {"mac": {"kind": "xmac", "rate": "250 kbit/s", "interval": "125 ms"}},
    "tsch": {"mac": {"kind": "tsch", "slotframe": 11, "shared": 3}},
}
CC2420 = {
    "energy": {"kind": "states", "radio": "cc2420", "processor": "nrf52840", "power": "0 dBm", "battery": "18720 J"},
    "cpu": {"rate": "64 MHz", "cycles_per_flop": 10},
    "link": {
        "kind": "log_normal", "power": "0 dBm", "exponent": 2.13, "loss_at_1m": "55 dB", "shadowing": "4 dB",
        "asymmetry": "1 dB", "sensitivity": "-95 dBm",
    },
}  # fmt: skip
PROTOCOLS: dict[str, dict[str, Any]] = {
    "central": {"kind": "central"},
    "strongest_signal": {"kind": "strongest_signal", "handover_fraction": 0.4},
}


@pytest.mark.thorough(fast=["ideal-central", "csma-central"])
@pytest.mark.parametrize("protocol", PROTOCOLS)
@pytest.mark.parametrize("radio", RADIOS)
def test_every_radio_confirms_tracks_amid_clutter_with_both_protocols(radio: str, protocol: str) -> None:
    memory = recorded(
        detection={"kind": "unlabelled", "probability": 0.9, "clutter": 0.5},
        clusters=PROTOCOLS[protocol], **(RADIOS[radio] if radio == "ideal" else CC2420 | RADIOS[radio]),
    )  # fmt: skip
    assert events(memory, "confirm")["time"].size
    table = memory.table("estimates")
    of_tracks = np.column_stack([table["step"], table["track"]])[table["confirmed"] == 1]
    assert len(of_tracks) == len(np.unique(of_tracks, axis=0)), "a track has one row at each step"
    truth = memory.table("truth")
    near = [
        float(np.hypot(truth["px"][truth["step"] == step] - px, truth["py"][truth["step"] == step] - py).min())
        for step, px, py in zip(*(table[name][table["confirmed"] == 1] for name in ("step", "px", "py")), strict=True)
    ]
    assert float(np.median(near)) < 5.0


@pytest.mark.parametrize("arrived", [0, 3, 10])
@pytest.mark.parametrize("clutter", [0.0, 0.7])
def test_silence_says_as_much_against_a_target_as_bayes_has_it_where_scans_are_lost(
    arrived: int, clutter: float
) -> None:
    lead = GroupLead(*[None] * 5)  # type: ignore[arg-type]
    lead.note(10, arrived)
    share, quiet, detected = arrived / 10, math.exp(-clutter), 0.9
    without = quiet + (1.0 - share) * (1.0 - quiet)
    missed = (1.0 - detected) * quiet
    with_target = missed + (1.0 - share) * (1.0 - missed)
    assert 1.0 - detected * lead.heard(clutter) == pytest.approx(with_target / without, rel=1e-12)


@given(st.lists(st.tuples(st.integers(0, 3), st.booleans(), st.booleans()), min_size=1, max_size=8), st.integers(0, 99))
@settings(max_examples=20)
def test_two_tracks_of_one_target_end_as_the_older_and_targets_apart_keep_theirs(rows: list[Any], seed: int) -> None:
    noise = 0.3 * np.random.default_rng(seed).standard_normal((len(rows), 4))
    tracks = [
        TrackEstimate(
            number, np.array([30.0 * target, 1.0, 0.0, 1.0]) + noise[number], np.eye(4), np.nan, confirmed, 0.0
        )
        for number, (target, confirmed, _) in enumerate(rows)
    ]
    groups = [[track for track in tracks if rows[track.number][2] is side] for side in (False, True)]
    left = {track.number for own, others in (groups, groups[::-1]) for track in own if not outdone(track, others)}
    for target in {row[0] for row in rows}:
        mine = [track for track in tracks if rows[track.number][0] == target]
        best = min(mine, key=lambda track: (not track.confirmed, track.number))
        kept = left & {track.number for track in mine}
        assert best.number in kept, "its target keeps a track"
        assert {rows[number][2] for number in kept} == {rows[best.number][2]}, "all others' tracks of it end"


def test_groups_that_track_one_target_by_themselves_end_with_one_track_of_its_first_number() -> None:
    paths = [{"kind": "waypoints", "points": [[0, -60, -45], [STEPS, 60, 45]]}]
    memory = recorded(targets=paths, clusters=PROTOCOLS["strongest_signal"], **(CC2420 | RADIOS["csma"]))
    table = memory.table("estimates")
    assert np.unique(table["track"][table["step"] >= STEPS - 3]).tolist() == [0]


def test_no_track_ends_without_an_event_where_the_groups_of_four_targets_merge_over_a_slow_radio() -> None:
    starts = [(-60, -45), (-60, 45), (60, 40), (60, -40)]
    paths = [[[0, x, y], [STEPS // 2, 0, 0], [STEPS, -x, y]] for x, y in starts]
    targets = [{"kind": "waypoints", "points": path} for path in paths]
    memory = recorded(targets=targets, clusters=PROTOCOLS["strongest_signal"], **(CC2420 | RADIOS["csma"]))
    table, deleted = memory.table("estimates"), events(memory, "delete")["sequence"]
    assert events(memory, "merge")["time"].size > 2 and not events(memory, "lost")["time"].size
    for number in np.unique(table["track"]):
        steps = table["step"][table["track"] == number].tolist()
        assert steps == [*range(steps[0], steps[-1] + 1)], "a row at each step"
        assert number in deleted or steps[-1] >= table["step"].max() - 1


@pytest.mark.thorough
def test_the_groups_of_the_scenario_with_a_crossing_confirm_a_track_for_each_target_and_no_other() -> None:
    memory = Memory(WANTED)
    simulate_run("scans_crossing", 0, memory)
    table = memory.table("estimates")
    assert np.unique(table["track"][table["confirmed"] == 1]).size == 2


def living_objects(steps: int) -> list[int]:
    """How many objects of the network live at the middle and at the end of a run in which clutter begins groups."""
    found: list[int] = []

    def count(now: float) -> None:
        if now in (steps // 2, steps - 1):
            gc.collect()
            found.append(
                sum(str(type(each).__module__).startswith(("wsnsim.network", "simpy")) for each in gc.get_objects())
            )

    scenario = crossing(
        targets=[{"kind": "waypoints", "points": [[0, 0, 0], [9, 9, 9]], "presence": []}],
        duration=f"{steps} s",
        detection={"kind": "unlabelled", "probability": 0.9, "clutter": 0.7},
    )
    memory = Memory({"clusters": True})
    simulate_run(scenario, 0, memory, progress=count)
    assert len(memory.table("clusters")["target"]) > steps / 20, "groups begin and end all the time"
    return found


@pytest.mark.thorough
def test_groups_that_ended_leave_nothing_in_memory() -> None:
    middle, end = living_objects(400)
    assert end <= 1.2 * middle


@pytest.mark.thorough
def test_bits_and_joules_rise_with_clutter_and_the_ledger_closes() -> None:
    spent, sent = [], []
    for clutter in (0.0, 1.0, 3.0):
        memory = recorded(
            duration="5 s", clusters={"kind": "central"},
            detection={"kind": "unlabelled", "probability": 0.95, "clutter": clutter},
        )  # fmt: skip
        energy, nodes = memory.table("energy"), memory.table("nodes")
        each = np.bincount(energy["node"], energy["joules"], 36)
        np.testing.assert_allclose(each, nodes["energy_initial"] - nodes["energy_left"], rtol=1e-9, atol=1e-15)
        spent.append(float(each.sum()))
        sent.append(int(events(memory, "send")["bits"].sum()))
    assert sent[0] < sent[1] < sent[2] and spent[0] < spent[1] < spent[2]
