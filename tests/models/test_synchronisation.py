"""What scenarios with time synchronisation are told."""

import pytest

from tests.network.clock_networks import BASE
from wsnsim.base.errors import ScenarioError
from wsnsim.scenario import build, load


def issues(**changes):
    try:
        build(load({**BASE, "sync": {"kind": "ftsp"}, **changes}))
    except ScenarioError as error:
        return [str(issue) for issue in error.issues]
    return []


def test_the_defaults_and_those_of_the_paper_are_accepted():
    assert issues() == [] and issues(sync={"kind": "ftsp", "period": "30 s", "jitter": "1.48 us"}) == []


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (
            {"clock": {"kind": "perfect"}},
            "sync.kind: error: every clock shows the true time (clock: perfect): there is",
        ),
        ({"sync": {"kind": "ftps"}}, "sync.kind: error: unknown sync 'ftps' (did you mean 'ftsp'?)"),
        ({"sync": {"kind": "ftsp", "period": "0 s"}}, "sync.period: error: "),
        ({"sync": {"kind": "ftsp", "jitter": "3 m"}}, "sync.jitter: error: "),
        (
            {"sync": {"kind": "ftsp", "entries": 3}},
            "sync.entries_to_sync: error: a node never has 4 reference points: sync.entries is 3",
        ),
        (
            {"mac": {"kind": "csma"}, "sync": {"kind": "ftsp", "bits": 1000}},
            "sync.bits: error: a frame holds at most 928 bits, and a message 1000",
        ),
        (
            {"mac": {"kind": "csma", "rate": 1000.0, "ack_wait": 1.0}, "sync": {"kind": "ftsp", "period": 0.1}},
            "sync.period: error: a message takes 0.208 s, more than its period",
        ),
    ],
)
def test_what_cannot_be_is_refused_at_its_place(changes, said):
    assert any(said in one for one in issues(**changes)), issues(**changes)


def test_a_clock_that_a_fault_steps_can_be_synchronised_though_it_does_not_drift():
    step = [{"kind": "clock_step", "at": 100.0, "nodes": [2], "offset": 0.5}]
    assert issues(clock={"kind": "perfect"}, faults=step) == []
    assert "has no effect" in issues(clock={"kind": "perfect"}, faults=step, sync={"kind": "none"})[0]
