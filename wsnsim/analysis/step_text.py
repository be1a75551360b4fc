"""What happened in a step, as sentences: acts of nodes, and messages with what became of them.

told(acts, speaker) -> [Sentence] in the order of time;   outcome(message) -> how it fared, in a few words
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence

from wsnsim.analysis.event_groups import NodeAction
from wsnsim.analysis.messages import LoggedBurst, LoggedMessage
from wsnsim.analysis.phrases import (
    LOSSES,
    OF_NODES,
    PARCELS,
    REASONS,
    SPEECH,
    Sentence,
    StepContext,
    counted,
    energy_in_words,
    named,
)


def told(acts: Iterable[NodeAction | LoggedMessage], speaker: StepContext) -> list[Sentence]:
    """The sentences of a step in the order of time; many similar messages become one."""
    acts = list(acts)
    messages = [act for act in acts if isinstance(act, LoggedMessage)]
    place = {id(group[0]): group for group in _groups(messages)}
    lines: list[Sentence] = []
    for act in acts:
        if isinstance(act, NodeAction):
            lines.append(Sentence(act.time, act.until, _act(act, speaker)))
        elif id(act) in place:
            lines += _messages(place[id(act)], speaker)
    return sorted(lines, key=lambda line: line.time)


def _act(act: NodeAction, speaker: StepContext) -> str:
    several = len(act.nodes) > 1
    who = f"{len(set(act.nodes)):,} nodes" if several else speaker.node(act.nodes[0]) if act.nodes[0] >= 0 else "nobody"
    names = f": {named(act.nodes)}" if several else ""
    paid = f" ({energy_in_words(act.joules)})" if act.joules else ""
    if act.kind in SPEECH:
        verb, after = SPEECH[act.kind]
        return f"{who} {verb}{after.get(act.what, '')}{speaker.of(act.target)}{paid}{names}"
    said = _deed(act, who, speaker)
    return (
        f"{said}{'' if act.kind == 'fault' else speaker.of(act.target)}{paid}{names if act.kind != 'overhear' else ''}"
    )


def _deed(act: NodeAction, who: str, speaker: StepContext) -> str:
    """An act of one node as a rule, or with another."""
    what, peer = act.what.replace("_", " "), speaker.node(act.peer)
    told_by_kind = {
        "overhear": f"{who} overheard what was not for them ({counted(act.count, 'frame')} at a node each)",
        "elect": f"{who} was elected head",
        "announce": f"{who} announced its cluster",
        "join": f"{who} joined {peer}",
        "allocate": f"{who} dealt out {what or 'its belief'}: {counted(act.packets, 'packet')} for others",
        "estimate": f"{who} issued {speaker.issued.get((act.target, act.time), 'an estimate')}",
        "handover": f"{who} handed over to {peer}, by the message that woke it"
        if act.what == "message"
        else f"{who} began to hand over to {peer}",
        "lost": f"the track was lost: {LOSSES.get(act.what, what) or 'no reason given'}"
        + (f" ({who})" if act.nodes[0] >= 0 else ""),
        "reacquire": f"{who} began the track anew, from readings",
        "acquire": f"{who} took up a target that nobody had followed",
        "call": f"{who} called on the wake-up radio",
        "called": f"{who} {'were' if len(act.nodes) > 1 else 'was'} woken by a call of {peer}",
        "leave": "the target left the field",
        "return": "the target came back into the field",
        "report": _report(act, who, speaker),
    }
    if act.kind == "fault":
        ended = act.what.endswith("_over")
        name = what.removesuffix(" over") or "unnamed"
        return f"fault '{name}' ended at {who}" if ended else f"fault '{name}' hit {who}"
    return told_by_kind.get(act.kind, " ".join(filter(None, (who, act.kind, what))))


def _report(act: NodeAction, who: str, speaker: StepContext) -> str:
    """The sink has a head's report, or a head sends it: whichever of the two the event is of."""
    if act.nodes[0] in speaker.heads or act.peer < 0:
        return f"{who} reported to the sink" + (f", node {act.peer}" if act.peer >= 0 else "")
    return f"the sink, {who}, had the report of {speaker.node(act.peer)}"


def _parcel(what: str, several: bool) -> str:
    """What a parcel is called, of one sender or of several."""
    if not what:
        return ("a message", "messages")[several]
    words = what.replace("_", " ")
    return PARCELS.get(what, (f"its {words}", f"their {words}"))[several]


