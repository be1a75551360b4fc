import random

import numpy as np
import pytest

from wsnsim.base.frames import SEND
from wsnsim.base.tables import KIND, Memory
from wsnsim.network.energy.ledger import HopCost
from wsnsim.network.event_log import CHUNK, EACH, NAMES, RX, TX, EventLog, UnicastRows, event


def random_events(count: int) -> list:
    rng = random.Random(3)
    return [
        event(k // 7 * 0.04, k // 7, 0, rng.randrange(256), rng.randrange(20), 1, k, k, rng.randrange(-1, 256), 1, 96)
        for k in range(count)
    ]


def fingerprint(events: list, recorded: bool = True, flush_every: int = 10**9) -> int:
    log = EventLog(Memory({"events": recorded}), 0)
    for k, row in enumerate(events):
        log.add(row)
        if k % flush_every == 0:
            log.flush(everything=True)
    return log.fingerprint()


def test_the_parameters_of_event_are_the_columns_of_the_table_in_their_order():
    values = dict(zip(NAMES, range(1, len(NAMES) + 1), strict=True))
    assert event(**values) == tuple(values.values())


def test_the_fingerprint_does_not_depend_on_the_order_at_equal_times_nor_on_recording_nor_on_chunks():
    events = random_events(500)
    shuffled = events[:]
    random.Random(1).shuffle(shuffled)
    assert (
        fingerprint(events)
        == fingerprint(shuffled)
        == fingerprint(events, recorded=False)
        == fingerprint(events, flush_every=13)
    )


def test_the_fingerprint_depends_on_each_of_time_node_kind_peer_and_bits():
    events = random_events(50)
    seen = {fingerprint(events)}
    for name in ("time", "node", "kind", "peer", "bits"):
        changed = list(events[20])
        changed[NAMES.index(name)] += 1
        seen.add(fingerprint([*events[:20], tuple(changed), *events[21:]]))
    assert len(seen) == 6


def test_an_event_that_is_logged_twice_more_changes_the_fingerprint():
    events = random_events(10)
    assert fingerprint([*events, events[0], events[0]]) != fingerprint(events)


def test_all_events_reach_the_recorder_in_order():
    memory = Memory()
    log = EventLog(memory, 4)
    events = random_events(20_000)
    for row in events:
        log.add(row)
        log.flush()
    log.fingerprint()
    table = memory.table("events")
    assert table["time"].tolist() == [row[0] for row in events]
    assert table["node"].tolist() == [row[3] for row in events]
    assert set(table["replicate"]) == {4}


def test_an_event_that_nodes_share_becomes_one_row_for_each_of_them():
    memory = Memory()
    log = EventLog(memory, 0)
    log.add(event(0.0, 0, 0, 1, 2))
    log.add_all(event(0.5, 0, 0, EACH, 3), np.array([4, 6]))
    log.add(event(1.0, 1, 0, 7, 2))
    log.fingerprint()
    table = memory.table("events")
    assert table["node"].tolist() == [1, 4, 6, 7]
    assert table["kind"].tolist() == [2, 3, 3, 2]


@pytest.mark.parametrize("recorded", [True, False])
def test_unicasts_that_are_logged_together_are_the_events_of_each_in_turn(recorded: bool) -> None:
    """Between other events, shared ones among them; of unicasts that arrive within the instant."""
    costs = [HopCost(96, 1.0, 2.0, 3.0, 0.5), HopCost(192, 2.0, 1.5, 3.5, 1.0), HopCost(96, 1.0, 2.0, 3.0, 0.5)]
    first, last = event(0.0, 0, 0, 1, 2), event(1.0, 1, 0, 7, 2)
    shared, nodes = event(0.5, 0, 0, EACH, 3), np.array([4, 6])

    def log_of(memory: Memory, together: bool) -> EventLog:
        log = EventLog(memory, 0)
        log.add(first)
        for time, number in ((0.25, 11), (0.75, 14)):
            if together:
                lists = [5, 6, 9], [2, 2, 5], [1, 1, 4], [1, 2, 1]
                log.add_unicasts(UnicastRows(time, 3, 1, number, *lists, costs))
            else:
                for k, (source, to, code, packets) in enumerate([(5, 2, 1, 1), (6, 2, 1, 2), (9, 5, 4, 1)]):
                    frame = code, number + k, number + k
                    cost = costs[k]
                    log.add(event(time, 3, 1, source, SEND, *frame, to, packets, cost.bits, cost.sent, TX))
                    log.add(event(time, 3, 1, to, KIND["receive"], *frame, source, packets, cost.bits, cost.rx, RX))
            log.add_all(shared, nodes)
        log.add(last)
        return log

    one, other = Memory({"events": recorded}), Memory({"events": recorded})
    assert log_of(one, True).fingerprint() == log_of(other, False).fingerprint()
    if recorded:
        columns, twins = one.table("events"), other.table("events")
        assert columns["node"].size == 18
        for name, values in columns.items():
            assert values.tobytes() == twins[name].tobytes(), name


def test_unicasts_are_written_before_they_fill_the_memory() -> None:
    memory = Memory()
    log = EventLog(memory, 0)
    many = CHUNK // 2
    costs = [HopCost(96, 1.0, 2.0, 3.0, 0.5)] * many
    log.add_unicasts(UnicastRows(0.0, 0, 0, 1, [1] * many, [2] * many, [0] * many, [1] * many, costs))
    assert memory.table("events")["frame"].tolist() == np.arange(1, many + 1).repeat(2).tolist()
