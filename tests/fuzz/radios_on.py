"""When the radios of duty-cycled MACs are on: wake-ups and slots as functions of local clocks, and what was held.

with watched_radios() as radios:             a run
radios.was_on(node, frame)                   whether a radio was on when a frame began; frames by their numbers

The wake-ups are a second, plain model of each protocol's, written from its description. What MACs hold on, and what
they pay for in addition, is noted where nodes are charged for it: a radio that hears, and is not charged, is a fault.
"""

from __future__ import annotations

import bisect
import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import wraps
from typing import Any

import numpy as np
import pytest

from wsnsim.base.rng import Streams, derive_all, uniforms
from wsnsim.network.base_network import BaseNetwork
from wsnsim.network.nodes import Nodes
from wsnsim.network.radio.channel import Channel
from wsnsim.network.radio.tsch.slots import SlotRadios

INSTANT = 2e-6
"""Seconds by which times of the same instant may differ: what a slot's rounding leaves."""


@dataclass
class OnAir:
    """A frame that was on the air: when, by its sender's neighbours' clocks too, for whom, and who senses it."""

    source: int
    to: int
    start: float
    end: float
    local: dict[int, float]
    sensing: frozenset[int]


class RadiosOn:
    """What is known of the radios of one run. `mac` is its MAC."""

    def __init__(self) -> None:
        self.mac: Any = None
        self.phases = np.zeros(0)
        self.frames: dict[int, OnAir] = {}
        self._held: dict[int, list[list[float]]] = {}
        self._charged: dict[int, list[tuple[float, float]]] = {}
        self._duties: dict[int, list[tuple[float, int]]] = {}
        self._cells: dict[int, list[tuple[float, float, int]]] = {}
        self._ends: dict[int, list[float]] = {}
        self._ending: dict[float, set[int]] = {}
        self._ended: list[tuple[float, int]] = []

    @property
    def on_channels(self) -> bool:
        """Whether radios use several channels: one that is on hears nothing of the others."""
        return hasattr(self.mac, "slotframe")

    def open(self, network: BaseNetwork) -> None:
        """Note the network of the run."""
        setup = network._setup
        self.mac = setup.mac if hasattr(setup.mac, "duties") else None
        if self.mac is None:
            return
        self._env, self._clocks = network._env, network._stack.clocks
        if hasattr(self.mac, "interval") and not self.on_channels:
            keys = derive_all(Streams(setup.seed, network._replicate).key("wake_up"), np.arange(network._nodes.size))
            self.phases = self.mac.interval * uniforms(keys, 0)

    def note_end(self, number: int, sent: Any) -> None:
        """A frame ends."""
        if self.mac is not None:
            ids = sent.neighbours.ids
            local = dict(zip(ids.tolist(), self._clocks.local_times(ids, sent.start).tolist(), strict=True))
            sensing = frozenset(ids[sent.neighbours.senses].tolist())
            self.frames[number] = OnAir(sent.source, sent.frame.to, sent.start, sent.end, local, sensing)
            self._ends.setdefault(sent.source, []).append(sent.end)
            self._ended.append((sent.end, number))
            for shift in (-1e-6, 0.0, 1e-6):
                self._ending.setdefault(round(sent.end + shift, 6), set()).add(number)

    def hold(self, node: int) -> None:
        """A radio is held on from now on."""
        if self.mac is not None and (not self._held.get(node) or self._held[node][-1][1] < np.inf):
            self._held.setdefault(node, []).append([self._env.now, np.inf])

    def release(self, node: int) -> None:
        """A radio is not held on any longer."""
        if self.mac is not None and self._held.get(node):
            self._held[node][-1][1] = min(self._held[node][-1][1], self._env.now)

    def charge(self, node: int, seconds: float) -> None:
        """A node pays for listening until now."""
        if self.mac is not None and seconds > 0.0:
            self._charged.setdefault(node, []).append((self._env.now - seconds, self._env.now))

    def follow(self, node: int, duty: int) -> None:
        """A radio follows a duty from now on."""
        if self.mac is not None:
            self._duties.setdefault(node, []).append((self._env.now, duty))

    def open_cell(self, node: int, slot: int) -> None:
        """A node receives in a slot of the slotframe from now on."""
        if self.mac is not None:
            self._cells.setdefault(node, []).append((self._env.now, np.inf, slot))

    def close_cell(self, node: int, slot: int | None = None) -> None:
        """A node receives in a slot no longer, or in none."""
        if self.mac is not None:
            self._cells[node] = [
                (begin, min(end, self._env.now) if slot in (None, which) else end, which)
                for begin, end, which in self._cells.get(node, [])
            ]

    def was_on(self, node: int, number: int) -> bool:
        """Whether a radio was on while a frame was on the air: held on, charged for, or in a wake-up or slot."""
        frame = self.frames.get(number)
        if frame is None or self.mac is None or self.was_held(node, number):
            return True
        return node not in frame.local or self._wakes(node, frame.local[node], frame)

    def was_held(self, node: int, number: int, slack: float = INSTANT) -> bool:
        """Whether a radio was on while a frame was on the air, and not only in a wake-up, which it may have ended.

        `slack`: by how many seconds it may have been off at either end; negative: for how many it was on beyond.
        """
        frame = self.frames.get(number)
        if frame is None or self.mac is None:
            return True
        holds = self._held.get(node, [])
        released = [-np.inf, *(end for _, end in holds)]
        held = [
            (since if (since := self._since(node, begin, slack)) >= before else begin, end)
            for (begin, end), before in zip(holds, released, strict=False)
            if end >= frame.start
        ]
        spans = [*held, *self._charged.get(node, ())]
        return any(begin <= frame.start + slack and end >= frame.end - slack for begin, end in spans)

    def _since(self, node: int, begin: float, slack: float) -> float:
        """When a radio that was held on from a time was turned on: ContikiMAC's, at a channel check that heard a frame.

        It is held on when that frame ends, or from when its node begins to send meanwhile, and has been on since the
        check began. A time before it was released last is none of these: it was off in between. A check that ends
        within `slack` of the frame's start has heard it if `slack` is positive. If it is negative, that check has not,
        nor has a node that does not sense the frame.
        """
        mac, earliest = self.mac, begin
        if not hasattr(mac, "cca_gap"):
            return begin
        later = bisect.bisect_left(self._ended, (begin, -1))
        under_way = [number for _, number in self._ended[later : later + 50]]
        for number in {*self._ending.get(round(begin, 6), ()), *under_way}:
            frame = self.frames[number]
            if node in (frame.local if slack > 0.0 else frame.sensing) and frame.start <= begin <= frame.end + INSTANT:
                offset = frame.local[node] - self.phases[node]
                checks = (mac.cca, 2.0 * mac.cca + mac.cca_gap)
                interval = mac.near if self._was_near(node, frame.start) else mac.interval
                waits = [(check - offset + slack) % interval - slack for check in checks]
                if frame.start + min(waits) <= begin + INSTANT:
                    earliest = min(earliest, frame.start + min(waits) - mac.cca)
        return earliest

    def _wakes(self, node: int, local: float, frame: OnAir) -> bool:
        """Whether a radio was on by its wake-ups or its slots, at a time of its clock."""
        mac = self.mac
        if hasattr(mac, "slotframe"):
            return self._listens_in_slot(node, local, frame)
        interval = mac.near if self._was_near(node, frame.start) else mac.interval
        passed = (local - self.phases[node] + INSTANT) % interval - INSTANT
        if hasattr(mac, "strobe_bytes"):
            return bool(passed <= mac.window + INSTANT)
        second = mac.cca + mac.cca_gap
        return bool(passed <= mac.cca + INSTANT or second - INSTANT <= passed <= second + mac.cca + INSTANT)

    def _was_near(self, node: int, time: float) -> bool:
        """Whether a node followed the duty of the short interval."""
        before = [duty for begin, duty in self._duties.get(node, ()) if begin <= time]
        return bool(before) and before[-1] == 1

    def _listens_in_slot(self, node: int, local: float, frame: OnAir) -> bool:
        """Whether a node waits for a frame in its slot, or for an acknowledgement of what it has just sent."""
        mac = self.mac
        asn = int(local / mac.slot + 1e-6)
        slot, passed = asn % mac.slotframe, local - asn * mac.slot
        own = any(begin <= frame.start <= end and which == slot for begin, end, which in self._cells.get(node, ()))
        if (slot in mac.shared_slots or own) and abs(passed - mac.tx_offset) <= mac.guard + INSTANT:
            return True
        latest = mac.rx_ack_delay + mac.ack_wait + INSTANT
        return any(0.0 <= frame.start - end <= latest for end in self._ends.get(node, ()))


