"""The description of a step as sentences: actions of nodes, and messages with their outcomes.

describe(actions, context) -> [Sentence] in the order of time;   outcome(message) -> a few words
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence

from wsnsim.analysis import phrases
from wsnsim.analysis.event_groups import LoggedBurst, LoggedMessage, NodeAction
from wsnsim.analysis.phrases import PARCELS, REASONS, VERBS, Sentence, StepContext, energy_in_words, listed
from wsnsim.base.errors import counted


def describe(actions: Iterable[NodeAction | LoggedMessage], context: StepContext) -> list[Sentence]:
    """The sentences of a step in the order of time; many similar messages are summed up in one."""
    actions = list(actions)
    messages = [action for action in actions if isinstance(action, LoggedMessage)]
    place = {id(group[0]): group for group in _groups(messages)}
    lines: list[Sentence] = []
    for action in actions:
        if isinstance(action, NodeAction):
            lines.append(Sentence(action.time, action.until, _action(action, context)))
        elif id(action) in place:
            lines += _messages(place[id(action)], context)
    return sorted(lines, key=lambda line: line.time)


def _action(action: NodeAction, context: StepContext) -> str:
    several = len(action.nodes) > 1
    who = (
        f"{len(set(action.nodes)):,} nodes"
        if several
        else context.node(action.nodes[0])
        if action.nodes[0] >= 0
        else "nobody"
    )
    names = f": {listed(action.nodes)}" if several else ""
    paid = f" ({energy_in_words(action.joules)})" if action.joules else ""
    if action.kind in VERBS:
        verb, after = VERBS[action.kind]
        return f"{who} {verb}{after.get(action.what, '')}{context.target(action.target)}{paid}{names}"
    clause = _interaction(action, who, context)
    target = "" if action.kind == "fault" else context.target(action.target)
    return f"{clause}{target}{paid}{'' if action.kind == 'overhear' else names}"


def _interaction(action: NodeAction, who: str, context: StepContext) -> str:
    """An action, mostly of one node, or with another node."""
    what, peer = action.what.replace("_", " "), context.node(action.peer)
    by_kind = {
        "overhear": f"{who} overheard frames for other nodes ({counted(action.count, 'reception')})",
        "elect": f"{who} was elected cluster head",
        "announce": f"{who} announced its cluster",
        "join": f"{who} joined {peer}",
        "allocate": f"{who} allocated {what or 'its belief'}: {counted(action.packets, 'packet')} for other nodes",
        "estimate": f"{who} issued {context.issued.get((action.target, action.time), 'an estimate')}",
        "handover": f"{who} handed over to {peer} by the message that woke it"
        if action.what == "message"
        else f"{who} started the handover to {peer}",
        "lost": f"the track was lost: {phrases.LOSSES.get(action.what, what) or 'no reason given'}"
        + (f" ({who})" if action.nodes[0] >= 0 else ""),
        "reacquire": f"{who} initiated the track again, from readings",
        "acquire": f"{who} initiated a track",
        "call": f"{who} sent a wake-up call",
        "called": f"{who} {'were' if len(action.nodes) > 1 else 'was'} woken by a wake-up call of {peer}",
        "begin": f"{who} became the head of a new group of tracks",
        "end": f"{who} ended its group, which has no track left",
        "merge": f"{who} merged its group into that of {peer}",
        "split": f"{who} split its group: {peer} leads the tracks that parted",
        "initiate": f"{who} began {counted(action.count, 'tentative track')}",
        "confirm": f"{who} confirmed {counted(action.count, 'track')}",
        "delete": f"{who} deleted {counted(action.count, 'track')}{what and f' ({what})'}",
        "leave": "the target left the field",
        "return": "the target came back into the field",
        "report": _report(action, who, context),
    }
    if action.kind == "fault":
        ended = action.what.endswith("_over")
        name = what.removesuffix(" over") or "unnamed"
        return f"fault '{name}' ended at {who}" if ended else f"fault '{name}' hit {who}"
    return by_kind.get(action.kind, " ".join(filter(None, (who, action.kind, what))))


def _report(action: NodeAction, who: str, context: StepContext) -> str:
    """A report as the cluster head sends it, or as the sink receives it."""
    if action.nodes[0] in context.heads or action.peer < 0:
        return f"{who} reported to the sink" + (f", node {action.peer}" if action.peer >= 0 else "")
    return f"the sink, {who}, received the report of {context.node(action.peer)}"


def _parcel(what: str, several: bool) -> str:
    """The name of a parcel, of one sender or of several."""
    if not what:
        return ("a message", "messages")[several]
    words = what.replace("_", " ")
    return PARCELS.get(what, (f"its {words}", f"their {words}"))[several]


def outcome(message: LoggedMessage) -> str:
    """The outcome of a unicast message in a few words; equal outcomes have equal words."""
    if not message.frames:
        unsent = "strobes not answered" if message.strobes else "not sent"
        return f"{unsent}: {_reason(message.ended)}" if message.ended else f"{unsent} in this step"
    hop = message.hop
    arrived = [frame for frame in hop if frame.arrived]
    if message.ended or (not arrived and not message.goes_on):
        unlucky = "collided" if hop[-1].collided else "lost on the way" if hop[-1].dropped else "cut short"
        lost = "arrived in part" if arrived else unlucky
        return f"{lost}, then given up: {_reason(message.ended)}" if message.ended else lost
    if message.goes_on:
        return "still on its way when the step ended"
    if len(arrived) == len(hop):
        return "arrived" if _got(hop) >= sum(frame.packets for frame in hop) else "arrived in part"
    if len(arrived) == 1 and hop[-1].arrived:
        return "arrived after lost frames"
    return "arrived in part"


def _reason(word: str) -> str:
    return REASONS.get(word, word.replace("_", " "))


def _got(hop: Sequence[LoggedBurst]) -> int:
    return sum(frame.received.get(frame.to, 0) for frame in hop)


def _groups(messages: Sequence[LoggedMessage]) -> list[list[LoggedMessage]]:
    """Messages of one kind to one node, from one node, or to all nodes; a repetition starts another group."""
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
    """The common end of the messages of one group; a flood is a group of its own."""
    if one.is_broadcast:
        return ("flood", id(one)) if one.is_flood else ("all", 0)
    return ("to", one.path[-1]) if gathers else ("from", one.source)


def _messages(group: list[LoggedMessage], context: StepContext) -> list[Sentence]:
    if len(group) <= context.limit or len(group) == 1:
        return [Sentence(one.time, one.until, _message(one, context)) for one in group]
    text = _broadcasts(group) if group[0].is_broadcast else _sum(group, context)
    return [Sentence(group[0].time, max(one.until for one in group), text + context.target(group[0].target))]


def _message(one: LoggedMessage, context: StepContext) -> str:
    what = _parcel(one.what, False)
    text = f"{context.node(one.source)} "
    if one.is_flood:
        return _flood(one, context)
    if one.is_broadcast:
        return f"{text}broadcast {what} {_facts([one])}; {_heard(one)}{context.target(one.target)}"
    path = one.path
    text += "sent " if one.begun else "relayed " if one.relayed else "continued to send "
    text += f"{what} to {context.node(path[-1] if len(path) > 1 else one.to)}"
    text += f" over {', '.join(str(node) for node in path[1:-1])}" if len(path) > 2 else ""
    text += "" if one.begun or not one.relayed else ", begun before this step,"
    return f"{text} {_facts([one])}; {_fate(one, context)}{context.target(one.target)}"


def _flood(one: LoggedMessage, context: StepContext) -> str:
    """A flood as one sentence: its source, its forwarders, the nodes that it reached, and those that it woke."""
    begun = (
        "broadcast" if one.begun else "forwarded, begun before this step," if one.relayed else "continued to broadcast"
    )
    facts = [f"{context.node(one.source)} {begun} {_parcel(one.what, False)} {_facts([one])}"]
    if one.forwarders:
        facts.append(f"forwarded by {_those(one.forwarders, context)}")
    heard = len(one.heard)
    facts.append(f"received by {heard}" if heard else "no node was in range")
    if one.callers:
        callers, woken = _those(one.callers, context), len(one.woken)
        facts.append(f"{callers} sent a wake-up call, which woke {woken or 'no node'}")
        facts[-1] += f": {listed(one.woken)}" if woken else ""
    for nodes, words in ((_missed(one), "lost at"), (one.expired, "expired at")):
        facts += [f"{words} {listed(nodes)}"] if nodes else []
    return "; ".join(facts) + (f"; not sent: {_reason(one.ended)}" if one.ended else "") + context.target(one.target)


def _those(nodes: Sequence[int], context: StepContext) -> str:
    """One node with its role, or several with their numbers."""
    return context.node(nodes[0]) if len(nodes) == 1 else f"{len(nodes)} nodes ({listed(nodes)})"


def _missed(one: LoggedMessage) -> list[int]:
    """The nodes in range of a broadcast that received no burst of it."""
    touched = {node for frame in one.frames for node in (*frame.collided, *frame.dropped)}
    return sorted(touched - one.heard - {one.source, *one.forwarders})


def _fate(one: LoggedMessage, context: StepContext) -> str:
    """The outcome of a unicast message in detail."""
    clause = outcome(one)
    if not one.frames:
        return clause
    hop, last = one.hop, one.hop[-1]
    arrived = sum(frame.arrived for frame in hop)
    if arrived < len(hop) and len(hop) > 1:
        clause += f" ({arrived} of {len(hop)} frames)"
    elif clause.startswith("arrived in part"):
        clause += f" ({_got(hop)} of {sum(frame.packets for frame in hop)} packets)"
    if not arrived and not one.goes_on:
        clause += (
            f" at {last.to}" if last.collided else f" from {last.source} to {last.to}" if len(one.path) > 2 else ""
        )
    return clause


def _facts(group: Sequence[LoggedMessage]) -> str:
    """The amount of what was sent, and the energy of all senders and receivers."""
    frames = sum(len(one.frames) for one in group)
    hops = len(group[0].path) - 1 if len(group) == 1 and not group[0].is_broadcast else 1
    packets, strobes = (sum(getattr(one, name) for one in group) for name in ("packets", "strobes"))
    facts = [counted(packets, "packet")] if packets or not strobes else []
    facts += [counted(hops, "hop")] if hops > 1 else []
    facts += [counted(frames, "frame")] if frames > max(hops, len(group)) else []
    facts += [counted(strobes, "strobe")] if strobes else []
    facts += [counted(sum(one.bits for one in group), "bit"), energy_in_words(sum(one.joules for one in group))]
    return f"({', '.join(facts)})"


def _sum(group: Sequence[LoggedMessage], context: StepContext) -> str:
    """Many unicast messages in one sentence: the number of each outcome, and the nodes of the bad ones."""
    fates: dict[str, list[int]] = {}
    goals = {one.path[-1] for one in group}
    gathers = len(goals) == 1
    for one in group:
        fates.setdefault(outcome(one), []).append(one.source if gathers else one.path[-1])
    order = sorted(fates, key=lambda clause: (clause != "arrived", clause))
    clause = ", ".join(
        f"{len(fates[fate])} {fate}" + ("" if fate == "arrived" else f" ({listed(fates[fate])})") for fate in order
    )
    if fates.keys() == {"arrived"}:
        clause = "all arrived"
    goal, verb = next(iter(goals)), "sent" if group[0].begun else "continued to send"
    if gathers:
        who = "members" if goal in context.heads and group[0].what not in phrases.FROM_NODES else "nodes"
        begin = f"{len(group)} {who} {verb} {_parcel(group[0].what, True)} to {context.node(goal)}"
    else:
        begin = f"{context.node(group[0].source)} {verb} {_parcel(group[0].what, False)} to {len(group)} nodes"
    return f"{begin} {_facts(group)}: {clause}"


def _broadcasts(group: Sequence[LoggedMessage]) -> str:
    got, of, collided = (sum(counts) for counts in zip(*[_audience(one) for one in group], strict=True))
    unsent = sum(not one.frames for one in group)
    clause = f"received {got:,} of {of:,} times" + (f", {collided:,} collided" if collided else "")
    clause += f", {unsent} not sent" if unsent else ""
    return f"{len(group)} nodes broadcast {_parcel(group[0].what, True)} {_facts(group)}: {clause}"


def _audience(one: LoggedMessage) -> tuple[int, int, int]:
    """The numbers of nodes that received all of a broadcast, that were in range, and at which it collided."""
    touched = {node for frame in one.frames for node in (*frame.received, *frame.collided, *frame.dropped)}
    whole = [node for node in touched if all(frame.received.get(node) == frame.packets for frame in one.frames)]
    return len(whole), len(touched), len({node for frame in one.frames for node in frame.collided})


def _heard(one: LoggedMessage) -> str:
    if not one.frames:
        return f"not sent: {_reason(one.ended)}"
    got, of, _ = _audience(one)
    clause = f"received by {got} of {of}" if of else "no node was in range"
    collided = sorted({node for frame in one.frames for node in frame.collided})
    lost = sorted({node for frame in one.frames for node in frame.dropped} - set(collided))
    clause += f"; collided at {listed(collided)}" if collided else ""
    return clause + (f"; lost on the way to {listed(lost)}" if lost else "")
