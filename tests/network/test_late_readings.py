"""Late readings on X-MAC: a filter fed from the event log in the order of measurement is the head's, step by step."""

from __future__ import annotations

from functools import cache
from typing import cast

import numpy as np
import pytest

import wsnsim
from wsnsim.base.errors import ScenarioError
from wsnsim.base.initial_conditions import sample_initial_conditions
from wsnsim.base.setups import TrackingSetup
from wsnsim.base.tables import CAUSE, KIND, RECORDED_BY_DEFAULT, Memory
from wsnsim.scenario.build import build

DT, CAP, VARIANCE = 1.0, 0.6, 4.0
"""A step, the head's longest wait in it (0.6 of a step: a hop takes at most 0.5 s), and the variance of a range."""
NODES = 8
FIELD = (
    "step=1 s", "duration=11 s", f"deploy={{kind: uniform, nodes: {NODES}, width: 80 m, height: 80 m, cover: false}}",
    "link={kind: disk, reach: 150 m}", "sensor={kind: range, reach: 200 m, sd: 2 m}", "sink={kind: none}",
    "motion={kind: constant_velocity, variances: [0.05], start: [-15, 1.5, -15, 1.5]}",
    "prior={kind: around_truth, sd: [5, 1, 5, 1]}", "clusters={kind: central, x: 0 m, y: 0 m}",
    "mac={kind: xmac, rate: 250 kbit/s, interval: 0.5 s}",
)  # fmt: skip
"""A field of one hop, in which every node measures the target at each step, and the node in the middle leads."""


class XmacRun:
    """A run, and what its event log says: (step, node, time) of each reading that its head received."""

    def __init__(self, late: str, *changes: str) -> None:
        self.memory = Memory(RECORDED_BY_DEFAULT | {"readings": True})
        said = [*FIELD, f"tracker={{kind: ekf, late: {late}, late_window: 100 s}}", *changes]
        self.scenario = wsnsim.load("ekf_real", said)
        wsnsim.experiment.simulate_run(self.scenario, 0, self.memory)
        events, self.estimates = self.memory.table("events"), self.memory.table("estimates")
        self.head = int(self.estimates["head"][0])
        chosen = events["what"] == self.memory.words.code("reading")
        chosen &= (events["kind"] == KIND["receive"]) & (events["node"] == self.head)
        senders = [node for node in range(NODES) if node != self.head]
        self.arrivals = []
        for time, peer, number in zip(*(events[name][chosen].tolist() for name in ("time", "peer", "sequence")),
                                      strict=True):  # fmt: skip
            step, place = divmod(number - 1, len(senders))  # each step's readings are numbered in the order of nodes
            assert senders[place] == peer
            self.arrivals.append((step + 1, peer, time))
        readings = self.memory.table("readings")
        names = ("step", "node", "reading")
        self.readings = {(step, node): z for step, node, z in zip(*(readings[name] for name in names), strict=True)}

    def heard(self, step: int, now: int) -> list[int]:
        """The nodes whose readings of a step the head had when it made the step `now`."""
        arrived = {node for at, node, time in self.arrivals if at == step and time <= now * DT + CAP}
        return sorted({self.head, *arrived})

    def filtered(self, last: int) -> np.ndarray:
        """The mean at a step of an extended Kalman filter in the order of measurement."""
        nodes = self.memory.table("nodes")
        places = np.stack([nodes["x_assumed"], nodes["y_assumed"]], axis=1)
        prior = sample_initial_conditions(cast(TrackingSetup, build(self.scenario)), 0).priors[0]
        mean, cov = prior.mean, prior.cov
        move = np.kron(np.eye(2), [[1.0, DT], [0.0, 1.0]])
        noise = np.kron(np.eye(2), 0.05 * np.outer([DT**2 / 2, DT], [DT**2 / 2, DT]))
        for step in range(1, last + 1):
            mean, cov, heard = move @ mean, move @ cov @ move.T + noise, self.heard(step, last)
            apart = mean[[0, 2]] - places[heard]
            expected = np.hypot(*apart.T)
            slopes = np.zeros((len(heard), 4))
            slopes[:, [0, 2]] = apart / expected[:, None]
            gain = np.linalg.solve(slopes @ cov @ slopes.T + VARIANCE * np.eye(len(heard)), slopes @ cov).T
            mean = mean + gain @ (np.array([self.readings[step, node] for node in heard]) - expected)
            cov = cov - gain @ slopes @ cov
        return mean

    def means(self) -> np.ndarray:
        """(K, 4) the head's estimates by step."""
        return np.stack([self.estimates[name] for name in ("px", "vx", "py", "vy")], axis=1)


@cache
def xmac_run(late: str) -> XmacRun:
    """A run that several tests look at."""
    return XmacRun(late)


def test_refiltering_agrees_with_a_filter_of_the_event_log_in_the_order_of_measurement() -> None:
    run = xmac_run("refilter")
    wanted = np.array([run.filtered(step) for step in run.estimates["step"].tolist()])
    np.testing.assert_allclose(run.means(), wanted, rtol=0, atol=1e-9)


def test_late_readings_are_counted_and_the_estimates_are_those_that_were_issued() -> None:
    run, last = xmac_run("refilter"), int(xmac_run("refilter").estimates["step"][-1])
    late = [(step, time) for step, _, time in run.arrivals if step * DT + CAP < time <= last * DT + CAP]
    assert run.memory.table("tracks")["late_readings"].tolist() == [len(late)] and len(late) > 30
    assert run.estimates["readings"].tolist() == [len(run.heard(step, step)) for step in run.estimates["step"]]
    assert (run.estimates["issued"] < run.estimates["time"] + CAP + 0.01).all()


def test_using_late_readings_costs_no_joule_of_the_radio() -> None:
    runs = [xmac_run(late) for late in ("ignore", "refilter", "retrodict")]
    radio = [run.memory.table("energy") for run in runs]
    for table in radio[1:]:
        for cause in ("tx_electronics", "rx", "overhear"):
            spent = [each["joules"][each["cause"] == CAUSE[cause]].sum() for each in (radio[0], table)]
            assert spent[0] == spent[1] > 0.0
    tracks = [run.memory.table("tracks") for run in runs]
    assert tracks[1]["late_readings"].tolist() == tracks[2]["late_readings"].tolist() != [0]
    assert not {"late_readings", "overtaken"} & tracks[0].keys(), "results without late readings are as they were"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (["tracker={kind: pf, late: retrodict}"], "pf is not one Gaussian.*refilter.*ekf, ukf, ckf"),
        (["tracker={kind: imm, late: retrodict}"], "imm is not one Gaussian"),
        (["tracker={kind: ekf, readings: nearest, late: refilter}"], "readings: all"),
        (["tracker={kind: gmtt, late: refilter}"], "late: unknown key"),
        (["network=none", "tracker={kind: ekf, late: refilter}"], "without a network"),
    ],
)
def test_what_cannot_use_late_readings_is_refused(changes, message) -> None:
    with pytest.raises(ScenarioError, match=message):
        build(wsnsim.load("central_pf", changes))