@contextlib.contextmanager
def watched_radios() -> Iterator[RadiosOn]:
    """Note what the radios do in the run that the block makes."""
    radios = RadiosOn()
    with pytest.MonkeyPatch.context() as patch:
        for owner, name, note in (
            (Nodes, "hold_radio", lambda self, node, *_, **__: radios.hold(node)),
            (Nodes, "release_radio", lambda self, node, *_, **__: radios.release(node)),
            (Nodes, "_go_down", lambda self, node: (radios.release(node), radios.close_cell(node))),
            (Nodes, "spend_listening", lambda self, node, seconds, *_: radios.charge(node, seconds)),
            (Nodes, "set_duty", lambda self, node, index: radios.follow(node, index)),
            (SlotRadios, "receive", lambda self, node, slot, offset: radios.open_cell(node, slot)),
            (SlotRadios, "stop_receiving", lambda self, node, slot: radios.close_cell(node, slot)),
            (Channel, "_end", lambda self, timeout: radios.note_end(timeout.value.number, timeout.value)),
        ):  # fmt: skip
            patch.setattr(owner, name, _noting(getattr(owner, name), note))
        start = BaseNetwork._start
        patch.setattr(BaseNetwork, "_start", wraps(start)(lambda self: (radios.open(self), start(self))[1]))
        yield radios


def _noting(whole: Any, note: Any) -> Any:
    """A method that is noted before it is called."""

    @wraps(whole)
    def noted(*arguments: Any, **named: Any) -> Any:
        note(*arguments, **named)
        return whole(*arguments, **named)

    return noted