def outcome(message: LoggedMessage) -> str:
    """What became of a unicast message in a few words, alike for all that fared alike."""
    if not message.frames:
        return f"not sent: {_reason(message.ended)}" if message.ended else "nothing of it in this step"
    hop = message.hop
    arrived = [frame for frame in hop if frame.arrived]
    if message.ended or (not arrived and not message.goes_on):
        lost = "arrived in part" if arrived else _loss(hop)
        return f"{lost}, then given up: {_reason(message.ended)}" if message.ended else lost
    if message.goes_on:
        return "still under way when the step ends"
    if len(arrived) == len(hop):
        return "arrived" if _got(hop) >= sum(frame.packets for frame in hop) else "arrived in part"
    if len(arrived) == 1 and hop[-1].arrived:
        return "arrived after lost frames"
    return "arrived in part"


def _reason(word: str) -> str:
    return REASONS.get(word, word.replace("_", " "))


def _loss(hop: Sequence[LoggedBurst]) -> str:
    last = hop[-1]
    return "collided" if last.collided else "lost on the way" if last.dropped else "cut short"


def _got(hop: Sequence[LoggedBurst]) -> int:
    return sum(frame.received.get(frame.to, 0) for frame in hop)


def _groups(messages: Sequence[LoggedMessage]) -> list[list[LoggedMessage]]:
    """Messages of one kind to one node, from one node, or to everyone; one that repeats begins another round."""
    to = Counter((one.what, one.target, one.path[-1]) for one in messages)
    by = Counter((one.what, one.target, one.source) for one in messages)
    groups: list[list[LoggedMessage]] = []
    current: dict[tuple[object, ...], tuple[list[LoggedMessage], set[int]]] = {}
    for one in messages:
        goal = one.path[-1]
        gathers = to[one.what, one.target, goal] >= by[one.what, one.target, one.source]
        side = _side(one, gathers)
        key, other = (one.what, one.target, side, one.begun), one.source if one.is_broadcast or gathers else goal
        group, others = current.get(key, ([], set()))
        if not group or other in others:
            group, others = current[key] = [], set()
            groups.append(group)
        group.append(one)
        others.add(other)
    return groups


def _side(one: LoggedMessage, gathers: bool) -> tuple[str, int]:
    """What messages of one group have in common: a flood stands alone."""
    if one.is_broadcast:
        return ("flood", id(one)) if one.is_flood else ("all", 0)
    return ("to", one.path[-1]) if gathers else ("from", one.source)


def _messages(group: list[LoggedMessage], speaker: StepContext) -> list[Sentence]:
    if len(group) <= speaker.limit or len(group) == 1:
        return [Sentence(one.time, one.until, _message(one, speaker)) for one in group]
    text = _broadcasts(group) if group[0].is_broadcast else _sum(group, speaker)
    return [Sentence(group[0].time, max(one.until for one in group), text + speaker.of(group[0].target))]


def _message(one: LoggedMessage, speaker: StepContext) -> str:
    what = _parcel(one.what, False)
    text = f"{speaker.node(one.source)} "
    if one.is_flood:
        return _flood(one, speaker)
    if one.is_broadcast:
        return f"{text}broadcast {what} {_facts([one])}; {_heard(one)}{speaker.of(one.target)}"
    path = one.path
    text += "sent " if one.begun else "passed on " if one.relayed else "went on with "
    text += f"{what} to {speaker.node(path[-1] if len(path) > 1 else one.to)}"
    text += f" over {', '.join(str(node) for node in path[1:-1])}" if len(path) > 2 else ""
    text += "" if one.begun or not one.relayed else ", begun before this step,"
    return f"{text} {_facts([one])}; {_fate(one, speaker)}{speaker.of(one.target)}"


def _flood(one: LoggedMessage, speaker: StepContext) -> str:
    """A message that wakes nodes as one act: who started it, who handed it on, whom it reached, and whom it woke."""
    begun = "broadcast" if one.begun else "handed on, begun before this step," if one.relayed else "went on with"
    facts = [f"{speaker.node(one.source)} {begun} {_parcel(one.what, False)} {_facts([one])}"]
    if one.forwarders:
        facts.append(f"handed on by {_those(one.forwarders, speaker)}")
    heard = len(one.heard)
    facts.append(f"heard by {heard}" if heard else "nobody was there to hear it")
    if one.callers:
        callers, woken = _those(one.callers, speaker), len(one.woken)
        facts.append(f"{callers} called on the wake-up radio, which woke {woken or 'nobody'}")
        facts[-1] += f": {named(one.woken)}" if woken else ""
    for nodes, words in ((_missed(one), "lost at"), (one.expired, "expired at")):
        facts += [f"{words} {named(nodes)}"] if nodes else []
    return "; ".join(facts) + (f"; not sent: {_reason(one.ended)}" if one.ended else "") + speaker.of(one.target)


