"""A MAC from outside the package: it carries frames in runs, and `check_mac` accepts or refuses it."""

import math
from collections import deque
from typing import Annotated, ClassVar

import numpy as np
import pytest

import wsnsim
from wsnsim.base.errors import ScenarioError
from wsnsim.base.frames import OfferedFrame
from wsnsim.base.part import Quantity, part
from wsnsim.base.rng import derive, uniforms
from wsnsim.models.access import Csma, Framed, IdealMac, Tdma
from wsnsim.models.low_power_listening import ContikiMac, XMac
from wsnsim.models.tsch import Tsch
from wsnsim.scenario.registry import kinds
from wsnsim.testing import check_mac

ALOHA = f"{__name__}:SlottedAloha"


@part
class SlottedAloha(Framed):
    """A node with a frame sends it at the start of a slot, with a fixed probability in each slot, without listening.

    Source: Roberts (1975), "ALOHA packet system with and without slots and capture". There are no acknowledgements.
    """

    mechanism: ClassVar[str] = "slotted_aloha"
    acks: bool = False
    slot: Annotated[float, Quantity("s", gt=0.0), "length of a slot"] = 1.5e-3
    probability: Annotated[float, Quantity("", gt=0.0, le=1.0), "of sending in a slot"] = 0.1

    def start(self, services):
        return Aloha(self, services)


class Aloha:
    def __init__(self, mac, services):
        self.mac = mac
        self.services = services
        self.channel = services.open_channel(mac, mac.slot)
        self.fragmentation = services.fragmentation(mac)
        self.key = services.key("aloha")
        self.queues = {}
        self.samples = 0

    def send(self, bursts, head=None):
        signal, missing = self.services.signal(), len(bursts)

        def ended():
            nonlocal missing
            missing -= 1
            if missing == 0:
                signal.succeed()

        if not bursts:
            signal.succeed()
        for burst in bursts:
            frames = self.fragmentation.split(burst, ended)
            if frames and self.services.is_up(burst.source):
                for frame in frames:
                    self.enqueue(burst.source, frame)
            else:
                burst.lose()
                ended()
        return signal

    def offer(self, node, payload_bits, done, code=0):
        self.enqueue(node, OfferedFrame(self.mac.bits(payload_bits), code, done))

    def silence(self, node):
        self.channel.silence(node)
        for frame in self.queues.pop(node, ()):
            frame.finish(None)

    def enqueue(self, node, frame):
        if node not in self.queues:
            self.queues[node] = deque()
            self.services.hold_awake(node)
            self.wait(node)
        self.queues[node].append(frame)

    def wait(self, node):
        self.samples += 1
        sample = float(uniforms(np.array([derive(self.key, node, self.samples)], dtype=np.uint64), 0)[0])
        slots = 1 + int(math.log(max(sample, 1e-12)) / math.log(1.0 - self.mac.probability))
        start = (math.floor(self.services.now / self.mac.slot) + slots) * self.mac.slot
        queue = self.queues[node]
        self.services.call_later(start - self.services.now, lambda: self.transmit(node, queue))

    def transmit(self, node, queue):
        if self.queues.get(node) is not queue:  # it crashed in the meantime
            return
        frame = queue[0]
        frame.owner = queue
        self.channel.transmit(node, frame, self.ended)

    def ended(self, transmission, received):
        node, queue = transmission.source, transmission.frame.owner
        if self.queues.get(node) is not queue:
            return
        queue.popleft()
        transmission.frame.finish(received)
        if queue and self.queues.get(node) is queue:
            self.wait(node)
        elif self.queues.get(node) is queue:
            del self.queues[node]
            self.services.release(node)


def run(tmp_path, scenario, *changes):
    out = tmp_path / "run.h5"
    wsnsim.run(
        wsnsim.load(scenario, [f"mac={{kind: '{ALOHA}'}}", "record.events=true", *changes]), replicates=1, out=out
    )
    return {table: wsnsim.read(out, table) for table in ("runs", "events")}


@pytest.mark.thorough
def test_a_plugin_mac_carries_a_track(tmp_path):
    tables = run(tmp_path, "central_pf", "duration=4 s", "step=0.5 s")
    events, result = tables["events"], tables["runs"].iloc[0]
    assert (events[events.kind == "receive"].what == "reading").sum() > 10
    assert 0 < result.delivered < result.in_range and result.collided > 0
    assert result.lost == 0 and result.rmse < 10.0


@pytest.mark.thorough
def test_a_plugin_mac_carries_beacons_and_starts_them_at_slots(tmp_path):
    tables = run(tmp_path, "beacons", "duration=5 s", "deploy={kind: uniform, nodes: 50, width: 200 m, height: 200 m}")
    events = tables["events"]
    sends = events[events.kind == "send"]
    mac = SlottedAloha()
    starts = (sends.time - sends.bits / mac.rate - mac.turnaround) / mac.slot
    assert len(sends) > 200 and np.allclose(starts, np.round(starts), atol=1e-6)
    assert tables["runs"].delivered[0] > 1000


def test_the_fields_of_a_plugin_mac_are_checked():
    with pytest.raises(ScenarioError, match="probability"):
        wsnsim.load("beacons", [f"mac={{kind: '{ALOHA}', probability: 2}}"])


CATALOGUE = {
    "ideal": IdealMac(), "csma": Csma(), "tdma": Tdma(), "xmac": XMac(), "contikimac": ContikiMac(), "tsch": Tsch(),
}  # fmt: skip


def test_all_built_in_macs_are_checked_here():
    assert set(CATALOGUE) == set(kinds("mac"))


@pytest.mark.thorough(fast=["mac0"])
@pytest.mark.parametrize("mac", [*CATALOGUE.values(), IdealMac(rate=250e3), Tdma(acks=True), SlottedAloha()])
def test_every_mac_of_the_catalogue_and_the_plugin_keep_the_contract(mac):
    check_mac(mac)


class Deaf(Aloha):
    def ended(self, transmission, received):
        super().ended(transmission, received if transmission.frame.to == -1 else False)


class Endless(Aloha):
    def ended(self, transmission, received):
        pass


class Twice(Aloha):
    def offer(self, node, payload_bits, done, code=0):
        super().offer(node, payload_bits, done, code)
        super().offer(node, payload_bits, done, code)


class Undead(Aloha):
    def silence(self, node):
        pass


class Fickle(Aloha):
    runs = 0

    def __init__(self, mac, services):
        super().__init__(mac, services)
        Fickle.runs += 1
        self.key += Fickle.runs


@pytest.mark.parametrize(
    ("broken", "message"),
    [
        (Deaf, "'unicast'.*do not arrive"),
        (Endless, "'unicast'.*has not succeeded"),
        (Twice, "'offer'.*reported 2 times"),
        (Undead, "'silence'"),
        (Fickle, "'repeatable'.*other events"),
    ],
)
def test_a_mac_that_breaks_the_contract_is_refused(broken, message, monkeypatch):
    monkeypatch.setattr(SlottedAloha, "start", lambda self, services: broken(self, services))
    with pytest.raises(AssertionError, match=message):
        check_mac(SlottedAloha())
