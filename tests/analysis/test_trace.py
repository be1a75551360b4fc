"""A step is told as the rows say it: every sentence is compared with rows that a hand has written."""

from __future__ import annotations

import json

import numpy as np
import pytest

from wsnsim.analysis import event_groups, logged_events
from wsnsim.analysis.phrases import aligned, energy_in_words, listed
from wsnsim.analysis.trace import as_json, text, trace
from wsnsim.base.errors import ResultError, UsageError
from wsnsim.base.tables import CAUSE, EVENT_CAUSE, KIND
from wsnsim.network.clusters import wake_up_service
from wsnsim.recording import ResultFile

NAN = float("nan")
HEAD, START, DT = 7, 1.0, 0.5
SCENARIO = {"name": "toy", "seed": 5, "step": DT}
RUN = {
    "replicate": 0, "status": 0, "steps": 4, "rmse": 1.0, "median_error": 1.0, "lost": 0, "energy": 1.0,
    "handovers": 0, "frames_sent": 0, "frames_lost": 0, "packets_sent": 0, "in_range": 0, "delivered": 0, "collided": 0,
    "access_failures": 0, "retries": 0, "cycles": 0.0, "tracked": 1.0, "tracked_three": 1.0, "awake": 1.0, "alive": 9,
    "first_death": NAN, "half_dead": NAN, "coverage": 1.0, "cpu_seconds": 0.1, "fingerprint": 3, "event_fingerprint": 4,
    "losses": 0, "time_lost": 0.0, "lost_share": 0.0, "nees": 1.0, "nis": NAN, "lost_window": 4.0, "lost_limit": 20.0,
    "nees_median": 1.0, "singular": 0,
}  # fmt: skip
ESTIMATE = {
    "replicate": 0, "target": 0, "step": 2, "time": START, "issued": 1.02, "px": 3.0, "vx": 0.0, "py": 4.0, "vy": 0.0,
    "sd_x": 1.0, "sd_y": 1.0, "error": 5.0, "head": HEAD, "active": 3, "members": 4, "readings": 2, "received": NAN,
    "late": 0, "woken": 0, "ineffective": 0, "effective_particles": NAN, "cov_xy": 0.0,
    "nees": 25.0, "nis": NAN, "nis_dof": 0, "gaussian": 0,
}  # fmt: skip
TRUTH = {"replicate": 0, "target": 0, "step": 2, "time": START, "px": 0.0, "vx": 0.0, "py": 0.0, "vy": 0.0}


def event(kind, node, ms=0.0, what="", frame=0, peer=-1, joules=0.0, cause="none", **said):
    """One event of step 2 of replicate 0; a frame's message has the frame's number unless it is said."""
    return {
        "replicate": 0, "time": START + ms / 1e3, "step": 2, "target": 0, "node": node, "kind": KIND[kind],
        "what": what, "frame": frame, "sequence": frame, "peer": peer, "packets": int(frame > 0),
        "bits": 96 * (frame > 0), "joules": joules, "cause": EVENT_CAUSE[cause],
    } | said  # fmt: skip


def hop(frame, source, to, ms, fate="receive", packets=1, got=None, kind="send", what="reading", sequence=None):
    """The two rows of a frame over one hop: sent for 40 uJ, received (if so) for 2 uJ."""
    said = {"sequence": sequence or frame}
    heard = {"joules": 2e-6, "cause": "rx"} if fate == "receive" else {}
    sent = event(kind, source, ms, what, frame, to, 4e-5, "tx", packets=packets, **said)
    return [sent, event(fate, to, ms, what, frame, source, packets=packets if got is None else got, **said, **heard)]


