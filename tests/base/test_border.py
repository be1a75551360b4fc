"""What the components of plug-ins answer is checked: each wrong answer is one sentence with file and line."""

from __future__ import annotations

import importlib
import io
import operator
import signal
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import wsnsim
from wsnsim.base import border, mac_mechanisms, mechanisms, medium_access, network_ports, ports, radio, sleeping
from wsnsim.base.arrays import Estimate
from wsnsim.base.border import CheckedServices, checked
from wsnsim.base.errors import PluginAnswerError, RunError, UsageError
from wsnsim.base.plugin_code import note_plugin
from wsnsim.base.process import contained, limited, time_limit
from wsnsim.base.requests import Broadcast, Compute, Gather, GatherReadings, Local, Parcel, Scatter, Send
from wsnsim.cli import main
from wsnsim.experiment import simulate_run
from wsnsim.models.links import Disk
from wsnsim.models.motion import BoundedVelocity
from wsnsim.models.ranging import Range
from wsnsim.scenario import fields, registry
from wsnsim.trackers.ekf import ExtendedKalman

NAN = float("nan")
ONE, TWO = np.zeros((1, 2)), np.zeros((2, 2))
KEYS = np.arange(3, dtype=np.uint64)
RNG = np.random.default_rng(1)
GOOD = Estimate(np.zeros(4), np.eye(4))
OUTLOOK: Any = None


def plugin(base: type, name: str, answer: Any) -> Any:
    """A component of a plug-in, one method of which gives a wrong answer."""

    def method(self: Any, *arguments: Any, **options: Any) -> Any:
        return answer

    return type("Mine", (base,), {name: method})


async def _awaited() -> None:
    """What an async function returns without being awaited."""


