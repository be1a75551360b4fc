"""What a scenario may say: pydantic models made from the parts' own fields, and the check of a tree against them.

    validate(tree) -> (Scenario or None, faults)

Which kinds a scenario chooses is settled first; the model for exactly these kinds then finds every fault in one pass.
"""

from __future__ import annotations

import functools
import re
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, ClassVar, Final, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    PrivateAttr,
    ValidationError,
    ValidationInfo,
    create_model,
    field_validator,
    model_validator,
)

from wsnsim.base import ports
from wsnsim.base.errors import Fault
from wsnsim.base.part import Quantity
from wsnsim.base.tables import RECORDED_BY_DEFAULT
from wsnsim.scenario.catalog import ROLES, find, load_class
from wsnsim.scenario.fields import Number, PartError, Strict, described, fields_of, refusal
from wsnsim.scenario.messages import faults_of
from wsnsim.scenario.tree import BROKEN, Entry, Keys, Node, Spot, Text, child, mapping, plain, spot_of
from wsnsim.scenario.units import shown

MOST_STEPS: Final = 100_000_000
SHORT_FORMS: Final = {"gains": "gains", "inflate": "inflate", "filter_noise_scale": "noise_scale"}
SAFE_NAME: Final = re.compile(r"\w[\w.\-]{0,99}")
_FROZEN: Final = ConfigDict(extra="forbid", frozen=True, validate_default=True, protected_namespaces=())

_Flag = Annotated[bool, Strict("bool")]
_Scale = Annotated[float, Number(Quantity("", gt=0))]


def is_safe_name(name: str) -> bool:
    """Whether a name can be that of a file in any folder, as it stands."""
    return SAFE_NAME.fullmatch(name) is not None


def _safe_name(name: str) -> str:
    if not is_safe_name(name):
        raise refusal(f"{shown(name)} cannot name a file: use letters, digits, '_', '-' and '.', beginning with a letter or digit")
    return name


class PartModel(BaseModel):
    """The fields of one kind; `part` is its class."""

    model_config = _FROZEN
    part: ClassVar[type[Any]]


def built(model: PartModel) -> Any:
    """The part itself. Raises what its class raises."""
    return model.part(**{name: getattr(model, name) for name in fields_of(model.part)})


class Assumes(BaseModel):
    """What the filter believes of the truth's models."""

    model_config = _FROZEN
    gains: Literal["known", "unknown"] = Field("known", description="whether the filter knows each sensor's gain")
    inflate: _Flag = Field(False, description="widen the reading's variance for unknown gains")
    noise_scale: _Scale = Field(1.0, description="factor on the filter's process covariance")


class TrackerModel(PartModel):
    """A tracker's fields, and what its filter assumes, in full or in short forms; the short forms are folded into `assumes`."""

    assumes: Assumes = Field(Assumes(), description="what the filter believes of the truth's models")
    gains: Literal["known", "unknown"] | None = Field(None, exclude=True, description="short for assumes.gains")
    inflate: _Flag | None = Field(None, exclude=True, description="short for assumes.inflate")
    filter_noise_scale: _Scale | None = Field(None, exclude=True, description="short for assumes.noise_scale")

    @model_validator(mode="after")
    def _fold(self) -> TrackerModel:
        own = fields_of(self.part)
        short = {name: value for name in SHORT_FORMS if name not in own and (value := getattr(self, name)) is not None}
        if not short:
            return self
        twice = [name for name in short if SHORT_FORMS[name] in self.assumes.model_fields_set]
        if twice:
            raise refusal(f"'{twice[0]}' and 'assumes.{SHORT_FORMS[twice[0]]}' say the same: give one of them")
        folded = self.assumes.model_copy(update={SHORT_FORMS[name]: value for name, value in short.items()})
        return self.model_copy(update={"assumes": folded, **dict.fromkeys(short)})


class Until(BaseModel):
    """What ends a run before its duration does."""

    model_config = _FROZEN
    clusters: Annotated[int, Number(Quantity("", ge=1), whole=True)] = Field(description="end once so many clusters have formed")


Record: Final[type[BaseModel]] = create_model(
    "Record", __config__=_FROZEN, **{name: (_Flag, default) for name, default in RECORDED_BY_DEFAULT.items()}
)  # type: ignore[call-overload]