@pytest.fixture
def made(tmp_path, states):
    """made(happened, estimates=..., scenario=..., wanted=...) -> the path of a result that holds them."""

    def make(
        happened, estimates=(ESTIMATE,), scenario=SCENARIO, truth=(TRUTH,), energy=(), steps=4, name="toy.h5", **wanted
    ):
        tables = dict.fromkeys(("runs", "truth", "estimates", "events", "energy_steps"), True) | wanted
        with ResultFile(tmp_path / name, states, tables, position=(0, 2)) as file:
            file.set_text("scenario/resolved_json", json.dumps(scenario))
            file.write("runs", RUN | {"steps": steps})
            rows = {"truth": truth, "estimates": estimates, "energy_steps": energy}
            rows["events"] = [row | {"what": file.words.code(row["what"])} for row in happened]
            for table, said in rows.items():
                for row in said:
                    file.write(table, row)
        return tmp_path / name

    return make


def sentences(path, **options):
    """What is told of step 2, without the times."""
    return [line.text for line in trace(path, 2, **options).lines]


def test_a_message_says_from_whom_to_whom_how_much_for_how_many_joules_and_how_it_ended(made):
    rows = [*hop(1, 12, HEAD, 1.0), *hop(2, 13, HEAD, 2.0, "collide"), *hop(3, 14, HEAD, 3.0, "drop")]
    assert sentences(made(rows)) == [
        "node 12 sent its reading to cluster head 7 (1 packet, 96 bits, 42 uJ); arrived",
        "node 13 sent its reading to cluster head 7 (1 packet, 96 bits, 40 uJ); collided at 7",
        "node 14 sent its reading to cluster head 7 (1 packet, 96 bits, 40 uJ); lost on the way",
    ]


@pytest.mark.thorough
def test_many_similar_messages_are_summed_with_how_many_fared_how_and_who_fared_badly(made):
    rows = [row for i in range(31) for row in hop(i + 1, 20 + i, HEAD, i, "collide" if i == 4 else "receive")]
    (said,) = sentences(made(rows))
    joules = 31 * 40 + 30 * 2
    assert (
        said
        == f"31 members sent their reading to cluster head 7 (31 packets, 2,976 bits, {joules / 1e3:.3g} mJ): "
        + ("30 arrived, 1 collided (24)")
    )
    assert len(sentences(made(rows, name="all.h5"), limit=31)) == 31


def test_a_node_that_sends_again_begins_another_round(made):
    rounds = [row for i in range(12) for row in hop(i + 1, 20 + i % 6, HEAD, i)]
    said = sentences(made(rounds))
    assert [one.partition(" sent")[0] for one in said] == ["6 members", "6 members"]


@pytest.mark.thorough
def test_a_relayed_message_lists_its_hops_and_where_it_was_lost(made):
    first = hop(1, HEAD, 42, 1.0, what="handover")
    arrived = hop(2, 42, 90, 2.0, kind="relay", what="handover", sequence=1)
    lost = hop(2, 42, 90, 2.0, "collide", kind="relay", what="handover", sequence=1)
    sent = "cluster head 7 sent its handover to node 90 over 42 (1 packet, 2 hops, 192 bits, "
    assert sentences(made([*first, *arrived])) == [sent + "84 uJ); arrived"]
    assert sentences(made([*first, *lost], name="lost.h5")) == [sent + "82 uJ); collided at 90"]


def test_a_message_begun_in_an_earlier_step_says_so(made):
    (said,) = sentences(made(hop(9, 42, 90, 2.0, kind="relay", what="handover", sequence=1)))
    assert said.startswith("node 42 relayed its handover to node 90, begun before this step, (1 packet")


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("what", "reason"), [("no_path", "no path exists"), ("no_channel", "channel access failed"), ("fog", "fog")]
)
def test_what_was_never_on_the_air_says_why(made, what, reason):
    (said,) = sentences(made([event("drop", 12, what=what, peer=90, packets=3)]))
    assert said.endswith(f"to node 90 (3 packets, 0 bits, 0 J); not sent: {reason}")


def of_step(step, rows):
    """Rows moved to another step, half a step away."""
    return [row | {"step": step, "time": row["time"] + (step - 2) * 0.04} for row in rows]