WRONG: list[tuple[type, str, tuple[Any, ...], Any, str]] = [
    (ports.MotionModel, "truth", (5, 1.0, RNG), np.full((6, 4), NAN), "expected finite numbers, not nan (24 of 24)"),
    (ports.MotionModel, "truth", (5, 1.0, RNG), np.zeros((5, 4)), "shape (6, 4), not (5, 4)"),
    (ports.MotionModel, "truth", (5, 1.0, RNG), None, "expected an array of real numbers, not None"),
    (ports.MotionModel, "propagate", (np.zeros((4, 3)), 1.0, KEYS, 0.0), np.zeros((3, 4)), "shape (4, 3), not (3, 4)"),
    (ports.MotionModel, "advance", (np.zeros((4, 3)), 1.0, 0.0), np.full((4, 3), np.inf), "not inf (12 of 12)"),
    (ports.MotionModel, "matrices", (np.zeros((4, 3)), 1.0, 0.0), np.eye(4), "expected a tuple of 2"),
    (ports.MotionModel, "log_transition", (np.zeros((4, 3)), np.zeros((4, 3)), 1.0, 0.0), np.zeros(4), "not (4,)"),
    (ports.MotionModel, "assumed", (1.0,), 3, "expected a MotionModel, not 3, which lacks"),
    (ports.SensorModel, "measure", (TWO, TWO, TWO, np.zeros(2)), np.array([NAN, 1.0]), "not nan (1 of 2)"),
    (ports.SensorModel, "measure", (TWO, TWO, TWO, np.zeros(2)), np.zeros((2, 2)), "shape (2,), not (2, 2)"),
    (ports.SensorModel, "measure", (TWO, TWO, TWO, np.zeros(2)), np.array(["a", "b"]), "expected an array of real"),
    (ports.SensorModel, "draw_traits", (3, RNG), np.zeros((2, 0)), "shape (3, 0), not (2, 0)"),
    (ports.SensorModel, "log_likelihood", (TWO, np.zeros(2), TWO, TWO), np.array([0.0, NAN]), "not nan (1 of 2)"),
    (ports.SensorModel, "linearise", (TWO, TWO, TWO), (TWO, TWO, TWO), "number 2 of its tuple: expected an array of"),
    (ports.PriorModel, "draw", (np.zeros(4), RNG), Estimate(np.zeros(4), -np.eye(4)), "not positive semidefinite"),
    (ports.Acquire, "estimate", (ONE, ONE, ONE, 0, 0, GOOD), Estimate(np.zeros(2), np.eye(2)), "shape (4,), not (2,)"),
    (ports.Detection, "distort", (np.zeros(3), KEYS), np.zeros(2), "shape (3,), not (2,)"),
    (network_ports.Deployment, "draw", (50.0, RNG), np.array([[0.0, NAN]]), "not nan (1 of 2)"),
    (network_ports.Deployment, "draw", (50.0, RNG), np.zeros((4, 3)), "shape (N, 2), not (4, 3)"),
    (radio.EnergyModel, "transmit", (8.0, 1.0), (1.0, NAN), "number 2 of its tuple: expected a number, 0 or more, not"),
    (radio.EnergyModel, "compute", (8.0,), -1.0, "expected a number, 0 or more, not -1.0"),
    (radio.EnergyModel, "receive", (8.0,), "much", "expected a number, 0 or more, not 'much'"),
    (radio.LinkModel, "powers", (np.zeros(3), KEYS, KEYS), np.zeros(2), "shape (3,), not (2,)"),
    (radio.LinkModel, "reception", (np.zeros(3), 8.0, 0.0), np.full(3, NAN), "not nan (3 of 3)"),
    (radio.LinkModel, "senses", (np.zeros(3),), np.ones(3), "expected an array of truth values"),
    (radio.Cpu, "seconds", (9.0,), -1.0, "expected a number, 0 or more, not -1.0"),
    (radio.Clock, "rates", (KEYS,), np.ones(2), "shape (3,), not (2,)"),
    (sleeping.SleepSchedule, "awake", (KEYS, 0.0), np.zeros(3), "expected an array of truth values"),
    (sleeping.SleepSchedule, "tally", (KEYS, np.zeros(3), 1.0), np.zeros(3), "expected a tuple of 2"),
    (sleeping.WakeUp, "compose", (None, None), 5, "expected a WakeUpMessage, not 5"),
    (sleeping.WakeUp, "decide", ((0.0, 0.0), None, False, 1.0, 0.5), True, "expected a Decision, not True"),
    (network_ports.ClusterPolicy, "elect", ([3, 4], [1.0, 2.0], [True, True]), 5, "one of the nodes that it was given"),
    (
        network_ports.ClusterPolicy,
        "successor",
        (np.zeros(2), TWO, [True, True]),
        2,
        "one of the nodes that it was given",
    ),
    (network_ports.ClusterPolicy, "must_hand_over", (1, 2), None, "expected True or False, not None"),
    (medium_access.Packing, "packets", (8, 80), 2.5, "expected an integer, 0 or more, not 2.5"),
    (medium_access.Mac, "start", (None,), None, "expected a MacMechanism, not None, which lacks send, offer, silence"),
    (network_ports.FaultEvent, "start", (None,), 5, "expected a FaultMechanism, not 5, which lacks begin, end"),
    (network_ports.Workload, "start", (None,), 5, "expected a WorkloadMechanism, not 5, which lacks begin"),
    (sleeping.WakeUp, "start", (None,), 5, "expected a WakeUpMechanism, not 5, which lacks begin"),
    (mechanisms.TimeSync, "start", (None,), 5, "expected a SyncMechanism, not 5"),
    (mac_mechanisms.MacMechanism, "send", ([],), None, "expected a Signal, not None, which lacks succeed"),
    (mechanisms.SyncMechanism, "is_synchronised", (1,), "yes", "expected True or False, not 'yes'"),
    (ports.Tracker, "estimate", (None,), Estimate(np.zeros(4), np.eye(3)), "covariance: expected an array of shape"),
    (ports.Tracker, "estimate", (None,), Estimate(np.full(4, NAN), np.eye(4)), "the mean is not finite"),
    (ports.Tracker, "estimate", (None,), Estimate(np.full(4, 1e300), np.eye(4)), "the mean is not finite"),
    (ports.Tracker, "estimate", (None,), Estimate(np.zeros(4) + 1j, np.eye(4)), "the mean: expected an array of real"),
    (ports.Tracker, "estimate", (None,), 5, "expected an Estimate, not 5"),
    (ports.Tracker, "forecast", (None, None, 1), Estimate(np.zeros(4), -np.eye(4)), "not positive semidefinite"),
]


