"""Scenarios sampled from the registry: every kind of every role, with few nodes, few particles and few steps.

    sampled(number) -> dict      the scenario of a number; the kinds of each role take turns

What is sampled is valid for each component by itself. Combinations that `build` refuses are the caller's to count.
"""

from __future__ import annotations

import random
from typing import Any, Final

from tests.fuzz.random_values import of_fields
from tests.helpers.tracker_kinds import trackers_of_one_target, trackers_without_a_head
from wsnsim.base.ports import port_of
from wsnsim.scenario.registry import ROLES, load_class

STARTS: Final = {
    "bounded_velocity": 4, "constant_velocity": 4, "constant_acceleration": 3, "ungm": 1, "coordinated_turn": 5,
}  # fmt: skip
"""Columns of the state where `start` gives all of them."""
LINE: Final = ("constant_acceleration", "ungm")
SHEETS: Final = {"radio": ("cc2420", "cc1000", "nrf52840_radio"), "processor": ("msp430f1611", "nrf52840", "sa1100")}
PARTNERS: Final = {
    "tsstp": ("experience_zones", "detection"), "cluster": ("region", "prediction"),
    "gmtt": ("directed_flood", "prediction"), "ris": ("none", "detection"),
}  # fmt: skip
"""Trackers that go with a wake-up protocol, and with what decides who leads."""
DECIDE: Final = ("acoustic_energy", "range", "rssi", "bearing")
"""Sensors of one number, which a member can compare with what is expected."""
IN_A_HEAD: Final = ("pf", "gpf", "imm", "cs_pf", "ics_pf", "central_pf", "pso_gpf", "gsa_gpf")
"""Trackers in whose place a Kalman filter may stand, whatever else a scenario says."""
OF_LINES: Final = ("squared", "coordinate", "range", "range_from_origin")
"""Sensors of a position of one column."""
ONLINE: Final = ("acoustic_energy", "range", "rssi", "bearing", "range_bearing")
"""Sensors with a range, which a network needs."""
ONE_NUMBER: Final = ("rkf", "imsf")
"""Trackers that need readings of one component."""
ON_PLANES: Final = ("gmtt", "tsstp", "cluster", "ris", "trilateration")
"""Trackers that need distances in the plane."""
PLAIN: Final = ("packing", "routing", "clock", "sync", "detection", "wakeup")
"""Roles of a network that take any values."""
MOSTLY_OFF: Final = ("xmac", "contikimac", "tsch")
"""MACs whose radios are off most of the time: a node cannot be reached at once."""
RECORDED: Final = "scenarios/recorded/ble/straight_01.csv.gz"
"""A track that comes with wsnsim, from the folder in which the tests are run."""
RECEIVERS: Final = "scenarios/recorded/ble/receivers.csv"
"""The nodes that heard it, with their heights."""
RECORDED_LINKS: Final = "scenarios/recorded/links/grenoble_first_half.k7.gz"
"""Links between 50 nodes, likewise."""
MAKE_SCANS: Final = ("range", "bearing", "range_bearing")
"""Sensors whose readings may be detections that name no target."""
OF_ONE_TARGET: Final = {
    "tracker": [kind.kind for kind in trackers_of_one_target()],
    "detection": [kind.kind for kind in ROLES["detection"].kinds if kind.kind != "unlabelled"],
    "clusters": [kind.kind for kind in ROLES["clusters"].kinds if kind.kind != "none"],
}
"""Kinds of these roles where readings name their target, and there is a head."""
GUIDED: Final = 0.9
"""Probability that a choice avoids what `build` is known to refuse."""

Values = dict[str, Any]