def _those(nodes: Sequence[int], speaker: StepContext) -> str:
    """One node by its role, or several by their numbers."""
    return speaker.node(nodes[0]) if len(nodes) == 1 else f"{len(nodes)} nodes ({named(nodes)})"


def _missed(one: LoggedMessage) -> list[int]:
    """Who was within reach of a frame of a broadcast, and got none."""
    touched = {node for frame in one.frames for node in (*frame.collided, *frame.dropped)}
    return sorted(touched - one.heard - {one.source, *one.forwarders})


def _fate(one: LoggedMessage, speaker: StepContext) -> str:
    """How a unicast message fared, in detail."""
    said = outcome(one)
    if not one.frames:
        return said
    hop, last = one.hop, one.hop[-1]
    arrived = sum(frame.arrived for frame in hop)
    if arrived < len(hop) and len(hop) > 1:
        said += f" ({arrived} of {len(hop)} frames)"
    elif said.startswith("arrived in part"):
        said += f" ({_got(hop)} of {sum(frame.packets for frame in hop)} packets)"
    if not arrived and not one.goes_on:
        said += f" at {last.to}" if last.collided else f" from {last.source} to {last.to}" if len(one.path) > 2 else ""
    return said


def _facts(group: Sequence[LoggedMessage]) -> str:
    """How much was sent, and what that cost all who sent and listened."""
    frames = sum(len(one.frames) for one in group)
    hops = len(group[0].path) - 1 if len(group) == 1 and not group[0].is_broadcast else 1
    facts = [counted(sum(one.packets for one in group), "packet")]
    facts += [counted(hops, "hop")] if hops > 1 else []
    facts += [counted(frames, "frame")] if frames > max(hops, len(group)) else []
    facts += [counted(sum(one.bits for one in group), "bit"), energy_in_words(sum(one.joules for one in group))]
    return f"({', '.join(facts)})"


def _sum(group: Sequence[LoggedMessage], speaker: StepContext) -> str:
    """Many unicasts in one sentence: how many fared how, and who fared badly."""
    fates: dict[str, list[int]] = {}
    goals = {one.path[-1] for one in group}
    gathers = len(goals) == 1
    for one in group:
        fates.setdefault(outcome(one), []).append(one.source if gathers else one.path[-1])
    order = sorted(fates, key=lambda said: (said != "arrived", said))
    said = ", ".join(
        f"{len(fates[fate])} {fate}" + ("" if fate == "arrived" else f" ({named(fates[fate])})") for fate in order
    )
    if fates.keys() == {"arrived"}:
        said = "all arrived"
    goal, verb = next(iter(goals)), "sent" if group[0].begun else "went on with"
    if gathers:
        who = "members" if goal in speaker.heads and group[0].what not in OF_NODES else "nodes"
        begin = f"{len(group)} {who} {verb} {_parcel(group[0].what, True)} to {speaker.node(goal)}"
    else:
        begin = f"{speaker.node(group[0].source)} {verb} {_parcel(group[0].what, False)} to {len(group)} nodes"
    return f"{begin} {_facts(group)}: {said}"


def _broadcasts(group: Sequence[LoggedMessage]) -> str:
    heard = [_audience(one) for one in group]
    got, of, collided = (sum(counts) for counts in zip(*heard, strict=True))
    unsent = sum(not one.frames for one in group)
    said = f"heard {got:,} times of {of:,}" + (f", {collided:,} collided" if collided else "")
    said += f", {unsent} not sent" if unsent else ""
    return f"{len(group)} nodes broadcast {_parcel(group[0].what, True)} {_facts(group)}: {said}"


def _audience(one: LoggedMessage) -> tuple[int, int, int]:
    """Of a broadcast: how many heard all of it, how many were meant to, and at how many a frame of it collided."""
    touched = {node for frame in one.frames for node in (*frame.received, *frame.collided, *frame.dropped)}
    whole = [node for node in touched if all(frame.received.get(node) == frame.packets for frame in one.frames)]
    return len(whole), len(touched), len({node for frame in one.frames for node in frame.collided})


def _heard(one: LoggedMessage) -> str:
    if not one.frames:
        return f"not sent: {_reason(one.ended)}"
    got, of, _ = _audience(one)
    said = f"heard by {got} of {of}" if of else "nobody was there to hear it"
    collided = sorted({node for frame in one.frames for node in frame.collided})
    lost = sorted({node for frame in one.frames for node in frame.dropped} - set(collided))
    said += f"; collided at {named(collided)}" if collided else ""
    return said + (f"; lost on the way to {named(lost)}" if lost else "")