@pytest.mark.parametrize(("port", "method", "arguments", "answer", "said"), WRONG)
def test_a_wrong_answer_is_named_with_method_and_place(
    port: type, method: str, arguments: tuple[Any, ...], answer: Any, said: str
) -> None:
    base = {ports.MotionModel: BoundedVelocity, ports.SensorModel: Range}.get(port, object)
    component = checked(plugin(base, method, answer)(), port, columns=4)
    with pytest.raises(PluginAnswerError) as raised:
        getattr(component, method)(*arguments)
    text = str(raised.value)
    assert f"test_border.py:{plugin(base, method, 0).__dict__[method].__code__.co_firstlineno}: Mine.{method}: " in text
    assert said in text


class Slotted:
    """A detection of a plug-in whose instances have no dictionary."""

    __slots__ = ("answer", "probability")

    def __init__(self, answer: float) -> None:
        self.answer, self.probability = answer, 0.5

    def distort(self, readings: Any, keys: Any) -> Any:
        return readings * self.answer


@dataclass(frozen=True, slots=True)
class SlottedFields(Slotted):
    answer: float = 1.0


@pytest.mark.parametrize("kind", [Slotted, SlottedFields])
def test_a_component_with_slots_is_checked_too(kind: Any) -> None:
    right, wrong = (checked(kind(answer), ports.Detection) for answer in (2.0, NAN))
    assert right.answer == 2.0 and isinstance(right, kind) and type(right).__name__ == kind.__name__
    assert checked(right, ports.Detection) is right
    assert right.distort(np.ones(3), KEYS).tolist() == [2.0] * 3
    with pytest.raises(PluginAnswerError, match=r"test_border.py:\d+: Slotted.*.distort: expected finite numbers"):
        wrong.distort(np.ones(3), KEYS)


@pytest.mark.parametrize("method", ["measure", "estimate", "start", "decide"])
def test_an_async_method_is_said_as_what_it_is(method: str) -> None:
    port = {
        "measure": ports.SensorModel,
        "estimate": ports.Tracker,
        "start": medium_access.Mac,
        "decide": sleeping.WakeUp,
    }
    component = checked(plugin(object, method, _awaited())(), port[method])
    with pytest.raises(PluginAnswerError, match=r"coroutine.*of an async function"):
        getattr(component, method)(*[np.zeros(1)] * (1 if method == "start" else 5))


def test_a_property_that_is_not_what_the_port_says_is_refused_when_the_component_is_built() -> None:
    with pytest.raises(PluginAnswerError, match=r"Range.reach: expected a number, 0 or more, not nan"):
        checked(Range(reach=NAN), ports.SensorModel)


def test_a_model_is_not_blamed_for_arguments_that_are_not_finite() -> None:
    component = checked(plugin(BoundedVelocity, "advance", np.full((4, 1), NAN))(), ports.MotionModel)
    assert np.isnan(component.advance(np.full((4, 1), NAN), 1.0, 0.0)).all()


def test_right_answers_pass_and_the_component_stays_what_it_is() -> None:
    motion, link = checked(BoundedVelocity(), ports.MotionModel), checked(Disk(reach=60.0), radio.LinkModel)
    assert motion == BoundedVelocity() and type(motion) is BoundedVelocity and checked(motion, object) is motion
    assert motion.truth(5, 1.0, RNG).shape == (6, 4) and len(motion.matrices(np.zeros((4, 3)), 1.0, 0.0)) == 2
    assert motion.assumed(2.0).advance(np.zeros((4, 2)), 1.0, 0.0).shape == (4, 2)
    assert link.reception(link.powers(np.array([50.0]), KEYS[:1], KEYS[:1]), 8.0, 0.0).shape == (1,)


