import numpy as np
import pytest

from wsnsim.base.requests import (
    PACKET_BITS,
    Broadcast,
    Compute,
    Gather,
    GatherReadings,
    Local,
    Member,
    Parcel,
    Scatter,
    Send,
    all_arrived,
)
from wsnsim.offline.loopback import perfect, perform, silent


def cluster():
    members = {i: Member(i, np.zeros(2), np.ones(1), reading=10.0 * i, key=i) for i in (4, 7, 9)}
    members[9].reading = None
    return members


def everything(log):
    log.append(("local", (yield Local(work=lambda m: m.memory.update(double=2 * m.reading)))))
    log.append(("gather", (yield Gather(lambda m: Parcel(m.memory["double"], 1, 96, "double")))))
    log.append(("scatter", (yield Scatter({i: Parcel(i, 2, 96, "mine") for i in (4, 7, 9)}))))
    log.append(("broadcast", (yield Broadcast(Parcel("all", 1, 96, "all")))))
    log.append(("send", (yield Send(99, Parcel("far", 3, 96, "far")))))
    log.append(("compute", (yield Compute(10.0))))
    return "belief"


def test_a_perfect_loopback_answers_as_the_table_of_asks_says():
    log, members = [], cluster()
    assert perform(everything(log), members, head=4, lose=perfect) == "belief"
    answers = dict(log)
    assert answers["local"] == (4, 7)
    assert {i: payload for i, (payload, _) in answers["gather"].items()} == {4: 80.0, 7: 140.0}
    assert sorted(answers["scatter"]) == [4, 7, 9]
    assert sorted(answers["broadcast"]) == [7, 9]
    assert answers["send"].tolist() == [True] * 3
    assert answers["compute"] is None
    assert [d.what for d in members[7].take_inbox()] == ["mine", "all"]
    assert members[7].inbox == []


def test_a_silent_loopback_gives_empty_answers_but_a_head_still_hears_itself():
    log, members = [], cluster()
    perform(everything(log), members, head=4, lose=silent)
    answers = dict(log)
    assert list(answers["gather"]) == [4]
    assert list(answers["scatter"]) == [4]
    assert answers["broadcast"] == {}
    assert not answers["send"].any()


def test_an_ask_may_address_members_that_do_not_sense():
    def flow():
        return (yield Local(work=lambda m: None, who=(9, 7, 1234)))

    assert perform(flow(), cluster(), head=4) == (9, 7)


@pytest.mark.parametrize("lose", [perfect, silent])
def test_a_watcher_sees_every_ask(lose):
    seen = []
    perform(everything([]), cluster(), head=4, lose=lose, before=seen.append)
    assert [type(ask).__name__ for ask in seen] == ["Local", "Gather", "Scatter", "Broadcast", "Send", "Compute"]


def lossy(source, to, parcel):
    """Odd nodes are heard."""
    return all_arrived(1) if source % 2 else np.zeros(1, dtype=np.bool_)


@pytest.mark.parametrize("lose", [perfect, silent, lossy])
@pytest.mark.parametrize("who", [None, (9, 7, 1234), ()])
def test_gathered_readings_are_those_of_a_gather_of_the_same_parcels(lose, who):
    def readings():
        return (yield GatherReadings(who=who))

    def parcels():
        return (yield Gather(lambda m: None if m.reading is None else Parcel(m.reading, 1, PACKET_BITS, "x"), who))

    found = perform(readings(), cluster(), head=4, lose=lose)
    expected = perform(parcels(), cluster(), head=4, lose=lose)
    assert dict(zip(found.ids, found.values.tolist(), strict=True)) == {i: value for i, (value, _) in expected.items()}
    assert found.ids == tuple(expected) and found.masks.tolist() == [mask.tolist() for _, mask in expected.values()]


@pytest.mark.parametrize("lose", [perfect, lossy])
def test_a_reading_that_is_not_finite_is_not_sent(lose):
    members = cluster()
    members[7].reading = float("nan")

    def flow():
        return (yield GatherReadings())

    found = perform(flow(), members, head=4, lose=lose)
    assert found.ids == (4,) and found.values.tolist() == [40.0]


@pytest.mark.parametrize("lose", [perfect, lossy])
@pytest.mark.parametrize("deadline", [None, 0.0])
def test_without_a_network_parcels_take_no_time_and_one_hop_and_the_head_s_own_none(lose, deadline):
    answers = []

    def flow():
        answers.append((yield Gather(lambda m: Parcel(m.id, 1, 96, "id"), deadline=deadline)))
        answers.append((yield GatherReadings(deadline=deadline)))

    perform(flow(), cluster(), head=4, lose=lose)
    parcels, readings = answers
    assert parcels.delays == {4: 0.0, 7: 0.0} and parcels.hops == {4: 0, 7: 1}
    assert parcels == {4: (4, parcels[4][1]), 7: (7, parcels[7][1])}, "it is a dictionary"
    assert readings.ids == (4, 7)
    assert readings.delays.tolist() == [0.0, 0.0] and readings.hops.tolist() == [0, 1]