class Scenario(BaseModel):
    """A scenario, every key checked: one model a role (`scenario.deploy.nodes`), numbers in SI units, frozen.

    The roles' fields come with the kinds chosen: see `scenario_model`. Two scenarios are equal if they say the same, wherever they
    were read.
    """

    model_config = _FROZEN
    name: Annotated[str, AfterValidator(_safe_name), Strict("str")] = Field(description="name, also of the result's file")
    seed: Annotated[int, Number(Quantity("", ge=0), whole=True)] = Field(0, description="seed of every random stream")
    replicates: Annotated[int, Number(Quantity("", ge=1), whole=True)] = Field(1, description="how many runs, each its own draws")
    step: Annotated[float, Number(Quantity("s", gt=0), finite=True)] = Field(0.04, description="time between readings [s]")
    duration: Annotated[float, Number(Quantity("s", gt=0), finite=True)] = Field(description="simulated time [s]")
    until: Until | None = Field(None, description="what ends a run before its duration does")
    record: Record = Field(Record(), description="which tables the result holds")  # type: ignore[valid-type]

    _tree: Node = PrivateAttr()
    _source: tuple[str, str] = PrivateAttr(("", ""))

    @field_validator("duration")
    @classmethod
    def _whole_steps(cls, duration: float, info: ValidationInfo) -> float:
        step = info.data.get("step")
        if step is None:
            return duration
        steps = round(min(duration / step, 1e18))
        if not 1 <= steps <= MOST_STEPS:
            raise refusal(f"{duration:g} s is {steps:g} steps of {step:g} s; 1 to {MOST_STEPS:g} are allowed")
        if abs(duration - steps * step) > 1e-9 * duration:
            raise refusal(f"{duration:.12g} s is no whole number of steps of {step:g} s (nearest: {steps * step:.12g} s)")
        return duration

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and self.__dict__ == other.__dict__

    @property
    def steps(self) -> int:
        """How many steps follow the start."""
        return round(self.duration / self.step)

    @property
    def targets_given(self) -> tuple[tuple[Keys, PartModel], ...]:
        """Each target's motion, with the path under which it is written."""
        motion = getattr(self, "motion", None)
        if motion is not None:
            return ((("motion",), motion),)
        return tuple((("targets", i), model) for i, model in enumerate(getattr(self, "targets", ())))

    @property
    def source_yaml(self) -> str:
        """The text that the scenario was read from, as it was."""
        return self._source[1]

    @property
    def file(self) -> str:
        """The name of the file that it was read from; '' for a dict."""
        return self._source[0]

    def spot(self, path: Keys) -> Spot:
        """Where the value at a path is written, or the nearest thing around it."""
        return spot_of(self._tree, path)


Chosen = tuple[tuple[str, tuple[type[PartModel], ...]], ...]


@functools.cache
def part_model(role: str, kind: str) -> type[PartModel]:
    """The model of one kind.

    Raises:
        LookupError: no such kind. ImportError: its module fails. PartError: its class cannot stand behind the role.
    """
    row = find(role, kind)
    part = load_class(row)
    try:
        fields = fields_of(part)
        _demand_port(part, role)
        if "kind" in fields or {"assumes", "part"} & set(fields):
            raise PartError("has a field named 'kind', 'assumes' or 'part', which are taken")
        choice: Any = (Literal[kind], kind) if kind == ROLES[role].default else (Literal[kind], ...)
        base = TrackerModel if role == "tracker" else PartModel
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a part may call a field 'copy', which pydantic would rather not
            model: Any = create_model(part.__name__, __base__=base, __module__=part.__module__, kind=choice, **fields)  # type: ignore[call-overload]
    except PartError as error:
        raise PartError(f"{row.path} {error}" if str(error).startswith(("is", "has", "lacks")) else f"{row.path}: {error}") from None
    model.part = part
    return model


def _demand_port(part: type[Any], role: str) -> None:
    port = getattr(ports, ROLES[role].port, None)
    needed = [name for name, thing in vars(port).items() if callable(thing) and not name.startswith("_")] if port else []
    lacking = [name for name in needed if not callable(getattr(part, name, None))]
    if lacking:
        raise PartError(f"lacks {', '.join(repr(name) for name in lacking)}, which every {role} needs")


@functools.cache
def scenario_model(chosen: Chosen) -> type[Scenario]:
    """The model of scenarios with exactly these kinds."""
    fields: dict[str, Any] = {}
    for role, models in chosen:
        if role == "targets":
            fields[role] = (tuple[models], Field(description="how each target moves"))  # type: ignore[valid-type]
        else:
            fields[role] = (models[0], Field(description=ROLES[role].purpose))
    return create_model("Scenario", __base__=Scenario, **fields)