SHIPPED = sorted(path.stem for path in Path(wsnsim.__file__).parents[1].glob("scenarios/*.yaml"))
CHEAP = ("li_xmac", "ungm_pf", "two_targets", "recorded_pf")


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name in CHEAP else pytest.mark.thorough) for name in SHIPPED]
)
def test_the_components_of_wsnsim_pass_the_same_checks_and_give_the_same_run(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    short = {"duration": 8 * wsnsim.load(name).step}
    scenario = wsnsim.load(name, short)
    expected = simulate_run(scenario).run
    monkeypatch.setattr(border, "_if_foreign", lambda component, port, columns: checked(component, port, columns))
    found = simulate_run(scenario).run
    seconds = {"cpu_seconds"}
    assert found.keys() == expected.keys()
    assert all(np.array_equal(found[key], expected[key], equal_nan=True) for key in found.keys() - seconds)


# flows and requests

REQUESTS: list[tuple[Any, str]] = [
    (5, "5 is not a request; requests are Local, Compute"),
    (Compute(NAN), "Compute: not a number of cycles: expected a number from 0 to 1e+15, not nan"),
    (Compute(1e300), "Compute: not a number of cycles"),
    (Compute(-5), "Compute: not a number of cycles"),
    (Local(print, cycles=NAN), "Local: not a number of cycles"),
    (Local(5), "Local: expected functions as work and work_all, not 5"),  # type: ignore[arg-type]
    (Local(print, who=[1.5]), "Local: expected ids of nodes, not 1.5"),  # type: ignore[list-item]
    (Gather(None), "Gather: expected a function as parcel_of, not None"),  # type: ignore[arg-type]
    (Gather(lambda member: 5), "Gather: node 7: expected a Parcel, not 5"),  # type: ignore[arg-type, return-value]
    (GatherReadings(packet_bits=0), "GatherReadings: packet_bits: expected a number, 1 or more, not 0"),
    (GatherReadings(who=5), "GatherReadings: expected ids of nodes, not 5"),  # type: ignore[arg-type]
    (Scatter([1]), "Scatter: expected a mapping of ids to parcels, not [1]"),  # type: ignore[arg-type]
    (Scatter({-1: Parcel(1, 1, 8, "x")}), "Scatter: expected ids of nodes, not -1"),
    (Broadcast(Parcel(1, -1, 8, "x")), "Broadcast: parcel 'x': packets: expected an integer from 1 to 1e+06, not -1"),
    (Broadcast(Parcel(1, 10**9, 8, "x")), "Broadcast: parcel 'x': packets: expected an integer from 1 to 1e+06"),
    (Send(3, Parcel(1, 1, NAN, "x")), "Send: parcel 'x': packet_bits: expected a number, 1 or more, not nan"),  # type: ignore[arg-type]
    (Send(3, Parcel(1, 1, 8, "")), "Send: a parcel without a name"),
]


@pytest.mark.parametrize(("request_", "said"), REQUESTS, ids=range(len(REQUESTS)))
def test_a_wrong_request_is_refused_at_the_line_that_makes_it(request_: Any, said: str) -> None:
    class Asks(ExtendedKalman):
        def step(self, belief: Any, scene: Any) -> Any:
            yield request_

    flow = checked(Asks(), ports.Tracker).step(None, None)
    with pytest.raises(PluginAnswerError) as raised:
        flow.send(None).parcel_of(SimpleNamespace(id=7))
    line = Asks.step.__code__.co_firstlineno + 1
    assert f"test_border.py:{line}: Asks.step: {said}" in str(raised.value)


def _step(function: Callable[..., Any]) -> Any:
    return checked(type("Steps", (ExtendedKalman,), {"step": function})(), ports.Tracker).step(None, None)


def test_a_step_that_is_no_flow_or_gives_no_belief_is_refused() -> None:
    async def asynchronous(self: Any, belief: Any, scene: Any) -> None: ...

    def nothing(self: Any, belief: Any, scene: Any) -> Any:
        yield Compute(1)

    def leaves(self: Any, belief: Any, scene: Any) -> Any:
        yield Compute(1)
        raise GeneratorExit

    def endless(self: Any, belief: Any, scene: Any) -> Any:
        while True:
            yield Compute(0)

    for function, said in (
        (asynchronous, "expected a generator, a function with yield, not .*async"),
        (lambda self, belief, scene: 5, "expected a generator, a function with yield, not 5"),
        (nothing, "expected a belief, not None"),
        (leaves, "raises GeneratorExit"),
        (endless, "more than 10,000 requests in one step"),
    ):
        with pytest.raises(PluginAnswerError, match=rf"test_border.py:\d+: Steps.step:? {said}"):
            list(_step(function))


def test_a_flow_that_the_network_ends_is_closed() -> None:
    ended = []

    def waits(self: Any, belief: Any, scene: Any) -> Any:
        try:
            yield Compute(1)
        finally:
            ended.append(True)

    flow = _step(waits)
    assert flow.send(None) == Compute(1)
    flow.close()
    assert ended == [True]


# services


class Services:
    size = 3
    positions = np.zeros((3, 2))

    def call_later(self, seconds: float, action: Callable[[], None]) -> None: ...

    def send(self, node: int, to: int, bits: int) -> int:
        return bits

    def take_down(self, nodes: Any) -> None: ...

    def log_start(self, node: int, joules: float = 0.0) -> None: ...

    def step_clocks(self, nodes: Any, seconds: float) -> None: ...

    def set_loss(self, nodes: Any, probability: float) -> None: ...


@pytest.mark.parametrize(
    ("call", "arguments", "said"),
    [
        ("call_later", (-1.0, print), "seconds: expected a number, 0 or more, not -1.0"),
        ("call_later", (NAN, print), "seconds: expected a number, 0 or more, not nan"),
        ("call_later", (1.0, None), "action: expected a function, not None"),
        ("send", (3, 0, 8), "node: expected ids of nodes from 0 to 2, not 3"),
        ("send", (0, "1", 8), "to: expected ids of nodes from 0 to 2, not '1'"),
        ("send", (0, 1, 0), "bits: expected a number, 1 or more, not 0"),
        ("take_down", (np.array([0, 7]),), "nodes: expected ids of nodes from 0 to 2, not 7"),
        ("set_loss", (np.array([0]), 1.5), "probability: expected a number from 0 to 1, not 1.5"),
        ("log_start", (0, NAN), "joules: expected a number, 0 or more, not nan"),
    ],
)
def test_what_a_mechanism_asks_of_the_network_is_checked(call: str, arguments: tuple[Any, ...], said: str) -> None:
    with pytest.raises(PluginAnswerError) as raised:
        getattr(CheckedServices(Services()), call)(*arguments)
    assert str(raised.value).startswith(f"services.{call}: {said}")


def test_services_pass_on_what_is_right() -> None:
    services = CheckedServices(Services())
    assert services.send(0, to=2, bits=8) == 8 and services.positions is Services.positions
    services.log_start(-1)
    services.step_clocks(np.array([1]), -3.0)


# time limits


def swallow() -> None:
    while True:
        try:
            sum(range(100))
        except Exception:
            continue


def test_a_time_limit_ends_a_loop_that_swallows_exceptions() -> None:
    with pytest.raises(RunError, match=r"the run took more than 0.05 s"):
        limited(swallow, 0.05, "the run")
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)