class Sampler:
    """Samples the roles of one scenario. `turn` chooses the kinds: those of each role take turns."""

    def __init__(self, turn: int, rng: random.Random) -> None:
        self.turn, self.rng = turn, rng
        self.step = rng.choice([0.04, 0.2, 1.0])
        self.steps = rng.randint(3, 12)
        self.nodes, self.side = rng.randint(4, 16), rng.choice([60.0, 100.0, 160.0])
        self.network = rng.random() < 0.8
        self.components: tuple[str, ...] = ()

    def scenario(self) -> Values:
        """The whole scenario."""
        common = {
            "name": "random",
            "seed": self.rng.randrange(1000),
            "step": self.step,
            "duration": round(self.step * self.steps, 9),
            "deploy": self.deploy(),
        }
        if self.network and self.rng.random() < 0.1:
            return {**common, **self.beacons()}
        motion = self.kind("motion", *(() if not self.network else ("ungm",)))
        columns = STARTS.get(motion, 4)
        tracker = self.tracker(motion in LINE)
        common |= {
            "record": dict.fromkeys(("covariances", "particles", "links", "tracker_state"), True),
            "prior": {"kind": "around_truth", "sd": [self.rng.choice([0.1, 1.0, 5.0]) for _ in range(columns)]},
            "targets": [self.motion(motion) for _ in range(1 + (self.rng.random() < 0.15))],
            "sensor": self.sensor(motion in LINE, tracker["kind"]),
            "tracker": tracker,
        }
        self.components = ("range", "bearing") if common["sensor"]["kind"] == "range_bearing" else ()
        if motion == "recorded_track" and self.rng.random() < 0.7:
            common |= self.recording()
            if common["sensor"]["law"].get("gain_spread"):  # gains of recorded readings are not known
                tracker["assumes"] = {"gains": "unknown", "inflate": False, "noise_scale": 1.0}
        if common["sensor"]["kind"] == "acoustic_energy" and self.rng.random() < 0.3:
            tracker["assumes"] = {"gains": "unknown", "inflate": self.rng.random() < 0.5, "noise_scale": 2.0}
        if not self.network:
            return {**common, "network": "none"}
        radio = self.of_network(tracker["kind"])
        if common["sensor"]["kind"] == "recorded" and self.rng.random() < GUIDED:
            radio["detection"] = {"kind": "perfect"}
        return self.headless(self.triggers(self.scans(self.late({**common, **radio}), motion in LINE)))

    def headless(self, values: Values) -> Values:
        """The scenario, in some cases without a head; the choice changes no other value."""
        rng = random.Random(f"headless {self.turn}")
        if values["detection"]["kind"] == "unlabelled" or rng.random() < 0.7:
            return values
        tracker = {"kind": rng.choice([kind.kind for kind in trackers_without_a_head()])}
        if tracker["kind"].endswith("_consensus") and tracker["kind"] != "kalman_consensus":
            tracker |= {"rounds": rng.randint(1, 4), "weights": rng.choice(["metropolis", "ratio"])}
        clusters = {"kind": "none", "radius": rng.choice([None, 0.0, 50.0]), "gateway": rng.choice(["sink", "target"])}
        assumes = {name: value for name, value in values["tracker"].items() if name == "assumes"}
        values = {role: value for role, value in values.items() if role != "until"}
        return {**values, "tracker": tracker | assumes, "clusters": clusters, "wakeup": {"kind": "none"}}

    def late(self, values: Values) -> Values:
        """The scenario, in some cases with a tracker that uses late readings; the choice changes no other value."""
        rng, tracker = random.Random(f"late {self.turn}"), values["tracker"]
        kind = load_class(next(info for info in ROLES["tracker"].kinds if info.kind == tracker["kind"]))
        if not hasattr(kind, "late_window") or tracker.get("readings") == "nearest" or rng.random() < 0.5:
            return values
        ways = ["refilter", "retrodict"] if getattr(kind, "retrodicts", False) else ["refilter"]
        late = {"late": rng.choice(ways), "late_window": self.step * rng.choice([1.5, 5.0])}
        return {**values, "tracker": tracker | late}

    def scans(self, values: Values, line: bool) -> Values:
        """The scenario, in some cases with readings that name no target; the choice changes no other value."""
        rng = random.Random(f"scans {self.turn}")
        if line or values["sensor"]["kind"] not in MAKE_SCANS or rng.random() < 0.6:
            return values
        several = [kind.kind for kind in ROLES["tracker"].kinds if port_of(load_class(kind)) == "MultiTracker"]
        management = {"kind": rng.choice([kind.kind for kind in ROLES["management"].kinds])}
        tracker = {"kind": rng.choice(several), "filter": {"kind": rng.choice(["ekf", "ukf", "ckf"])}}
        detection = {"kind": "unlabelled", "probability": rng.choice([1.0, 0.8]), "clutter": rng.choice([0.0, 0.5, 2])}
        values = {role: value for role, value in values.items() if role != "until"}
        if values["sensor"]["kind"] == "range_bearing" and rng.random() < 0.3:
            detection["resolution"] = [1.0, 0.05]
        return {
            **values, "tracker": tracker | {"management": management}, "detection": detection,
            "record": values["record"] | {"detections": True},
            "wakeup": {"kind": "none"}, "clusters": {"kind": rng.choice(["central", "strongest_signal"])},
        }  # fmt: skip

    def triggers(self, values: Values) -> Values:
        """The scenario, in some cases with members that decide whether to send; the choice changes no other value."""
        rng, tracker = random.Random(f"triggers {self.turn}"), values["tracker"]
        decides = values["sensor"]["kind"] in DECIDE and "emission" not in values["sensor"] and "assumes" not in tracker
        if decides and tracker["kind"] in IN_A_HEAD and rng.random() < 0.5:
            tracker = {"kind": rng.choice(["ekf", "ukf", "ckf"])}
        if tracker["kind"] not in ("ekf", "ukf", "ckf") or tracker.get("readings") == "nearest" or rng.random() < 0.2:
            return values
        tracker = {name: value for name, value in tracker.items() if not name.startswith("late")}
        kinds = ["stochastic", "event", "always", "periodic", "random"] if decides else ["periodic", "random"]
        trigger = {"kind": rng.choice(kinds)}
        if trigger["kind"] in ("event", "stochastic"):
            trigger |= {"loss": rng.choice([0.0, 0.2]), "shared_every": rng.choice([1, 5])}
        return {**values, "tracker": tracker | {"trigger": trigger}}

    def recording(self) -> Values:
        """Readings of a recorded track, and the nodes that took them."""
        law = self.part("sensor", "rssi")
        law = {name: value for name, value in law.items() if name not in ("gains", "nodes", "fitted_on")}
        return {
            "deploy": {
                "kind": "file", "path": RECEIVERS, "columns": {"id": "receiver"}, "width": 21.0, "height": 19.4,
                "centre": [9.5, 9.0], "cover": False,
            },
            "targets": [self.motion("recorded_track")],
            "sensor": {
                "kind": "recorded", "path": RECORDED, "columns": {"node": "receiver", "reading": "rssi"},
                "several": self.rng.choice(["mean", "last"]), "law": {**law, "reach": self.rng.choice([5.0, 30.0])},
            },
        }  # fmt: skip

    def beacons(self) -> Values:
        """A network without a target."""
        radio = {role: value for role, value in self.radio().items() if role not in ("wakeup", "detection")}
        kind = self.kind("workload", "tracking")
        workload = {"kind": kind, "period": self.step, "bits": self.rng.randint(1, 800)}
        if kind == "collection":
            workload.update(points=[self.place() for _ in range(self.rng.randint(1, 2))], start_at=0.0)
        return {**radio, "workload": workload if kind != "tracking" else {**workload, "kind": "beacons"}}

    def kind(self, role: str, *without: str) -> str:
        """The kind of a role whose turn it is, in half of the cases; any kind in the others."""
        names = OF_ONE_TARGET.get(role) or [info.kind for info in ROLES[role].kinds]
        chosen = names[self.turn % len(names)] if self.rng.random() < 0.5 else self.rng.choice(names)
        allowed = [name for name in names if name not in without]
        return self.rng.choice(allowed) if chosen in without and self.rng.random() < GUIDED else chosen

    def part(self, role: str, kind: str | None = None) -> Values:
        """A component of a role with random values."""
        chosen = kind or self.kind(role)
        info = next(info for info in ROLES[role].kinds if info.kind == chosen)
        return {"kind": chosen, **of_fields(load_class(info), self.rng)}

    def place(self) -> list[float]:
        """A point of the field."""
        return [round(self.rng.uniform(-self.side / 2, self.side / 2), 3) for _ in range(2)]

    def deploy(self) -> Values:
        """Nodes on a small field; a list in place of a file of one's own, since a scenario is one text."""
        kind = self.kind("deploy")
        if kind in ("file", "anchors"):
            field = {"width": self.side, "height": self.side, "centre": [0.0, 0.0]}
            return {"kind": "anchors", "places": [self.place() for _ in range(self.nodes)], **field}
        own = {"nodes": self.nodes, "width": self.side, "height": self.side, "cover": self.rng.random() < 0.1}
        return {**self.part("deploy", kind), **own, "position_error": self.rng.choice([0.0, 0.0, 1.0])}

    def motion(self, kind: str) -> Values:
        """A target that begins on the field."""
        values = self.part("motion", kind)
        (x, y), speeds = self.place(), [round(self.rng.gauss(0.0, self.side / 10), 3) for _ in range(2)]
        if kind == "waypoints":
            return {"kind": kind, "points": [[i * self.step, *self.place()] for i in range(self.rng.randint(2, 9))]}
        if kind == "recorded_track":
            return {"kind": kind, "path": RECORDED, "q": self.rng.choice([0.05, 1.0])}
        if kind == "random_waypoint":
            values.update(width=self.side, height=self.side, speed=[1.0, 1.0 + abs(speeds[0])], pause=[0.0, self.step])
        if kind in STARTS:
            values["start"] = [x, speeds[0], y, speeds[1], 0.1][: STARTS[kind]]
        if kind == "constant_velocity":
            values.update(course="free", noise_input="accelerations")
            values.pop("room", None)
        if kind == "gauss_markov":
            values.pop("box", None)
        return values

    def sensor(self, line: bool, tracker: str) -> Values:
        """A sensor that reaches over some of the field."""
        allowed = OF_LINES if line else ONLINE
        if tracker in ON_PLANES:
            allowed = ("range", "rssi")
        elif not line and not self.network:
            allowed = (*ONLINE, "coordinate", "range_from_origin")
        if self.network:
            allowed = tuple(name for name in allowed if name in ONLINE)
        if tracker in ONE_NUMBER:
            allowed = tuple(name for name in allowed if name != "range_bearing")
        kind = self.kind("sensor", *(info.kind for info in ROLES["sensor"].kinds if info.kind not in allowed))
        values = self.part("sensor", kind)
        if kind in ONLINE:
            values["reach"] = self.rng.choice([0.3, 0.6, 2.0]) * self.side
            values.pop("beyond", None)
            for name in ("biases", "gains", "nodes"):  # one for each node
                values.pop(name, None)
            values.pop("target_height", None)  # the nodes of a recording alone have heights
            values.pop("least", None)  # it is below the range
        return values

    def tracker(self, line: bool) -> Values:
        """A tracker with few particles; one of several motion models with its own in some cases."""
        values = self.part("tracker", self.kind("tracker", *(ON_PLANES if line else ("grid",))))
        values.pop("transition", None)
        if values["kind"] == "imm" and not line and self.rng.random() < 0.5:
            values["models"] = [{"kind": kind} for kind in ("constant_velocity", "coordinated_turn")]
        return values

    def of_network(self, tracker: str) -> Values:
        """The roles of a network that tracks."""
        values = self.radio()
        values["clusters"] = self.part("clusters", self.kind("clusters", "moving_head"))
        if tracker in PARTNERS and self.rng.random() < GUIDED:
            wakeup, main = PARTNERS[tracker]
            values.update(wakeup=self.part("wakeup", wakeup), clusters={"kind": "moving_head", "main": main})
            values["wakeup"].pop("speed", None)
        elif self.rng.random() < GUIDED:
            values["wakeup"] = {"kind": "none"}
        values["clusters"].pop("threshold", None)
        values.update(sink=self.sink(), acquire=self.acquire(), detection=self.part("detection"))
        values["workload"] = {"kind": "tracking"}
        if self.rng.random() < 0.5:
            values["faults"] = [self.fault() for _ in range(self.rng.randint(1, 3))]
        if self.rng.random() < 0.1:
            values["until"] = {"clusters": self.rng.randint(1, 3)}
        return values

    def radio(self) -> Values:
        """The roles of any network."""
        values: Values = {role: self.part(role) for role in PLAIN}
        values.update(energy=self.energy(), link=self.link(), mac=self.mac(), sleep=self.sleep(), cpu={})
        if values["mac"]["kind"] == "ideal":
            values["packing"] = {"kind": "none"}
        values["packing"].pop("most", None)
        if values["sync"]["kind"] == "ftsp" and self.rng.random() < GUIDED:
            values["clock"] = self.part("clock", "drift")
            values["sync"] = {"kind": "ftsp", "period": self.step, "root_timeout": self.rng.randint(1, 3)}
        if values["routing"]["kind"] == "ctp":
            values["routing"] = self.collection_tree()
            if "acks" in values["mac"]:
                values["mac"]["acks"] = True
        if values["mac"]["kind"] in MOSTLY_OFF and "period" in values["sleep"] and self.rng.random() < GUIDED:
            values["sleep"].update(period=max(values["sleep"]["period"], 4.0))
        if values["mac"]["kind"] == "tsch" and self.rng.random() < GUIDED:
            values.update(sync={"kind": "none"}, clock={"kind": self.rng.choice(["perfect", "drift"])})
        if values["energy"]["kind"] == "states":
            self.match(values)
        else:
            values["cpu"] = self.part("cpu")
        values["battery"] = self.battery()
        return values

    def battery(self) -> Values:
        """Batteries of any kind; their choice changes no other value."""
        rng = random.Random(self.turn)
        kind = rng.choice([info.kind for info in ROLES["battery"].kinds])
        values = {"kind": kind, "usable": rng.choice([1.0, 0.6]), "self_discharge": rng.choice([0.0, 0.9])}
        return values | ({"spread": 0.2} if rng.random() < 0.3 else {})

    def match(self, values: Values) -> None:
        """Give the radio the values of its datasheet."""
        sheets = values["energy"]
        if values["mac"]["kind"] != "ideal" or values["link"]["kind"] != "disk":
            sheets["radio"] = "cc2420"
            kept = ("kind", "interval", "near", "slotframe")
            values["mac"] = {name: value for name, value in values["mac"].items() if name in kept}
        values["mac"].pop("rate", None)

    def energy(self) -> Values:
        """Prices of any size, and batteries that may run out."""
        values = self.part("energy")
        if values["kind"] == "states":
            values.update({name: self.rng.choice(sheets) for name, sheets in SHEETS.items()})
            values.pop("power", None)
            values.pop("sleep_state", None)
        else:
            values["voltage"] = 1.5
            for name in ("idle", "sleep", "switch", "sensing"):
                values[name] = self.rng.choice([0.0, 0.0, 1e-6, 1e-3])
        values["battery"] = self.rng.choice([2.0, 2.0, 0.1, 0.02, 0.004])
        return values

    def link(self) -> Values:
        """A communication range of part of the field, or of all."""
        values = self.part("link")
        if values["kind"] == "disk":
            values["reach"] = self.rng.choice([0.4, 0.8, 1.5]) * self.side
            return values
        if values["kind"] == "recorded":
            return {
                "kind": "recorded", "path": RECORDED_LINKS, "channel": self.rng.randint(11, 26), "wrap": True,
                "map": self.rng.sample(range(50), self.nodes), "round_length": self.rng.choice([1.5, 10.0]) * self.step,
                "burstiness": values.get("burstiness", "none"), "reach": self.side,
            }  # fmt: skip
        kept = ("shadowing", "asymmetry", "cca_mode", "interference", "capture_margin")
        return {"kind": "log_normal", **{name: values[name] for name in kept if name in values}}

    def mac(self) -> Values:
        """A MAC with the times of its standard, in most cases."""
        values = self.part("mac")
        if values["kind"] == "ideal":
            return {"kind": "ideal", **({"rate": 250e3} if self.rng.random() < 0.4 else {})}
        if values["kind"] in MOSTLY_OFF and self.rng.random() < GUIDED:
            return self.mostly_off(values["kind"])
        return values if self.rng.random() < 0.2 else {"kind": values["kind"], "acks": self.rng.random() < 0.5}

    def mostly_off(self, kind: str) -> Values:
        """A MAC whose radios are off most of the time, with short and long intervals."""
        if kind == "tsch":
            return {"kind": kind, "slotframe": self.rng.choice([5, 11, 31])}
        interval = self.rng.choice([0.0625, 0.125, 0.25])
        near = {"near": interval / self.rng.choice([1, 2, 4])} if self.rng.random() < 0.3 else {}
        return {"kind": kind, "interval": interval, **near}

    def sleep(self) -> Values:
        """Periods of several steps."""
        values = self.part("sleep")
        if values["kind"] in ("ris", "duty_cycle"):
            values["period"] = self.rng.choice([1.0, 2.5, 4.0]) * self.step
        return values

    def sink(self) -> Values:
        """Reports at steps, from somewhere on the field."""
        kind = self.kind("sink")
        if kind == "none":
            return {"kind": "none"}
        x, y = self.place()
        where = {"points": [[x, y], [*self.place()]]} if kind == "nodes" else {"x": x, "y": y}
        return {"kind": kind, **where, "bits": self.rng.randint(1, 400), "every": self.step}

    def collection_tree(self) -> Values:
        """A collection tree whose tables and queues may be small, and whose beacons are not sent all the time."""
        least = self.rng.choice([0.128, 1.0])
        return {
            "kind": "ctp", "i_min": least, "i_max": least * self.rng.choice([1, 16, 4000]),
            "retries": self.rng.choice([0, 3, 32]), "hysteresis": self.rng.choice([0.0, 1.5]),
            "table": self.rng.choice([1, 3, 10]), "queue": self.rng.choice([1, 12]),
            "packet_time": self.rng.choice([0.0, 7e-3]), "patience": self.rng.choice([0.0, 10.0]),
            "places": self.rng.choice([1, 40]), "candidates": self.rng.choice([1, 3]),
        }  # fmt: skip

    def acquire(self) -> Values:
        """Track initiation, with a search at each step or at steps alone."""
        return {**self.part("acquire"), "poll": self.step} if self.rng.random() < 0.5 else {}

    def fault(self) -> Values:
        """Anything at any time, at a head, at some nodes or in a region."""
        kind = self.kind("fault")
        values = self.part("fault", kind)
        end = self.step * self.steps
        at = self.rng.choice([self.rng.uniform(0.0, end), self.step * self.rng.randrange(self.steps)])
        values.update(at=round(at, 6), duration=round(self.rng.uniform(0.0, end), 6))
        aims = {"head": 0, "nodes": [self.rng.randrange(self.nodes)], "fraction": 0.3, "region": [*self.place(), 30.0]}
        aim = self.rng.choice(list(aims))
        others = {*aims, *({"duration"} if kind == "drain" or self.rng.random() < 0.3 else ()), "joules", "value"}
        values = {name: value for name, value in values.items() if name not in others} | {aim: aims[aim]}
        if self.components and kind in ("bias", "stuck") and self.rng.random() < GUIDED:
            values["component"] = self.rng.choice(self.components)
        return {**values, "share": self.rng.choice([0.1, 0.9, 1.0])} if kind == "drain" else values


def sampled(number: int) -> Values:
    """The scenario of a number. The same number gives the same scenario."""
    return Sampler(number, random.Random(f"scenario {number}")).scenario()