def test_a_message_that_began_before_or_goes_on_says_so_and_is_not_said_to_have_arrived(made):
    earlier = of_step(1, hop(1, 12, HEAD, 39.0, "collide", sequence=5))
    later = of_step(3, hop(9, 13, HEAD, 1.0, sequence=6))
    now = [*hop(2, 12, HEAD, 1.0, sequence=5), *hop(3, 13, HEAD, 30.0, "collide", sequence=6)]
    assert sentences(made([*earlier, *now, *later])) == [
        "node 12 continued to send its reading to cluster head 7 (1 packet, 96 bits, 42 uJ); arrived",
        "node 13 sent its reading to cluster head 7 (1 packet, 96 bits, 40 uJ); still on its way when the step ended",
    ]


def test_a_burst_of_several_frames_counts_the_packets_that_arrived(made):
    frames = [row for i in range(4) for row in hop(i + 1, HEAD, 12, i, "drop" if i == 1 else "receive", 9, sequence=5)]
    (said,) = sentences(made(frames))
    assert said.startswith("cluster head 7 sent its reading to node 12 (27 packets, 4 frames")
    assert said.endswith("arrived in part (3 of 4 frames)")


def test_what_never_got_the_channel_is_called_what_it_was_in_other_steps(made):
    earlier = of_step(1, hop(1, 12, HEAD, 39.0, "collide", sequence=5))
    gave_up = event("drop", 12, 2.0, "no_channel", 0, HEAD, sequence=5, packets=1)
    (said,) = sentences(made([*earlier, gave_up]))
    assert said.startswith("node 12 continued to send its reading to cluster head 7")
    assert said.endswith("not sent: channel access failed")


def test_a_broadcast_says_how_many_heard_it_and_who_did_not(made):
    sent = event("send", HEAD, 1.0, "announce", 1, joules=1e-4, cause="tx")
    heard = [event("receive", node, 1.0, "announce", 1, HEAD) for node in range(20, 34)]
    missed = [event("collide", 34, 1.0, "announce", 1, HEAD), event("drop", 35, 1.0, "announce", 1, HEAD)]
    (said,) = sentences(made([sent, *heard, *missed]))
    assert said == (
        "cluster head 7 broadcast its announcement (1 packet, 96 bits, 100 uJ); received by 14 of 16; collided at 34; "
        "lost on the way to 35"
    )


def test_frames_sent_again_are_one_message_and_acknowledgements_none(made):
    again = [*hop(1, 12, HEAD, 1.0, "collide", sequence=5), *hop(2, 12, HEAD, 4.0, sequence=5)]
    ack = hop(3, HEAD, 12, 4.4, what="ack", sequence=5)
    (said,) = sentences(made([*again, *ack]))
    assert said == (
        "node 12 sent its reading to cluster head 7 (1 packet, 2 frames, 192 bits, 124 uJ); "
        "arrived after lost frames (1 of 2 frames)"
    )


def test_strobes_and_their_acknowledgements_are_no_hops(made):
    strobes = [
        *hop(4, 3, HEAD, 0.0, "drop", what="strobe", sequence=4), *hop(5, 3, HEAD, 1.0, what="strobe", sequence=4),
        *hop(6, HEAD, 3, 1.4, what="early_ack", sequence=4), *hop(7, 3, HEAD, 2.0, sequence=4),
        *hop(8, HEAD, 3, 2.5, what="ack", sequence=4),
    ]  # fmt: skip
    assert sentences(made(strobes))[0] == (
        "node 3 sent its reading to cluster head 7 (1 packet, 2 strobes, 288 bits, 208 uJ); arrived"
    )
    assert sentences(made(strobes[:2]))[0] == (
        "node 3 sent a message to cluster head 7 (1 strobe, 96 bits, 40 uJ); strobes not answered in this step"
    )


def test_packets_that_were_lost_are_counted(made):
    (said,) = sentences(made(hop(1, 12, HEAD, 1.0, packets=47, got=37)))
    assert said.endswith("arrived in part (37 of 47 packets)")


