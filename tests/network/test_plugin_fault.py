"""A fault from outside the package: it does harm in a run, and `check_fault` accepts or refuses it."""

from typing import Annotated, ClassVar

import pytest

import wsnsim
from wsnsim.base.errors import RunError, ScenarioError
from wsnsim.base.part import Quantity, part
from wsnsim.models.faults import Aimed, Bias, Blackout, ClockStep, Crash, Drain, LinkLoss, Restart, Stuck
from wsnsim.scenario.registry import kinds
from wsnsim.testing import check_fault

HEAT = f"{__name__}:Overheating"


@part
class Overheating(Aimed):
    """A node loses charge at regular intervals, and crashes after the third."""

    mechanism: ClassVar[str] = "overheating"
    joules: Annotated[float, Quantity("J", gt=0.0), "charge lost at a time"] = 0.01

    def start(self, services):
        return Overheater(services, self.joules)


class Overheater:
    def __init__(self, services, joules):
        self.services = services
        self.joules = joules

    def begin(self, nodes):
        for node in nodes.tolist():
            self.services.log_start(node)
        self.lose(nodes, times=3)

    def lose(self, nodes, times):
        if times == 0:
            self.services.take_down(nodes)
            return
        for node in nodes.tolist():
            if self.services.is_up(node):
                self.services.drain(node, self.joules)
        self.services.call_later(0.1, lambda: self.lose(nodes, times - 1))

    def end(self, nodes):
        self.services.bring_up()
        for node in nodes.tolist():
            self.services.log_end(node)


def run(tmp_path, *faults):
    changes = ["duration=2 s", f"faults=[{', '.join(faults)}]", "record.events=true"]
    out = tmp_path / "run.h5"
    wsnsim.run(wsnsim.load("pso_mhpf", changes), replicates=1, out=out)
    events, energy = wsnsim.read(out, "events"), wsnsim.read(out, "energy")
    return events[events.kind.isin(["fault", "crash", "restart"])], energy[energy.cause == "leak"]


def test_a_plugin_fault_named_in_a_scenario_does_harm_and_passes(tmp_path):
    events, leaks = run(tmp_path, f"{{kind: '{HEAT}', at: 0.5 s, duration: 1 s, nodes: [3, 5], joules: 0.125}}")
    rows = list(zip(events.time.round(6), events.kind, events.what, events.node, strict=True))
    assert rows == [
        (0.5, "fault", "overheating", 3),
        (0.5, "fault", "overheating", 5),
        (0.8, "crash", "none", 3),
        (0.8, "crash", "none", 5),
        (1.5, "restart", "none", 3),
        (1.5, "restart", "none", 5),
        (1.5, "fault", "overheating_over", 3),
        (1.5, "fault", "overheating_over", 5),
    ]
    assert leaks.node.tolist() == [3, 5] and leaks.joules.tolist() == [0.375, 0.375]


@pytest.mark.thorough
def test_a_plugin_fault_and_a_crash_of_the_same_node_hold_it_down_until_both_have_passed(tmp_path):
    events, _ = run(
        tmp_path,
        f"{{kind: '{HEAT}', at: 0.5 s, duration: 1 s, nodes: [3]}}",
        "{kind: crash, at: 0.6 s, duration: 0.6 s, nodes: [3]}",
    )
    changes = events[events.kind != "fault"]
    assert list(zip(changes.time.round(6), changes.kind, strict=True)) == [(0.6, "crash"), (1.5, "restart")]


def test_the_fields_of_a_plugin_fault_are_checked():
    with pytest.raises(ScenarioError, match="joules"):
        wsnsim.load("pso_mhpf", [f"faults=[{{kind: '{HEAT}', at: 1 s, nodes: [3], joules: -1}}]"])


CATALOGUE = {
    "crash": Crash(at=1.0, duration=2.0, nodes=(3, 5)),
    "restart": Restart(at=0.0, fraction=0.05),
    "drain": Drain(at=1.0, head=0, joules=0.5),
    "blackout": Blackout(at=1.0, duration=0.5, region=(50.0, 0.0, 3.0)),
    "link_loss": LinkLoss(at=1.0, nodes=(20,), loss=0.2),
    "clock_step": ClockStep(at=1.0, duration=5.0, fraction=1.0, offset=-0.2),
    "stuck": Stuck(at=1.0, duration=1.0, nodes=(1,)),
    "bias": Bias(at=1.0, duration=1.0, nodes=(1,), offset=0.5),
}


def test_the_faults_checked_here_are_those_of_the_catalogue():
    assert set(CATALOGUE) == set(kinds("fault"))


@pytest.mark.parametrize("fault", [*CATALOGUE.values(), Overheating(at=1.0, duration=2.0, nodes=(2,))])
def test_every_fault_of_the_catalogue_and_the_plugin_keep_the_contract(fault):
    check_fault(fault)


class Silent(Overheater):
    def begin(self, nodes):
        self.lose(nodes, times=3)


class Harmless(Overheater):
    def lose(self, nodes, times):
        pass

    def end(self, nodes):
        pass


class Endless(Overheater):
    def end(self, nodes):
        pass


class Fickle(Overheater):
    uses = 0

    def lose(self, nodes, times):
        Fickle.uses += 1
        super().lose(nodes[: Fickle.uses % 2], times=0)


@pytest.mark.parametrize(
    ("broken", "message"),
    [
        (Silent, "'log'.*aimed at .2, 3., but the log names"),
        (Harmless, "'harm'.*nothing changes"),
        (Endless, "'end'.*still changed"),
        (Fickle, "'repeatable'.*other events"),
    ],
)
def test_a_fault_that_breaks_the_contract_is_refused(broken, message, monkeypatch):
    monkeypatch.setattr(Overheating, "start", lambda self, services: broken(services, self.joules))
    with pytest.raises(AssertionError, match=message):
        check_fault(Overheating(at=1.0, duration=2.0, nodes=(2, 3)))


def test_a_fault_that_hits_no_node_is_refused():
    with pytest.raises(AssertionError, match=r"'aim'.*hits no node"):
        check_fault(Overheating(at=1.0))


@part
class Hollow(Crash):
    """A fault whose mechanism can do nothing."""

    mechanism: ClassVar[str] = "hollow"

    def start(self, services):
        return object()


def test_a_mechanism_that_lacks_members_is_refused_by_name():
    fault = f"faults=[{{kind: '{__name__}:Hollow', at: 0.1 s, nodes: [1]}}]"
    said = r"Hollow\.start: expected a FaultMechanism, not <object .*>, which lacks begin, end"
    with pytest.raises(RunError, match=said):
        wsnsim.experiment.simulate_run(wsnsim.load("pso_mhpf", ["duration=0.4 s", fault]))
