import random

import numpy as np

from wsnsim.base.tables import Memory
from wsnsim.network.event_log import EACH, NAMES, EventLog, event


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
