"""Scenarios drawn at random, small and full of accidents, for properties that must hold in every one of them."""

from __future__ import annotations

from typing import Any

import numpy as np

from tests.helpers.centroid_network import Centroid, network_setup, passing
from wsnsim.base.setups import NetworkSetup
from wsnsim.models.access import Csma, IdealMac, Tdma
from wsnsim.models.appointed import Appointed
from wsnsim.models.clusters import Central, StrongestSignal
from wsnsim.models.datasheets import ProcessorSheet, RadioSheet
from wsnsim.models.deploy import Uniform
from wsnsim.models.energy import FirstOrder, States
from wsnsim.models.faults import Bias, Blackout, ClockStep, Crash, Drain, LinkLoss, Restart, Stuck
from wsnsim.models.hardware import (
    DriftingClock,
    Frames,
    ImperfectDetection,
    NoPacking,
    PerfectClock,
    PerfectDetection,
    Processor,
)
from wsnsim.models.links import Disk, GreedyGeographic, LogNormal, MinimumEnergy, MinimumHop
from wsnsim.models.workloads import NearestNode, NoSink, SeveralSinks

DT = 0.04
SIDE = 140.0
RADIO = RadioSheet(
    name="test radio", source="none", rate=250e3, receive=0.0564, listen=0.0564, levels=(0.0,), transmit=(0.0522,),
    sleep=6e-8, wake=1e-3, wake_power=0.02, doze=5e-5, doze_power=0.02, turnaround=192e-6, turnaround_power=0.05,
    sensitivity=-95.0, noise=-100.0,
)  # fmt: skip
PROCESSOR = ProcessorSheet(
    name="test processor", source="none", rate=8e6, run=5.4e-3, idle=1.6e-4, sleep=1.5e-5, wake=6e-6
)


def scenario(number: int) -> tuple[NetworkSetup, Any, Any]:
    """(parts, positions, truths) of scenario `number`: every role drawn, and one to six faults."""
    rng = np.random.default_rng([2013, number])
    steps, nodes = int(rng.integers(30, 41)), int(rng.integers(6, 16))
    targets = 1 + int(rng.uniform() < 0.25)
    duration = steps * DT
    made = network_setup(
        seed=number,
        steps=steps,
        dt=DT,
        deploy=Uniform(nodes=nodes, width=SIDE, height=SIDE, cover=False),
        motions=network_setup().motions * targets,
        tracker=Centroid(cycles=float(rng.choice([0.0, 1e4, 2e5]))),
        **_radio(rng),
        clusters=_one(rng, StrongestSignal(), StrongestSignal(successor_rule="elect"), Central(), Appointed()),
        routing=_one(rng, MinimumEnergy(), MinimumHop(), GreedyGeographic()),
        cpu=_one(rng, Processor(), Processor(rate=8e6)),
        clock=_one(rng, PerfectClock(), PerfectClock(), DriftingClock(sd=0.01)),
        detection=_one(rng, PerfectDetection(), ImperfectDetection(missed=0.2, false_alarm=0.02, bias_sd=0.5)),
        sink=_one(rng, NoSink(), NearestNode(), SeveralSinks(points=((0.0, 0.0), (50.0, 20.0)))),
        faults=tuple(_fault(rng, nodes, targets, duration) for _ in range(int(rng.integers(1, 7)))),
    )
    truths = [_path(rng, steps) for _ in range(targets)]
    return made, rng.uniform(-SIDE / 2, SIDE / 2, (nodes, 2)), truths


def _one(rng: np.random.Generator, *choices: Any) -> Any:
    return choices[int(rng.integers(len(choices)))]


def _radio(rng: np.random.Generator) -> dict[str, Any]:
    """A MAC, a link and a supply of energy, at times so small that nodes die."""
    mac = _one(rng, IdealMac(), IdealMac(rate=250e3), Csma(), Csma(acks=False), Tdma(), Tdma(acks=True))
    packing = NoPacking() if isinstance(mac, IdealMac) else _one(rng, NoPacking(), Frames())
    link = _one(rng, Disk(reach=60.0), Disk(reach=60.0, loss=0.3), LogNormal(), LogNormal(interference="sinr"))
    battery = float(rng.choice([2.0, 0.02, 0.1]))
    energy = _one(
        rng,
        FirstOrder(battery=battery),
        FirstOrder(battery=battery / 20, sensing=1e-5),
        FirstOrder(battery=battery, idle=0.03, sleep=1e-6, switch=1e-5),
        States(radio=RADIO, processor=PROCESSOR, battery=battery, sensing=1e-6),
    )
    return {"mac": mac, "packing": packing, "link": link, "energy": energy}


def _fault(rng: np.random.Generator, nodes: int, targets: int, duration: float) -> Any:
    """Anything, at any time, often in the middle of a step; half of them aimed at a head."""
    share = float(rng.uniform(0, 1))
    at = share * duration if rng.uniform() < 0.7 else round(share * duration / DT) * DT
    lasts = float(rng.choice([0.0, 1e-3, 0.05, 0.3, 5.0]))
    when: dict[str, Any] = {"at": at, **_aim(rng, nodes, targets)}
    ends = {**when, "duration": _one(rng, None, lasts)}
    return _one(
        rng,
        Crash(**ends),
        Crash(**ends),
        Restart(**when, duration=lasts),
        Drain(**when, share=float(rng.uniform(0.1, 1.0))),
        Drain(**when, joules=float(rng.choice([1e-4, 10.0]))),
        Blackout(**ends),
        LinkLoss(**ends, loss=float(rng.choice([0.5, 1.0]))),
        ClockStep(**ends, offset=float(rng.choice([0.5, -0.03]))),
        Stuck(**ends, value=_one(rng, None, 50.0)),
        Bias(**ends, offset=10.0),
    )


def _aim(rng: np.random.Generator, nodes: int, targets: int) -> dict[str, Any]:
    x, y = rng.uniform(-SIDE / 2, SIDE / 2, 2).tolist()
    head = {"head": int(rng.integers(targets))}
    hit = tuple(rng.choice(nodes, 3, replace=False).tolist())
    return _one(rng, head, head, head, {"nodes": hit}, {"fraction": 0.3}, {"region": (x, y, 60.0)})


def _path(rng: np.random.Generator, steps: int) -> np.ndarray:
    """A target that crosses the field, fast enough for handovers."""
    start, speed = rng.uniform(-60, 60, 2), rng.uniform(-60, 60, 2)
    return passing((float(start[0]), float(start[1])), (float(speed[0]), float(speed[1])), steps, DT)
