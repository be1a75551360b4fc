"""A replay equals a slow loop over the tables, fits its room, and notes what is thinned."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.helpers import unlabelled
from tests.helpers.recordings import recording
from wsnsim import read
from wsnsim.analysis.plot_data import is_headless, read_replicate
from wsnsim.base.tables import KIND, TABLES
from wsnsim.recording import ResultFile
from wsnsim.report import replay, replay_encoding
from wsnsim.report.replay_encoding import ENDS, JOINS, DetailLevel, ReplayEncoder, add_clusters, add_particles

from .page_reader import decoded, rows_at
from .synthetic_results import CLUSTER_EVENTS, ON_A_LINE, PLANE, write_result


@pytest.fixture(scope="module")
def two():
    """A simulated run of two targets whose clusters share nodes."""
    return recording("two_targets")


@pytest.mark.thorough
def test_places_are_those_of_the_tables_to_a_rounding(real):
    header, at = decoded(replay.encode(real, 0, 10**7).text)
    left, bottom, right, top = header["box"]
    truth, guess, nodes = (
        frame[frame.replicate == 0] for frame in (read(real, "truth"), read(real, "estimates"), read(real, "nodes"))
    )
    for name, table, columns in (
        ("truth", truth, ("px", "py")),
        ("estimate", guess, ("px", "py")),
        ("node", nodes, ("x", "y")),
    ):
        for axis, column, low, high in zip("xy", columns, (left, bottom), (right, top), strict=True):
            shown = low + at[f"{name}_{axis}"][-len(table) :] / 65534 * (high - low)
            np.testing.assert_allclose(shown, table[column].clip(low, high), atol=0.51 * (high - low) / 65534)
    assert at["estimate_x"][0] == replay_encoding.MISSING and len(at["estimate_x"]) == header["frames"] == 101
    np.testing.assert_array_equal(at["node"][at["head"][1:]], guess["head"])
    np.testing.assert_allclose(at["error"][1:], guess["error"], rtol=1e-6)


@pytest.mark.thorough
def test_states_and_charges_are_what_a_loop_over_the_log_gives(tmp_path):
    path = write_result(tmp_path / "x.h5", events=True, steps=12, nodes=7)
    header, at = decoded(replay.encode(path, 0, 10**6).text)
    events, nodes = read(path, "events"), read(path, "nodes")
    state, spent = dict.fromkeys(range(7), 0), dict.fromkeys(range(7), 0.0)
    for node in range(7):
        changes = events[(events.node == node) & events.kind.isin(["wake", "sleep", "death", "crash"])]
        state[node] = int(changes.kind.iloc[0] == "sleep")
    booked = events.groupby("node").joules.sum()
    mode, level = at["state"].copy(), at["charge"].copy()
    low, _, levels = header["charge"]
    for frame in range(header["frames"]):
        for row in events[events.step == frame].itertuples():
            state[row.node] = {"wake": 1, "sleep": 0, "death": 2, "crash": 2}.get(row.kind, state[row.node])
            spent[row.node] += row.joules
        for name, values, field in (("state_change", mode, "state"), ("charge_change", level, "level")):
            rows = rows_at(at, name, frame)
            for node, value in zip(at[f"{name}_node"][rows], at[f"{name}_{field}"][rows], strict=True):
                values[node] = value
        assert mode.tolist() == list(state.values())
        even = (nodes.energy_initial - nodes.energy_left - booked) * frame / 12
        share = 1 - (np.array(list(spent.values())) + even) / 2.0
        np.testing.assert_allclose(low + (1 - low) * level / levels, share, atol=0.51 * (1 - low) / levels)


@pytest.mark.thorough
def test_links_are_what_a_loop_over_the_log_gives(tmp_path):
    path = write_result(tmp_path / "x.h5", events=True, steps=12, nodes=7)
    header, at = decoded(replay.encode(path, 0, 10**6).text)
    events = read(path, "events")
    received = set(events[events.kind == "receive"].frame)
    for frame in range(header["frames"]):
        expected, senses, casts = set(), set(), []
        for row in events[events.step == frame].itertuples():
            if row.kind in ("receive", "collide") and row.peer >= 0:
                expected.add((row.peer, row.node, row.kind == "collide"))
            if row.kind == "send" and row.peer >= 0 and row.frame not in received:
                expected.add((row.node, row.peer, True))
            if row.kind == "send" and row.peer < 0:
                casts.append(row.node)
            if row.kind == "sense":
                senses.add(row.node)
        rows = rows_at(at, "link", frame)
        names = ("link_origin", "link_destination", "link_lost")
        assert set(zip(*(at[name][rows].tolist() for name in names), strict=True)) == expected
        assert at["broadcast_node"][rows_at(at, "broadcast", frame)].tolist() == casts
        assert set(at["sense_node"][rows_at(at, "sense", frame)].tolist()) == senses


def clusters_of(at, frames, targets):
    """The clusters of each target at each frame, from the columns."""
    clusters = [set() for _ in range(targets)]
    for frame in range(frames):
        rows = rows_at(at, "membership", frame)
        names = ("membership_node", "membership_target", "membership_change")
        for node, target, what in zip(*(at[name][rows].tolist() for name in names), strict=True):
            if what == replay_encoding.LEAVES:
                clusters = [cluster - {node} for cluster in clusters]
            elif what == replay_encoding.JOINS:
                clusters[target] = clusters[target] | {node}
            else:
                clusters[target] = {node} if what == replay_encoding.STARTS else set()
        yield list(clusters)


def modes_of(at, frames):
    """The states of the nodes at each frame, from the columns."""
    mode = at["state"].copy()
    for frame in range(frames):
        rows = rows_at(at, "state_change", frame)
        for node, state in zip(at["state_change_node"][rows], at["state_change_state"][rows], strict=True):
            mode[node] = state
        yield mode.tolist()


def looped(events, frames, targets, mode):
    """The same from the event log, one event at a time; nodes that a handover sends to sleep are shown asleep later."""
    clusters, late = [set() for _ in range(targets)], []
    to = {"wake": 1, "sleep": 0, "resume": 0, "death": 2}
    for frame in range(frames):
        rows, handed = list(events[events.step == frame].itertuples()), set()
        told, late = [(row.kind, row.node, row.target) for row in late], []
        for number, row in enumerate(rows):
            again = any(other.node == row.node and other.kind in to for other in rows[number + 1 :])
            if row.kind in ("sleep", "resume") and row.target in handed and not again:
                late.append(row)
            else:
                told.append((row.kind, row.node, row.target))
            handed |= {row.target} if row.kind == "handover" else set()
        for kind, node, target in told:
            if kind in ("elect", "announce", "lost"):
                clusters[target] = set() if kind == "lost" else {node}
            elif kind == "join":
                clusters[target] = clusters[target] | {node}
            elif kind in ("sleep", "resume", "death"):
                clusters = [cluster - {node} for cluster in clusters]
            mode[node] = to.get(kind, mode[node])
        yield list(clusters), list(mode)


@pytest.mark.thorough
def test_clusters_and_states_are_what_a_loop_over_the_log_gives(tmp_path):
    path = write_result(tmp_path / "x.h5", events=CLUSTER_EVENTS, steps=12, nodes=9, targets=3)
    header, at = decoded(replay.encode(path, 0, 10**6).text)
    frames, events = header["frames"], read(path, "events")
    drawn = zip(clusters_of(at, frames, 3), modes_of(at, frames), strict=True)
    several = 0
    for shown, expected in zip(drawn, looped(events, frames, 3, at["state"].tolist()), strict=True):
        assert shown == expected
        several += len(set.union(*shown[0])) < sum(map(len, shown[0]))
    assert several  # a node is of several clusters


@pytest.mark.thorough(fast=["real"])
@pytest.mark.parametrize("name", ["real", "two"])
def test_members_are_as_many_as_the_estimates_say_and_no_head_or_member_rests(name, request):
    path = request.getfixturevalue(name)
    header, at = decoded(replay.encode(path, 0, 10**7).text)
    frames, targets = header["frames"], len(header["targets"])
    guess = read(path, "estimates").query("replicate == 0").set_index(["target", "step"])
    assert (read(path, "events").query("replicate == 0").kind == "handover").any()
    drawn = zip(clusters_of(at, frames, targets), modes_of(at, frames), strict=True)
    for frame, (clusters, modes) in enumerate(drawn):
        for target in range(targets if frame else 0):
            assert len(clusters[target]) == guess.members[target, frame]
            head = at["head"][target * frames + frame]
            assert head in clusters[target] and all(modes[node] == 1 for node in clusters[target])


def test_what_a_reader_cannot_see_is_noted(real, tmp_path):
    notes = " ".join(replay.encode(real, 0, 10**7).notes)
    assert "bold for the last 60 steps" in notes and "No cluster members" not in notes and "later" not in notes
    bare = write_result(tmp_path / "x.h5", events=("send", "receive"), steps=5)
    notes = " ".join(replay.encode(bare, 0, 10**6).notes)
    assert "No cluster members are drawn: the event log has none." in notes and "bold" not in notes
    held, logged = 5 * (2.0 - 1.5), read(bare, "events").joules.sum()
    assert f"Of {held:.4g} J that the nodes spent, the event log has no time for {held - logged:.4g} J" in notes


def test_how_late_estimates_were_known_is_noted(tmp_path):
    path = write_result(tmp_path / "x.h5", delay=1.25)
    assert "it was computed up to 1.25 s later" in " ".join(replay.encode(path, 0, 10**6).notes)


@pytest.mark.thorough
def test_true_counts_are_kept_where_fewer_are_drawn(tmp_path, monkeypatch):
    path = write_result(tmp_path / "x.h5", events=True, steps=12, nodes=30)
    whole = decoded(replay.encode(path, 0, 10**6).text)[1]
    monkeypatch.setattr(replay, "DETAILS", (replay_encoding.DetailLevel(links=3),))
    part = decoded(replay.encode(path, 0, 10**6).text)[1]
    assert part["link_count"].max() == 3 and "link_total" not in whole
    np.testing.assert_array_equal(part["link_total"], whole["link_count"])


def test_particles_are_where_the_table_has_them(real):
    header, at = decoded(replay.encode(real, 1, 10**7).text)
    cloud = read(real, "particles").query("replicate == 1 and step == 50 and weight > 0")
    rows = rows_at(at, "particle", 50)
    side = header["box"][2] - header["box"][0]
    low, width = at["particle_x_low"][50], at["particle_x_width"][50]
    shown = header["box"][0] + side * (low + at["particle_x"][rows] / 255 * width)
    assert 0 < shown.size <= len(cloud)
    for x in shown:
        assert np.abs(cloud.px - x).min() < 0.51 * side * width / 255 + 1e-4


@pytest.mark.thorough
def test_what_has_no_room_is_thinned_and_said(tmp_path):
    path = write_result(tmp_path / "x.h5", events=True, steps=200, nodes=100)
    whole = replay.encode(path, 0, 10**6)
    part = replay.encode(path, 0, len(whole.text) // 3)
    assert len(part.text) <= len(whole.text) // 3
    assert any("of 200 is drawn" in note for note in part.notes)
    assert not any("step of" in note for note in whole.notes)
    header, at = decoded(part.text)
    assert header["stride"] > 1 and header["frames"] == -(-200 // header["stride"]) + 1 == len(at["link_count"])
    none = replay.encode(path, 0, 100)
    assert none.text == "" and "left out" in none.notes[0]


def test_what_is_kept_is_spread_evenly():
    frames = np.repeat([0, 2, 3], [10, 3, 100])
    kept = replay_encoding.thinned(frames, 5)
    assert [int(kept[frames == frame].sum()) for frame in (0, 2, 3)] == [5, 3, 5]
    assert np.diff(np.flatnonzero(kept[frames == 3])).tolist() == [20] * 4
    assert replay_encoding.evenly(10, 5).tolist() == [False, True] * 5
    assert replay_encoding.evenly(0, 5).size == 0 and replay_encoding.evenly(3, 5).all()


@pytest.mark.thorough
def test_a_log_without_nodes_draws_nothing_between_them(tmp_path):
    path = write_result(tmp_path / "x.h5", events=True, without=("nodes",))
    assert not {"link_count", "membership_count", "node_x"} & decoded(replay.encode(path, 0, 10**6).text)[1].keys()
    bare = write_result(tmp_path / "y.h5", events=True, without=("nodes", "truth", "estimates"))
    assert replay.encode(bare, 0, 10**6).text == ""


def test_a_position_on_a_line_is_drawn_over_time_with_its_sensors_at_the_edge(tmp_path):
    path = write_result(tmp_path / "x.h5", targets=2, **ON_A_LINE)
    header, at = decoded(replay.encode(path, 0, 10**6).text)
    assert header["flat"] and header["targets"] == [0, 1] and header["axes"] == ["time [s]", "px [m]"]
    assert (np.diff(at["truth_x"].astype(int).reshape(2, -1)) > 0).all() and set(at["node_x"]) == {65534}
    shown = header["box"][1] + (header["box"][3] - header["box"][1]) * at["node_y"] / 65534
    np.testing.assert_allclose(shown, read(path, "nodes").x, atol=0.01)


def test_a_replay_shows_all_tracks_detections_and_switches_where_readings_name_no_target(tmp_path):
    path = unlabelled.write_result(tmp_path / "x.h5")
    header, at = decoded(replay.encode(path, 0, 10**6).text)
    left, bottom, right, top = header["box"]
    tracks = unlabelled.rows_of(unlabelled.truth_of(0, 2), 0)
    assert header["groups"] == 0 and header["targets"] == [0, 1]
    for step in range(header["frames"]):
        rows, own = rows_at(at, "track", step), tracks.step == step
        assert at["track_number"][rows].tolist() == tracks.track[own].tolist()
        assert at["track_confirmed"][rows].tolist() == tracks.confirmed[own].tolist()
        x = left + at["track_x"][rows] / 65534 * (right - left)
        np.testing.assert_allclose(x, tracks.position[own, 0].clip(left, right), atol=0.51 * (right - left) / 65534)
    assert at["detection_count"].tolist() == [0, 0, 2, 2] + [0] * 9
    assert at["detection_clutter"].tolist() == [0, 1] * 2
    assert at["switch_count"].tolist() == [0] * 8 + [2] + [0] * 4
    y = bottom + at["switch_y"] / 65534 * (top - bottom)
    assert y.tolist() == pytest.approx([0.0, 20.0], abs=0.01)


def test_a_replay_of_tracks_without_the_ground_truth_shows_what_there_is(tmp_path):
    path = unlabelled.write_result(tmp_path / "x.h5", without=("truth",))
    header, at = decoded(replay.encode(path, 0, 10**6).text)
    assert header["targets"] == [] and at["track_x"].size and "detection_x" not in at


def test_a_replay_without_a_switch_or_a_target_is_ordinary(tmp_path):
    for targets in (0, 1):
        path = unlabelled.write_result(tmp_path / f"{targets}.h5", runs=1, targets=targets)
        header, at = decoded(replay.encode(path, 0, 10**6).text)
        assert header["targets"] == [*range(targets)] and at["track_x"].size and not at["switch_x"].size


def test_targets_that_are_named_have_a_replay_without_groups(two):
    header, at = decoded(replay.encode(two, 0, 10**7).text)
    assert header["groups"] is None and "track_x" not in at


def test_without_a_head_those_who_compute_are_the_members_of_a_frame(tmp_path):
    with ResultFile(tmp_path / "y.h5", PLANE, dict.fromkeys(TABLES, True), position=(0, 2), headless=True):
        pass
    run = read_replicate(write_result(tmp_path / "x.h5", nodes=5), 0)
    assert (is_headless(tmp_path / "y.h5"), run.headless) == (True, False)
    events = {"step": np.array([1, 1, 1, 2]), "node": np.array([2, 0, 2, 3]), "target": np.zeros(4, int)}
    run = replace(run, events=events | {"kind": np.full(4, KIND["compute"])}, headless=True)
    encoder = ReplayEncoder.empty(run, DetailLevel())
    assert add_clusters(encoder).tolist() == [0, 2, 3]
    columns = encoder.columns
    assert columns["membership_count"].tolist()[:4] == [0, 3, 2, 0]
    assert columns["membership_change"].tolist() == [ENDS, JOINS, JOINS, ENDS, JOINS]
    assert columns["membership_node"][columns["membership_change"] == JOINS].tolist() == [0, 2, 3]


def test_a_portion_after_the_first_one_has_the_particles_of_its_steps(tmp_path):
    run = read_replicate(write_result(tmp_path / "x.h5"), 0)
    cloud = {"target": np.zeros(4, int), "step": np.array([1, 2, 3, 4]), "px": np.zeros(4), "py": np.zeros(4)}
    run = replace(run, cloud=cloud | {"weight": np.ones(4)})
    encoder = replace(ReplayEncoder.empty(run, DetailLevel()), first=2, frames=2)
    add_particles(encoder)
    assert encoder.columns["particle_count"].tolist() == encoder.columns["particle_total"].tolist() == [1, 1]
