import numpy as np
import pytest

from wsnsim.base.requests import Broadcast, Compute, Gather, Local, Member, Parcel, Scatter, Send
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