def validate(tree: Node) -> tuple[Scenario | None, list[Fault]]:
    """The scenario that a tree says, or every fault of it."""
    if not isinstance(tree.value, dict):
        return None, [] if tree.value is BROKEN else [tree.spot.fault((), f"expected keys such as 'name', got {described(plain(tree))}")]
    tree = _with_defaults(tree)
    chosen, faults = _choose(tree)
    settled = {role for role, _ in chosen}
    model = scenario_model(chosen)
    data = _located(tree, chosen)
    for role in (*ROLES, "targets"):
        if role not in settled:
            data.pop(role, None)
    try:
        scenario = model.model_validate(data)
    except ValidationError as error:
        return None, faults + faults_of(error, model, tree)
    scenario._tree = tree
    return (None if faults else scenario), faults


def _with_defaults(tree: Node) -> Node:
    """The tree with an empty mapping for each role that is left out and has a default kind."""
    missing = {name: Entry(tree.spot, Node({}, tree.spot)) for name, role in ROLES.items() if role.default}
    return mapping(missing | tree.value, tree.spot)


def _choose(tree: Node) -> tuple[Chosen, list[Fault]]:
    """Each role's model, by its kind; a role whose kind is at fault is left out."""
    chosen: dict[str, tuple[type[PartModel], ...]] = {}
    faults: list[Fault] = []
    for name, path_and_node in _role_nodes(tree, faults):
        found = [_model_at(node, path, faults) for path, node in path_and_node]
        if found and all(found):
            chosen[name] = tuple(model for model in found if model)
    return tuple(chosen.items()), faults


def _role_nodes(tree: Node, faults: list[Fault]) -> Iterator[tuple[str, list[tuple[Keys, Node]]]]:
    """(role, its mappings with their paths); `targets` has several."""
    targets = child(tree, "targets")
    for role in ROLES:
        node = child(tree, role)
        if role == "motion" and targets is not None:
            if node is not None:
                faults.append(spot_of(tree, ("targets",), True).fault(("targets",), "give either 'motion' or 'targets', not both"))
            yield "targets", _target_nodes(targets, faults)
        elif node is None:
            also = " (or 'targets', a list of them)" if role == "motion" else ""
            faults.append(tree.spot.fault((role,), f"is missing: {ROLES[role].purpose}{also}"))
        else:
            yield role, [((role,), node)]


def _target_nodes(targets: Node, faults: list[Fault]) -> list[tuple[Keys, Node]]:
    if not isinstance(targets.value, list) or not targets.value:
        if targets.value is not BROKEN:
            faults.append(targets.spot.fault(("targets",), f"expected a list of motions, got {described(plain(targets) or None)}"))
        return []
    return [(("targets", i), node) for i, node in enumerate(targets.value)]


def _model_at(node: Node, path: Keys, faults: list[Fault]) -> type[PartModel] | None:
    role = ROLES["motion" if path[0] == "targets" else str(path[0])]
    kind_path = (*path, "kind")
    written = child(node, "kind")
    if node.value is BROKEN or (written is not None and written.value is BROKEN):
        return None
    if not isinstance(node.value, dict):
        example = role.default or role.rows[0].kind
        faults.append(node.spot.fault(path, f"expected a mapping such as {{kind: {example}}}, got {described(plain(node))}"))
        return None
    kind = plain(written) if written else role.default
    if not isinstance(kind, str):
        problem = f"expected the name of a kind, got {described(kind)}" if written else f"is missing; {_known(role.name)}"
        faults.append((written or node).spot.fault(kind_path, problem))
        return None
    try:
        return part_model(role.name, kind)
    except (LookupError, ImportError, PartError) as error:
        faults.append((written or node).spot.fault(kind_path, str(error.args[0])))
        return None


def _known(role: str) -> str:
    return "known: " + ", ".join(row.kind for row in ROLES[role].rows)


def _located(tree: Node, chosen: Chosen) -> dict[str, Any]:
    """The plain values, with each part's file names (fields `path`, `..._path`) taken from the folder of the text they stand in."""
    data: dict[str, Any] = plain(tree)
    for role, (model, *_) in chosen:
        for field in fields_of(model.part):
            node = child(child(tree, role) or tree, field)
            if (field == "path" or field.endswith("_path")) and node is not None and isinstance(node.value, str) and node.value:
                data[role][field] = str(_absolute(node.spot.text, node.value))
    return data


def _absolute(text: Text, name: str) -> Path:
    return (text.folder / name).resolve()