def test_overhearing_is_summed_over_the_step(made):
    rows = [event("overhear", 30 + i % 3, i, "reading", i + 1, 12, 1e-6, "overhear") for i in range(5)]
    assert sentences(made(rows)) == ["3 nodes overheard frames for other nodes (5 receptions) (5 uJ)"]


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("row", "said"),
    [
        (event("elect", 3), "node 3 was elected cluster head"),
        (event("announce", 3), "cluster head 3 announced its cluster"),
        (event("join", 3, peer=HEAD), "node 3 joined cluster head 7"),
        (event("handover", HEAD, peer=3), "cluster head 7 started the handover to node 3"),
        (event("lost", HEAD, what="head_died"), "the track was lost: the cluster head died (cluster head 7)"),
        (event("lost", -1, what="nobody_woken"), "the track was lost: no node was woken near the predicted position"),
        (event("lost", -1, what="fog_bank"), "the track was lost: fog bank"),
        (event("acquire", 3), "node 3 initiated a track"),
        (event("leave", -1), "the target left the field"),
        (event("return", -1), "the target came back into the field"),
        (event("call", 3, joules=3e-4, cause="tx"), "node 3 sent a wake-up call (300 uJ)"),
        (event("called", 3, peer=HEAD), "node 3 was woken by a wake-up call of cluster head 7"),
        (event("drop", 3, what="expired", peer=4), "node 3 dropped a message that had expired"),
        (event("handover", HEAD, what="message", peer=3),
         "cluster head 7 handed over to node 3 by the message that woke it"),
        (event("sense", 3, what="nothing"), "node 3 sensed nothing, although it was woken for the target"),
        (event("wake", 3, what="call"), "node 3 woke, by a wake-up call"),
        (event("wake", 3, what="schedule"), "node 3 woke, by its schedule"),
        (event("sleep", 3, what="schedule"), "node 3 went to sleep, by its schedule"),
        (event("reacquire", 3), "node 3 initiated the track again, from readings"),
        (event("wake", 3, what="target"), "node 3 woke, because of a detection"),
        (event("death", 3, target=-1), "node 3 died: its battery is empty"),
        (event("crash", 3, target=-1), "node 3 crashed"),
        (event("restart", 3, target=-1), "node 3 restarted"),
        (event("fault", -1, what="blackout"), "fault 'blackout' hit nobody"),
        (event("fault", 3, what="link_loss_over"), "fault 'link loss' ended at node 3"),
        (event("fault", 3, what="drain", joules=2.5, cause="leak"), "fault 'drain' hit node 3 (2.5 J)"),
        (event("report", 3, peer=HEAD), "the sink, node 3, received the report of cluster head 7"),
        (event("report", HEAD, peer=3), "cluster head 7 reported to the sink, node 3"),
        (event("allocate", 3, what="particles", packets=9),
         "cluster head 3 allocated particles: 9 packets for other nodes"),
        (event("compute", 3, joules=2e-6, cause="cpu"), "node 3 computed (2 uJ)"),
        (event("estimate", HEAD, 20), "cluster head 7 issued the estimate of step 2, position error 5 m"),
    ],
)  # fmt: skip
def test_every_kind_of_event_has_its_sentence(made, row, said):
    assert sentences(made([row])) == [said]


@pytest.mark.thorough
def test_no_kind_of_event_is_passed_over(made):
    rows = [row for i, kind in enumerate(KIND) for row in of_step(i, [event(kind, 3, frame=i + 1, peer=4, what="fog")])]
    path = made(rows, steps=len(KIND))
    for number, kind in enumerate(KIND):
        said = [line.text for line in trace(path, number).lines]
        assert len(said) == 1 and " 3" in said[0] + " 3" * (kind in ("overhear", "leave", "return")), kind


def copy(frame, source, ms, heard, what="track", relayed=False, fates=(), sequence=1):
    """The rows of one copy of a message that wakes nodes: broadcast for 100 uJ, heard for 1 uJ each."""
    kind = "relay" if relayed else "send"
    rows = [event(kind, source, ms, what, frame, joules=1e-4, cause="tx", sequence=sequence)]
    got = {"joules": 1e-6, "cause": "rx"}
    rows += [event("receive", node, ms, what, frame, source, sequence=sequence, **got) for node in heard]
    return rows + [event(fate, node, ms, what, frame, source, sequence=sequence) for node, fate in fates]


