"""The portions of a watched run, put together, are the replay of its result."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from tests.report.page_reader import decoded
from wsnsim import experiment, read
from wsnsim.report import replay
from wsnsim.report.replay_encoding import ENDS, LEAVES, STARTS
from wsnsim.scenario import load
from wsnsim.watch.live_frames import LiveFrames, LiveRecorder

SHORT = ["duration=3 s", "tracker.particles=40"]


def watched(path, scenario, overrides, look_every=7):
    """The live frames and all portions of a run whose state was looked at every few steps."""
    made, ticks = [], itertools.count()
    experiment.run(
        load(scenario, overrides), replicates=1, out=path,
        watched=lambda file: LiveRecorder(
            file, lambda start: made.append((LiveFrames(start), [])),
            lambda piece: made[-1][1].append(made[-1][0].add([piece])), look_every, lambda: next(ticks),
        ),
    )  # fmt: skip
    frames, texts = made[-1]
    return frames, [decoded(text) for text in texts]


def together(portions, name):
    return np.concatenate([columns[name] for _, columns in portions if name in columns])


def clusters_of(columns, frames):
    """The members of each target's cluster, frame by frame."""
    members, shown, at = {}, [], 0
    for count in columns["membership_count"][:frames]:
        for row in range(at, at + count):
            node, target, change = (int(columns[f"membership_{n}"][row]) for n in ("node", "target", "change"))
            if change == LEAVES:
                members = {number: each - {node} for number, each in members.items()}
                continue
            members[target] = set() if change in (STARTS, ENDS) else members.get(target, set())
            members[target] |= {node} - ({node} if change == ENDS else set())
        at += count
        shown.append({number: each for number, each in members.items() if each})
    return shown


@pytest.mark.thorough
@pytest.mark.parametrize("scenario", ["pso_mhpf", "two_targets"])
def test_portions_put_together_are_the_replay_of_the_result(tmp_path, scenario):
    frames, portions = watched(tmp_path / "x.h5", scenario, SHORT)
    header, whole = decoded(replay.encode(tmp_path / "x.h5", 0, 10**8).text)
    head, start = decoded(frames.head)
    assert {key: head[key] for key in ("last", "box", "targets", "frames", "nodes", "dt", "axes")} == {
        key: header[key] for key in ("last", "box", "targets", "frames", "nodes", "dt", "axes")
    }
    known = sum(part["frames"] for part, _ in portions)
    assert len(portions) > 5 and header["frames"] - 10 <= known <= header["frames"]
    for name in ("node", "node_x", "node_y", "truth_x", "truth_y"):
        np.testing.assert_array_equal(start[name], whole[name])
    for table, columns in (
        ("sense", ["node"]), ("link", ["origin", "destination", "message", "lost"]),
        ("state_change", ["node", "state"]), ("broadcast", ["node"]),
    ):  # fmt: skip
        np.testing.assert_array_equal(together(portions, f"{table}_count"), whole[f"{table}_count"][:known])
        rows = whole[f"{table}_count"][:known].sum()
        for name in columns:
            np.testing.assert_array_equal(together(portions, f"{table}_{name}"), whole[f"{table}_{name}"][:rows])
    np.testing.assert_array_equal([c["state"] for _, c in portions if "state" in c][-1], whole["state"])
    names = ("membership_count", "membership_node", "membership_target", "membership_change")
    live = clusters_of({name: together(portions, name) for name in names}, known)
    assert live == clusters_of(whole, known) and any(live)
    place = together(portions, "place")
    for name in ("estimate_x", "estimate_y", "error", "head"):
        shown = np.full(whole[name].size, {"error": np.nan, "head": -1}.get(name, 65535), whole[name].dtype)
        shown[place] = together(portions, name)
        of_target = np.arange(shown.size) % header["frames"]
        np.testing.assert_array_equal(shown[of_target < known], whole[name][of_target < known])


def test_where_readings_name_no_target_messages_are_shown_and_no_group_is_taken_for_a_target(tmp_path):
    frames, portions = watched(tmp_path / "x.h5", "scans_crossing", ["duration=8 s"])
    head, _ = decoded(frames.head)
    assert head["groups"] == 0 and head["targets"] == [0, 1]
    names = {name for _, columns in portions for name in columns}
    assert not {name for name in names if name.startswith(("membership", "estimate"))}
    assert together(portions, "link_origin").size


@pytest.mark.thorough
def test_error_and_energy_so_far_approach_those_of_the_result(tmp_path):
    frames, _ = watched(tmp_path / "x.h5", "pso_mhpf", SHORT, look_every=1)
    runs, energy = read(tmp_path / "x.h5", "runs"), read(tmp_path / "x.h5", "energy")
    errors = read(tmp_path / "x.h5", "estimates")["error"]
    assert frames.rmse == pytest.approx(np.sqrt((errors[: len(errors) - 1] ** 2).mean()), rel=1e-9)
    assert sum(frames.joules.values()) == pytest.approx(float(runs["energy"].iloc[0]), rel=0.05)
    by_cause = energy.groupby("cause", observed=True)["joules"].sum()
    assert set(frames.joules) == {str(cause) for cause in by_cause[by_cause > 0].index}


@pytest.mark.thorough
def test_the_energy_spent_is_a_curve_that_ends_at_what_was_spent(tmp_path):
    frames, portions = watched(tmp_path / "x.h5", "pso_mhpf", SHORT)
    times, joules = np.array([point for part, _ in portions for point in part["spent"]]).T
    assert len(times) == len(portions) and (np.diff(times) > 0).all() and 2.5 < times[-1] <= 3.0
    assert (np.diff(joules) >= 0).all() and joules[-1] == pytest.approx(sum(frames.joules.values())) and joules[-1] > 0


def test_residual_energy_is_drawn_on_a_scale_that_widens(tmp_path):
    _, portions = watched(tmp_path / "x.h5", "pso_mhpf", SHORT)
    scales = [part["charge"] for part, _ in portions]
    assert all(later[0] <= earlier[0] for earlier, later in itertools.pairwise(scales))
    assert together(portions, "charge_change_node").size > 0