def test_a_timer_that_fires_after_the_run_and_before_it_is_off_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    usual, set_timer = signal.getsignal(signal.SIGALRM), signal.setitimer

    def fires_before_it_is_off(which: int, seconds: float, *again: float) -> None:
        if not seconds:
            signal.raise_signal(signal.SIGALRM)
        set_timer(which, seconds, *again)  # type: ignore[arg-type]

    monkeypatch.setattr(signal, "setitimer", fires_before_it_is_off)
    assert limited(lambda: "done", 60.0, "the run") == "done"
    with pytest.raises(KeyError):
        limited(partial(operator.getitem, {}, 1), 60.0, "the run")
    assert signal.getsignal(signal.SIGALRM) == usual


@pytest.mark.parametrize("seconds", [0, -1.0, NAN, float("inf"), True, "5 s"])
def test_a_time_limit_is_a_number_of_seconds(seconds: Any) -> None:
    with pytest.raises(UsageError, match="timeout: expected a number of seconds greater than 0"):
        time_limit(seconds)
    with pytest.raises(UsageError, match="timeout"):
        wsnsim.run("ungm_pf", timeout=seconds)


# whole runs

LAB = """
import operator, os, sys
import numpy as np
from wsnsim import Compute, part
from wsnsim.models.ungm import Squared, Ungm
from wsnsim.models.access import Csma
from wsnsim.models.faults import Aimed
from wsnsim.models.energy import FirstOrder
from wsnsim.trackers.bootstrap_pf import Pf

@part
class Blind(Squared):
    def measure(self, points, positions, traits, noise):
        return noise * np.nan

@part
class Lost(Ungm):
    def truth(self, steps, dt, rng):
        return np.full((steps + 1, 1), np.nan)

@part
class Short(Ungm):
    def truth(self, steps, dt, rng):
        return np.zeros((steps, 1))

@part
class Free(Pf):
    def step(self, belief, scene):
        yield Compute(cycles=float("nan"))
        return belief

@part
class Exits(Pf):
    def step(self, belief, scene):
        os._exit(0)
        yield

@part
class Moves(Pf):
    def step(self, belief, scene):
        os.chdir("/")
        return (yield from super(Pf, self).step(belief, scene))

@part
class Loops(Pf):
    def step(self, belief, scene):
        while True: pass
        yield

@part
class Cheap(FirstOrder):
    def receive(self, bits):
        return float("nan")

@part
class Early(Aimed):
    mechanism = "early"
    def start(self, services):
        class Begins:
            def begin(self, nodes): services.call_later(-1.0, print)
            def end(self, nodes): pass
        return Begins()

@part
class Silent(Csma):
    mechanism = "silent"
    def start(self, services):
        return None

@part
class Leaves(Ungm):
    def truth(self, steps, dt, rng):
        os.chdir("/")
        return Ungm.truth(self, steps, dt, rng)

@part
class Closes(Pf):
    how: str = "stdout.close"
    def step(self, belief, scene):
        operator.attrgetter(self.how)(sys)()
        yield
"""
RUNS = [
    ("ungm_pf", ["sensor.kind=lab:Blind"], "lab.py:13: Blind.measure: expected finite numbers, not nan"),
    ("ungm_pf", ["motion.kind=lab:Lost"], "lab.py:18: Lost.truth: expected finite numbers, not nan"),
    ("ungm_pf", ["motion.kind=lab:Short"], "lab.py:23: Short.truth: expected an array of shape (6, 1), not (5, 1)"),
    ("ungm_pf", ["tracker.kind=lab:Free"], "lab.py:29: Free.step: Compute: not a number of cycles: expected a number"),
    ("ungm_pf", ["tracker.kind=lab:Exits"], "lab.py:35: calls os._exit(0), which ends the whole process"),
    ("ungm_pf", ["tracker.kind=lab:Moves"], "lab:Moves: leaves the working directory"),
    ("ungm_pf", ["tracker.kind=lab:Closes"], "lab.py:80: closes sys.stdout, which the whole process uses"),
    ("ungm_pf", ["tracker={kind: 'lab:Closes', how: stderr.close}"], "lab.py:80: closes sys.stderr, which the whole"),
    ("ungm_pf", ["tracker={kind: 'lab:Closes', how: stdout.buffer.close}"], "lab.py:80: closes sys.stdout, which"),
    ("ungm_pf", ["tracker={kind: 'lab:Closes', how: stdout.detach}"], "lab.py:80: closes sys.stdout, which the whole"),
    ("beacons", ["energy={kind: 'lab:Cheap'}"], "lab.py:52: Cheap.receive: expected a number, 0 or more, not nan"),
    ("beacons", ["faults=[{kind: 'lab:Early', at: 1.0, fraction: 0.2}]"], "services.call_later: seconds: expected a"),
    ("beacons", ["mac={kind: 'lab:Silent'}"], "lab.py:67: Silent.start: expected a MacMechanism, not None"),
]