def call(caller, ms, *woken):
    """The rows of a call on the wake-up radio, for 50 uJ, and 20 uJ at each who is woken."""
    rows = [event("call", caller, ms, joules=5e-5, cause="tx", packets=1, bits=96)]
    return rows + [
        event("called", node, ms, peer=caller, joules=2e-5, cause="rx", packets=1, bits=96) for node in woken
    ]


def test_a_flood_is_one_act_with_who_started_it_who_handed_it_on_and_whom_it_woke(made):
    late = event("drop", 30, 9.0, "expired", peer=14, sequence=1)
    rows = [
        *copy(1, HEAD, 1.0, (12, 13), fates=((15, "collide"), (16, "drop"))),
        *copy(2, 12, 3.0, (HEAD, 14, 15), relayed=True),
        *call(13, 6.0, 20, 21),
        *copy(3, 14, 5.0, (12, 30), relayed=True),
        *call(20, 11.0, 22),
        late,
    ]
    joules = 3 * 100 + 7 * 1 + 2 * 50 + 3 * 20
    assert sentences(made(rows)) == [
        f"cluster head 7 broadcast its wake-up message (1 packet, 3 frames, 288 bits, {joules} uJ)"
        "; forwarded by 2 nodes (12, 14); received by 6"
        "; 2 nodes (13, 20) sent a wake-up call, which woke 3: 20, 21, 22; lost at 16"
        "; expired at 30"
    ]


def test_a_flood_that_began_in_an_earlier_step_says_so(made):
    earlier = of_step(1, copy(1, HEAD, 39.0, (12,)))
    (said,) = sentences(made([*earlier, *copy(2, 12, 1.0, (13,), relayed=True), *copy(3, 13, 2.0, (), relayed=True)]))
    assert said.startswith("node 12 forwarded, begun before this step, its wake-up message (1 packet, 2 frames, ")
    assert "; forwarded by node 13; received by 1" in said


def test_every_flood_is_told_by_itself_however_many_there_are(made):
    floods = [row for i in range(6) for row in copy(2 * i + 1, 40 + i, i, (12,), sequence=i + 1)]
    assert len(sentences(made(floods, name="plain.h5"))) == 1
    rows = [*floods, *[row for i in range(6) for row in call(40 + i, i + 0.5, 60 + i)]]
    assert [said.rpartition(" ")[2] for said in sentences(made(rows))] == [str(60 + i) for i in range(6)]


@pytest.mark.thorough
def test_a_call_belongs_to_the_nearest_message_that_its_caller_knows_and_to_none_that_it_does_not(made):
    two = [*copy(1, HEAD, 1.0, (12,)), *copy(2, 50, 4.0, (12, 51), sequence=2)]
    first, second = sentences(made([*two, *call(12, 2.0, 20), *call(51, 2.0, 21)]))
    assert first.endswith("node 12 sent a wake-up call, which woke 1: 20")
    assert second.endswith("node 51 sent a wake-up call, which woke 1: 21")
    said = sentences(made([*two, *call(99, 2.0, 22), *call(12, 3.9)], name="strange.h5"))
    assert said[1:3] == [
        "node 99 sent a wake-up call (50 uJ)",
        "node 22 was woken by a wake-up call of node 99 (20 uJ)",
    ]
    assert said[3].endswith("node 12 sent a wake-up call, which woke no node")


def test_who_is_called_for_a_letter_is_not_woken_by_the_flood(made):
    rows = [*copy(1, HEAD, 1.0, (12,)), *call(HEAD, 2.0, 90), *hop(5, HEAD, 90, 3.0, what="report")]
    assert sentences(made(rows))[1:3] == [
        "cluster head 7 sent a wake-up call (50 uJ)",
        "node 90 was woken by a wake-up call of cluster head 7 (20 uJ)",
    ]


