"""Components are imported by the names of their kinds, and stand in scenarios as they are."""

from __future__ import annotations

import importlib
import inspect
import subprocess
import sys

import pytest

import wsnsim
from tests.stubs import STUBS, stub
from wsnsim.base.errors import ScenarioError, UsageError
from wsnsim.base.facades import homes
from wsnsim.base.part import part
from wsnsim.models import CoordinatedTurn, DiskLink, RangeSensor
from wsnsim.scenario import build, resolved
from wsnsim.scenario.check import with_inner
from wsnsim.scenario.fields import names_of, part_model, roles_of
from wsnsim.scenario.kind_info import import_line
from wsnsim.scenario.python_values import values_of
from wsnsim.scenario.registry import ROLES, find, load_class
from wsnsim.scenario.schema import built
from wsnsim.trackers import Ekf, PsoMhpf

KINDS = [(role.name, info.kind) for role in ROLES.values() for info in role.kinds]


@pytest.mark.parametrize("package", ["wsnsim.trackers", "wsnsim.models"])
def test_a_package_hands_on_every_kind_and_class_of_the_registry(package):
    module = importlib.import_module(package)
    wanted = homes(package)
    classes = {tuple(info.path.split(":")) for role in ROLES.values() for info in role.kinds if package in info.path}
    assert sorted(module.__all__) == sorted(wanted) and classes == set(wanted.values())
    for name, (home, own) in wanted.items():
        assert getattr(module, name) is getattr(importlib.import_module(home), own), name
    with pytest.raises(AttributeError, match="did you mean"):
        getattr(module, sorted(wanted)[0] + "s")


def test_the_stubs_for_type_checkers_have_the_same_names():
    assert {package: path.read_text(encoding="utf-8") for package, path in STUBS.items()} == {
        package: stub(package) for package in STUBS
    }, "python -m tests.stubs writes them"


@pytest.mark.parametrize(("role", "kind"), KINDS)
def test_the_import_line_of_a_kind_gives_its_class(role, kind):
    names: dict[str, object] = {}
    exec(import_line(role, kind), names)
    names.pop("__builtins__")
    assert list(names.values()) == [load_class(find(role, kind))]


def test_names_are_those_that_a_reader_expects():
    lines = {import_line(*pair) for pair in KINDS}
    for line in ("trackers import PsoMhpf", "trackers import Ekf", "models import RangeSensor", "models import XMac"):
        assert f"from wsnsim.{line}" in lines
    assert len(lines) == len(KINDS), "no two kinds have one name"


def test_importing_a_component_imports_no_other():
    script = "import sys; from wsnsim.models import DiskLink; print('wsnsim.models.sensing' in sys.modules)"
    found = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "False"


@pytest.mark.thorough(fast=["fault-blackout"])
@pytest.mark.parametrize(("role", "kind"), KINDS)
def test_a_component_survives_its_form_in_a_scenario(role, kind):
    cls = load_class(find(role, kind))
    try:
        component = cls()
    except (UsageError, ValueError):
        pytest.skip("has no default for some parameter: shipped scenarios have it")
    values = values_of(component, role)
    assert values["kind"] == kind
    inner = tuple((field, part_model(one.role, values[field]["kind"])) for field, one in roles_of(cls).items()
                  if not one.several and values.get(field))  # fmt: skip
    assert built(with_inner(part_model(role, kind), inner).model_validate(values)) == component


@pytest.mark.thorough(fast=["two_targets"])
@pytest.mark.parametrize("name", ["ekf_real", "li_tsch", "recorded_network", "imm", "two_targets"])
def test_every_component_of_a_scenario_can_stand_in_a_dict(name):
    loaded = wsnsim.load(name)
    setup = build(loaded)
    roles = {role.name: getattr(setup, role.name, None) for role in ROLES.values() if hasattr(loaded, role.name)}
    roles |= {"sensor": getattr(setup, "recorded", None) or setup.sensor, "targets": setup.motions, "motion": None}
    given = {role: component for role, component in roles.items() if component is not None}
    again = wsnsim.load({**{key: value for key, value in resolved(loaded).items() if key != "motion"}, **given})
    assert build(again).tracker == setup.tracker
    assert {key: value for key, value in resolved(again).items() if key not in ("motion", "targets", "tracker")} == {
        key: value for key, value in resolved(loaded).items() if key not in ("motion", "targets", "tracker")
    }
    assert build(again).motions == setup.motions


def test_components_nest_and_an_extending_dict_takes_them_whole():
    small = wsnsim.load({"extends": "pso_mhpf", "tracker": PsoMhpf(particles=200), "link": DiskLink(reach=60.0)})
    assert build(small).tracker == PsoMhpf(particles=200)
    assert wsnsim.load(resolved(small)) == small
    base = {"extends": "pso_mhpf", "tracker": {"particles": 77}}
    assert wsnsim.load(base, {"tracker": PsoMhpf()}).tracker.particles == PsoMhpf().particles
    recorded = wsnsim.load("recorded_network", {"sensor.law": RangeSensor(sd=3.0)})
    assert recorded.sensor.law.sd == 3.0
    targets = wsnsim.load("pso_mhpf", {"motion": CoordinatedTurn(), "tracker": Ekf()})
    assert targets.motion.kind == "coordinated_turn"
    assert targets.overrides[0].startswith('motion={"kind": "coordinated_turn"')
    assert wsnsim.load("pso_mhpf", targets.overrides) == targets, "the command line takes them as they are stored"


@part
class Odd(PsoMhpf):
    """A plug-in of this module."""


def test_a_class_of_ones_own_is_named_by_its_path():
    assert wsnsim.load("pso_mhpf", {"tracker": Odd()}).tracker.kind == f"{__name__}:Odd"

    @part
    class Hidden(PsoMhpf):
        pass

    with pytest.raises(ScenarioError, match="Hidden is defined in a function: define it at the top of a module"):
        wsnsim.load("pso_mhpf", {"tracker": Hidden()})
    with pytest.raises(ScenarioError, match="tracker: error: a object is not allowed"):
        wsnsim.load("pso_mhpf", {"tracker": object()})


@pytest.mark.parametrize(("role", "kind"), KINDS)
def test_a_wrong_parameter_of_a_component_is_refused_with_the_names_of_the_right_ones(role, kind):
    made = load_class(find(role, kind))
    known = names_of(made)
    with pytest.raises(UsageError, match=rf"^{made.__name__}\(\): there is no parameter 'zzz' \(.+\)$") as unknown:
        made(zzz=3)
    assert set(str(unknown.value).partition("known: ")[2].removesuffix(")").split(", ")) in (set(known), {""})
    with pytest.raises(UsageError, match=rf"^{made.__name__}\(\): .+, got 3 without a name$"):
        made(3)
    for name in known[:1]:
        with pytest.raises(UsageError, match=rf"'{name}_' \(did you mean '{name}'"):
            made(**{f"{name}_": 3})


def test_parameters_that_are_needed_are_named_and_errors_of_a_component_itself_are_not_renamed():
    @part
    class Scaled:
        factor: float
        offset: float = 0.0

        def __post_init__(self) -> None:
            self.factor + 1.0

    with pytest.raises(UsageError, match=r"^Scaled\(\): needs a value of factor$"):
        Scaled()
    with pytest.raises(TypeError, match="unsupported operand"):
        Scaled(factor=None)
    assert list(inspect.signature(Scaled).parameters) == ["factor", "offset"]