@pytest.fixture
def lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "lab.py").write_text(LAB)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.setattr(registry, "SEARCHED", [])
    monkeypatch.delitem(sys.modules, "lab", raising=False)
    fields.part_model.cache_clear()


@pytest.mark.usefixtures("lab")
@pytest.mark.parametrize(("scenario", "changes", "said"), RUNS)
def test_a_run_with_a_wrong_answer_ends_with_one_sentence_and_no_file(
    scenario: str, changes: list[str], said: str, capfd: pytest.CaptureFixture[str]
) -> None:
    here = Path.cwd()
    words = [word for change in [*changes, "duration=6 s"] for word in ("--set", change)]
    assert main(["run", scenario, *words, "--quiet", "--replicates", "1", "--no-batch"]) == 1
    error = capfd.readouterr().err
    assert error.startswith("wsnsim: error: the run failed at ") and said in error and error.count("\n") == 1
    assert Path.cwd() == here and not list(Path("results").glob("*"))


@pytest.mark.usefixtures("lab")
@pytest.mark.parametrize("name", ["stdout", "stderr"])
def test_a_plugin_that_closes_a_stream_when_it_is_imported_is_said(
    name: str, capfd: pytest.CaptureFixture[str]
) -> None:
    with Path("lab.py").open("a") as lab:
        lab.write(f"sys.{name}.close()\n")
    assert main(["run", "ungm_pf", "--set", "tracker.kind=lab:Exits"]) == 2
    assert f"cannot be imported: lab.py:82: closes sys.{name}, which the whole process uses" in capfd.readouterr().err