def test_calls_that_go_before_their_broadcast_are_of_the_same_act(made):
    (line,) = trace(made([*call(HEAD, 1.0, 20), *copy(1, HEAD, 5.0, (12, 20), "invitation")]), 2).lines
    assert (line.time, line.until) == (START + 1e-3, START + 5e-3)
    assert line.text.startswith("cluster head 7 broadcast its invitation (")


def test_a_message_that_wakes_nodes_is_called_what_the_network_calls_it():
    assert set(event_groups.WAKE_UP_MESSAGES) == set(wake_up_service.MESSAGE_NAMES.values())


def test_the_json_of_a_flood_has_who_was_woken(made):
    answer = as_json(trace(made([*copy(1, HEAD, 1.0, (12,)), *call(12, 2.0, 20)]), 2))
    (message,) = answer["messages"]
    assert (message["callers"], message["woken"], message["expired"]) == ([12], [20], [])
    json.dumps(answer)


def test_sentences_stand_in_the_order_of_time_in_ms_after_the_start(made):
    rows = [*hop(1, 12, HEAD, 3.0), *hop(2, 13, HEAD, 5.5), event("sense", 12, 0.0), event("estimate", HEAD, 20.0)]
    lines = text(trace(made(rows), 2)).splitlines()
    first = lines.index("    ms") + 1
    told = lines[first : lines.index("", first)]
    assert [line.split()[0] for line in told] == ["0.000", "3.000", "5.500", "20.000"]


def _unwrapped(said):
    """A text without the line breaks of a terminal."""
    return " ".join(said.split())


@pytest.mark.thorough
def test_the_estimate_says_where_how_far_off_when_and_from_what(made):
    assert (
        "estimate px 3 m, py 4 m: position error 5 m, issued by cluster head 7 20.000 ms after the start "
        "of the step; 3 of 4 members sensed, "
        "2 readings used"
    ) in _unwrapped(text(trace(made([]), 2)))
    late = ESTIMATE | {"issued": 1.6, "late": 1, "received": 1.7}
    said = _unwrapped(text(trace(made([], [late], name="late.h5"), 2)))
    assert (
        "600.000 ms after the start of the step, late by 100 ms;" in said
        and "at the sink 700.000 ms after the start" in said
    )
    none = ESTIMATE | {"issued": NAN, "error": NAN}
    assert "  no estimate of this step; cluster head: node 7" in text(trace(made([], [none], name="none.h5"), 2))
    nobody = none | {"head": -1}
    assert "  no estimate of this step; no cluster head" in text(trace(made([], [nobody], name="nobody.h5"), 2))


def test_the_cost_is_that_of_the_step_alone_by_cause(made):
    energy = [
        {"replicate": 0, "step": step, "time": step * DT, "cause": CAUSE[cause], "joules": joules}
        for step, cause, joules in ((1, "rx", 9.0), (2, "rx", 2e-6), (2, "idle", 1e-3), (3, "rx", 9.0))
    ]
    picked = trace(made(hop(1, 12, HEAD, 1.0), energy=energy), 2)
    assert picked.energy == {"rx": 2e-6, "idle": 1e-3}
    assert picked.booked == {"tx": 4e-5, "rx": 2e-6}
    assert text(picked).splitlines()[-2:] == [
        "the network spent 1 mJ: rx 2 uJ, idle 1 mJ",
        "the events above account for 42 uJ: tx 40 uJ, rx 2 uJ",
    ]


@pytest.mark.thorough
def test_one_target_of_several_is_told_with_what_concerns_none(made):
    other = event("elect", 4, target=1)
    rows = [event("elect", 3), other, event("crash", 5, target=-1)]
    both = made(rows, [ESTIMATE, ESTIMATE | {"target": 1}])
    assert sentences(both) == [
        "node 3 was elected cluster head (target 0)",
        "node 4 was elected cluster head (target 1)",
        "node 5 crashed",
    ]
    assert sentences(both, target=1) == ["node 4 was elected cluster head (target 1)", "node 5 crashed"]


