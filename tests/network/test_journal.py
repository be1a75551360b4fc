import random

from wsnsim.base.tables import Memory
from wsnsim.network.event_log import NAMES, EventLog


def rows(count: int) -> list:
    rng = random.Random(3)
    return [
        (
            k // 7 * 0.04,
            k // 7,
            0,
            rng.randrange(256),
            rng.randrange(20),
            1,
            k,
            k,
            rng.randrange(-1, 256),
            1,
            96,
            1e-6,
            1,
        )
        for k in range(count)
    ]


def fingerprint(events: list, wanted: bool = True, drain_every: int = 10**9) -> int:
    journal = EventLog(Memory({"events": wanted}), 0)
    for k, event in enumerate(events):
        journal.add(event)
        if k % drain_every == 0:
            journal.drain(everything=True)
    return journal.fingerprint()


def test_the_fingerprint_does_not_depend_on_the_order_at_equal_times_nor_on_recording_nor_on_chunks():
    events = rows(500)
    shuffled = events[:]
    random.Random(1).shuffle(shuffled)
    assert (
        fingerprint(events)
        == fingerprint(shuffled)
        == fingerprint(events, wanted=False)
        == fingerprint(events, True, 13)
    )


def test_the_fingerprint_sees_every_one_of_time_node_kind_peer_and_bits():
    events = rows(50)
    seen = {fingerprint(events)}
    for name in ("time", "node", "kind", "peer", "bits"):
        changed = list(events[20])
        changed[NAMES.index(name)] += 1
        seen.add(fingerprint([*events[:20], tuple(changed), *events[21:]]))
    assert len(seen) == 6


def test_an_event_twice_is_not_an_event_never():
    events = rows(10)
    assert fingerprint([*events, events[0], events[0]]) != fingerprint(events)


def test_rows_reach_the_recorder_in_order_and_whole():
    memory = Memory()
    journal = EventLog(memory, 4)
    events = rows(20_000)
    for event in events:
        journal.add(event)
        journal.drain()
    journal.fingerprint()
    table = memory.table("events")
    assert table["time"].tolist() == [event[0] for event in events]
    assert table["node"].tolist() == [event[3] for event in events]
    assert set(table["replicate"]) == {4}