def test_streams_may_be_closed_again_once_the_outermost_plugin_has_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    stream = io.TextIOWrapper(io.BytesIO())
    monkeypatch.setattr(sys, "stdout", stream)
    with contained(["lab:Outer"]):
        with contained(["lab:Inner"]):
            sys.stdout = io.StringIO()
        with pytest.raises(PluginAnswerError, match=r"closes sys\.stdout"):
            stream.close()
    assert sys.stdout is stream
    stream.close()
    assert stream.closed


@pytest.mark.usefixtures("lab")
def test_a_block_of_runs_is_contained_too(capfd: pytest.CaptureFixture[str]) -> None:
    words = ["--set", "motion.kind=lab:Leaves", "--set", "duration=6 s", "--quiet", "--replicates", "2"]
    assert main(["run", "ungm_pf", *words]) == 1
    assert capfd.readouterr().err.startswith("wsnsim: error: lab:Leaves: leaves the working directory")


@pytest.mark.usefixtures("lab")
def test_run_has_a_time_limit_for_each_run(capfd: pytest.CaptureFixture[str]) -> None:
    words = ["--set", "tracker.kind=lab:Loops", "--quiet", "--replicates", "1", "--timeout"]
    assert main(["run", "ungm_pf", *words, "500 ms"]) == 1
    assert "replicate 0) took more than 0.5 s" in capfd.readouterr().err
    assert main(["run", "ungm_pf", *words, "3 m"]) == 2
    assert "--timeout: 'm' is a unit of length" in capfd.readouterr().err


@pytest.mark.usefixtures("lab")
def test_a_time_limit_names_the_line_of_the_plugin_that_ran(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(Path.cwd()))
    module: Any = importlib.import_module("lab")
    note_plugin("lab")
    with pytest.raises(RunError, match=r"the run took more than 0.05 s \(at lab.py:47\)"):
        limited(partial(next, module.Loops().step(None, None)), 0.05, "the run")