@pytest.mark.thorough
def test_only_the_rows_of_the_step_and_replicate_are_told_however_they_are_read(made, monkeypatch):
    strange = [event("elect", 1, step=1), event("elect", 2), event("elect", 3, step=3), event("elect", 4, replicate=1)]
    path = made([*strange, event("elect", 5)])
    for block in (1, 2, 3, 100):
        monkeypatch.setattr(logged_events, "BLOCK", block)
        assert [row.node for row in logged_events.rows_at(path, 0, 2)] == [2, 5]


def test_the_json_holds_the_messages_frame_by_frame(made):
    answer = as_json(trace(made([*hop(1, 12, HEAD, 1.0), event("sense", 12)]), 2))
    (message,) = answer["messages"]
    assert message["path"] == (12, HEAD) and message["frames"][0]["received"] == {HEAD: 1}
    assert [act["nodes"] for act in answer["acts"]] == [[12]]
    assert answer["targets"][0]["estimate"]["error"] == 5.0
    json.dumps(answer)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"step": 5}, "replicate 0 has steps 0 to 4, not 5"),
        ({"step": 2, "replicate": 3}, "no replicate 3; it has 0"),
        ({"step": 2, "target": 9}, "no target 9; it has 0"),
    ],
)
def test_what_is_not_there_is_named(made, options, said):
    path = made([])
    with pytest.raises(UsageError, match=said):
        trace(path, **options)


def test_a_result_without_events_says_how_to_record_them(made):
    with pytest.raises(ResultError, match=r"record\.events=true"):
        trace(made([], events=False), 2)


def test_without_a_network_there_are_the_truth_the_estimate_and_the_readings(made):
    bench = made([], scenario=SCENARIO | {"network": "none"}, events=False)
    assert text(trace(bench, 2)).splitlines()[2:] == [
        "target 0 is at px 0 m, py 0 m",
        "  estimate px 3 m, py 4 m: position error 5 m, from 2 readings",
        "no network: nothing was sent and no energy was spent",
    ]


def test_a_network_without_a_target_is_told_too(tmp_path):
    with ResultFile(tmp_path / "b.h5", (), {"runs": True, "events": True}) as file:
        file.set_text("scenario/resolved_json", json.dumps(SCENARIO))
        file.write("runs", RUN)
        code = file.words.code("beacon")
        for row in (event("send", 3, what=code, frame=1), event("receive", 4, what=code, frame=1, peer=3)):
            file.write("events", row | {"sequence": 0, "target": -1})
    assert sentences(tmp_path / "b.h5") == ["node 3 broadcast its beacon (1 packet, 96 bits, 0 J); received by 1 of 1"]


def test_numbers_are_said_with_three_digits_and_a_fitting_prefix():
    values = (0.0, 6.24e-5, 9.9996e-4, 1.0, 2500.0, 3e-9, 2.5e-3)
    assert [energy_in_words(value) for value in values] == [
        "0 J",
        "62.4 uJ",
        "1 mJ",
        "1 J",
        "2,500 J",
        "3 nJ",
        "2.5 mJ",
    ]
    assert listed(np.arange(30).tolist()).endswith("22, 23 and 6 more")


def test_a_target_that_leaves_the_field_is_the_subject_of_its_event():
    rows = [
        logged_events.LoggedEvent(1.0, 2, 0, -1, kind, "", 0, 0, -1, 0, 0, 0.0, "")
        for kind in ("leave", "return", "lost")
    ]
    assert [logged_events.row_in_words(row) for row in rows] == [
        "the target: leave target 0", "the target: return target 0", "nobody: lost target 0",
    ]  # fmt: skip


def test_no_cell_of_a_table_grows_when_it_is_cut() -> None:
    for left in range(1, 12):
        (line,) = aligned([["tracker.particles = 1000"] * left + ["1.0"]], left)
        assert len(line) <= len("  ".join(["", *["tracker.particles = 1000"] * left, "1.0"]))
