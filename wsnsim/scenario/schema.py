"""The pydantic models of scenarios, made from the fields of the components.

part_model(role, kind) -> the model of one kind      scenario_model(chosen) -> the model of scenarios of these kinds
built(model) -> the component
"""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Collection
from typing import Annotated, Any, Final, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    Field,
    PrivateAttr,
    ValidationInfo,
    create_model,
    field_validator,
    model_validator,
)

from wsnsim.base import metrics
from wsnsim.base.files import LARGEST_NAME, LONGEST_ADDITION, is_too_long
from wsnsim.base.part import Quantity
from wsnsim.base.tables import RECORDED_BY_DEFAULT
from wsnsim.scenario.fields import (
    FROZEN,
    Number,
    PartError,
    PartModel,
    Strict,
    demand_port,
    fields_of,
    made_model,
    names_of,
    refusal,
)
from wsnsim.scenario.located_values import Keys, LocatedValue, Spot, spot_of
from wsnsim.scenario.registry import AT_TOP, ROLES, Role, Scope, find, load_class
from wsnsim.scenario.units import shown

MOST_STEPS: Final = 10_000_000
SHORT_FORMS: Final = {"gains": "gains", "inflate": "inflate", "filter_noise_scale": "noise_scale"}
SAFE_CHARACTERS: Final = re.compile(r"\w[\w.\-]*")
MOST_CHARACTERS: Final = 100
"""Characters of a name; the limit in bytes follows from temporary names."""
WITHOUT_TARGETS: Final = ("beacons", "collection")
"""The kinds of the built-in workloads without targets."""
TRACKING: Final = "tracking"
"""The mechanism of the workload with targets; every other workload has none."""

_Flag = Annotated[bool, Strict("bool")]
_Scale = Annotated[float, Number(Quantity("", ge=1e-9, le=1e9))]


def is_safe_name(name: str) -> bool:
    """Return whether a name is a valid file name on every system, with a suffix and as a temporary name."""
    return len(name) <= MOST_CHARACTERS and SAFE_CHARACTERS.fullmatch(name) is not None and not is_too_long(name)


def unsafe_name(name: str, what: str) -> str:
    """Return why a name cannot be that of `what` ('a file'), and what is allowed; '' if it can."""
    if is_safe_name(name):
        return ""
    if SAFE_CHARACTERS.fullmatch(name):
        most = LARGEST_NAME - LONGEST_ADDITION
        return f"is too long to name {what}: at most {MOST_CHARACTERS} characters and {most} bytes are allowed"
    return f"cannot name {what}: use letters and digits, then also '_', '-' and '.'"


def _safe_name(name: str) -> str:
    if reason := unsafe_name(name, "a file"):
        raise refusal(f"{shown(name)} {reason}")
    return name


class InvalidComponent(Exception):
    """A component refuses its values.

    Attributes:
        path: where the component is in the scenario; or its key that the reason begins with, as in 'room: ...'.
    """

    def __init__(self, path: Keys, reason: Exception, keys: Collection[str] = ()) -> None:
        text = str(reason) or type(reason).__name__
        key, _, rest = text.partition(": ")
        named = key in keys and rest != ""
        super().__init__(rest if named else text)
        self.path = (*path, key) if named else path


def built(model: PartModel, path: Keys = ()) -> Any:
    """Return the component of a model, with the components within it.

    Raises:
        InvalidComponent: a class refuses its values.
    """
    values = {name: _built_within(getattr(model, name), (*path, name)) for name in names_of(model.part)}
    try:
        return model.part(**values)
    except (ValueError, TypeError) as reason:
        raise InvalidComponent(path, reason, names_of(model.part)) from reason


def _built_within(value: Any, path: Keys) -> Any:
    if isinstance(value, tuple):
        return tuple(_built_within(item, (*path, i)) for i, item in enumerate(value))
    return built(value, path) if isinstance(value, PartModel) else value


class Assumes(BaseModel):
    """What the filter assumes about the models of the ground truth."""

    model_config = FROZEN
    gains: Literal["known", "unknown", "estimated"] = Field(
        "known", description="whether the filter knows each sensor's gain, ignores it or estimates it beside the state"
    )
    inflate: _Flag = Field(False, description="widen the reading's variance for unknown gains and shadowing")
    noise_scale: _Scale = Field(1.0, description="factor on the filter's process covariance")


class TrackerModel(PartModel):
    """The model of a tracker, with the assumptions of its filter; short forms are merged into `assumes`."""

    assumes: Assumes = Field(
        Assumes.model_construct(), description="what the filter assumes about the models of the ground truth"
    )
    gains: Literal["known", "unknown", "estimated"] | None = Field(
        None, exclude=True, description="short for assumes.gains"
    )
    inflate: _Flag | None = Field(None, exclude=True, description="short for assumes.inflate")
    filter_noise_scale: _Scale | None = Field(None, exclude=True, description="short for assumes.noise_scale")

    @model_validator(mode="after")
    def _fold(self) -> TrackerModel:
        own = names_of(self.part)
        short = {name: value for name in SHORT_FORMS if name not in own and (value := getattr(self, name)) is not None}
        if not short:
            return self
        twice = [name for name in short if SHORT_FORMS[name] in self.assumes.model_fields_set]
        if twice:
            raise refusal(f"'{twice[0]}' and 'assumes.{SHORT_FORMS[twice[0]]}' are the same: give one of them")
        folded = self.assumes.model_copy(update={SHORT_FORMS[name]: value for name, value in short.items()})
        return self.model_copy(update={"assumes": folded, **dict.fromkeys(short)})


class Until(BaseModel):
    """A condition that ends a run before its duration."""

    model_config = FROZEN
    clusters: Annotated[int, Number(Quantity("", ge=1), whole=True)] = Field(
        description="end when the cluster of this number would hand over"
    )


class Lost(BaseModel):
    """When a track is lost: its error is above `limit`, or it has no estimate, for `window` and at least `steps`."""

    model_config = FROZEN
    window: Annotated[float, Number(Quantity("s", gt=0), finite=True)] = Field(
        metrics.LOST_WINDOW, description="for how long the error is above the limit, or there is no estimate [s]"
    )
    steps: Annotated[int, Number(Quantity("", ge=1, le=MOST_STEPS), whole=True)] = Field(
        metrics.LOST_STEPS, description="for how many steps at least, if they are longer than the window"
    )
    limit: Annotated[float, Number(Quantity("m", gt=0))] | None = Field(
        None,
        description="error above which a track is lost; .inf: only without an estimate; null: a third of the sensing "
        "range, 20 m if that is infinite [m]",
    )

    def lasting(self, step: float) -> int:
        """The number of steps of the window, for steps of this length in s."""
        return max(self.steps, math.ceil(self.window / step - 1e-9))

    def beyond(self, reach: float) -> float:
        """The limit in m, for sensors of this range in m."""
        if self.limit is not None:
            return self.limit
        return metrics.LOST_SHARE * reach if math.isfinite(reach) else metrics.LOST_ERROR


Record: Final[type[BaseModel]] = create_model(
    "Record", __config__=FROZEN, **{name: (_Flag, default) for name, default in RECORDED_BY_DEFAULT.items()}
)  # type: ignore[call-overload]


class Scenario(BaseModel):  # noqa: PLW1641 - pydantic gives frozen models their hash
    """A checked scenario: one model per role (`scenario.deploy.nodes`), numbers in SI units, frozen.

    The fields of the roles follow from their kinds: see `scenario_model`. Scenarios of equal values are equal, wherever
    they were read.
    """

    model_config = FROZEN
    name: Annotated[str, Strict("str"), AfterValidator(_safe_name)] = Field(description="name of scenario and result")
    seed: Annotated[int, Number(Quantity("", ge=0), whole=True)] = Field(0, description="seed of every random stream")
    replicates: Annotated[int, Number(Quantity("", ge=1, le=100_000), whole=True)] = Field(
        1, description="number of Monte Carlo runs"
    )
    step: Annotated[float, Number(Quantity("s", ge=1e-6, le=1e6))] = Field(
        0.04, description="time between measurements [s]"
    )
    duration: Annotated[float, Number(Quantity("s", gt=0), finite=True)] = Field(description="simulated time [s]")
    network: Literal["none"] | None = Field(
        None, description="none: the tracker runs offline, without a network; roles of the network are not used"
    )
    lost: Lost = Field(Lost.model_construct(), description="when a track counts as lost")
    until: Until | None = Field(None, description="a condition that ends a run before its duration")
    record: Record = Field(Record.model_construct(), description="which tables are recorded")  # type: ignore[valid-type]

    _tree: LocatedValue = PrivateAttr()
    _source: tuple[str, str] = PrivateAttr(("", ""))
    _overrides: tuple[str, ...] = PrivateAttr(())

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
            raise refusal(
                f"{duration:.12g} s is not a whole number of steps of {step:g} s (nearest: {steps * step:.12g} s)"
            )
        return duration

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and self.__dict__ == other.__dict__

    @property
    def steps(self) -> int:
        """The number of steps, that of the start included."""
        return round(self.duration / self.step)

    @property
    def scope(self) -> Scope:
        """Which roles a run uses."""
        workload = getattr(self, "workload", None)
        return Scope(self.network is None, workload is None or not is_without_target(workload))

    def written(self, role: Role) -> tuple[tuple[Keys, PartModel], ...]:
        """Return the models of a role, one or several, each with its path in the scenario."""
        alone = getattr(self, role.name, None)
        if alone is not None:
            return (((role.name,), alone),)
        return tuple(((role.listed, i), model) for i, model in enumerate(getattr(self, role.listed, ())))

    @property
    def source_yaml(self) -> str:
        """The text that the scenario was read from, unchanged."""
        return self._source[1]

    @property
    def overrides(self) -> tuple[str, ...]:
        """The assignments that changed values of the text, such as 'link.reach=80 m'."""
        return self._overrides

    @property
    def file(self) -> str:
        """The name of the file that the scenario was read from; '' for a dict."""
        return self._source[0]

    def spot(self, path: Keys) -> Spot:
        """Return the position of the value at a path, or of the nearest value around it."""
        return spot_of(self._tree, path)


def is_without_target(workload: PartModel | type[PartModel]) -> bool:
    """Return whether a workload is one without targets."""
    return getattr(workload.part, "mechanism", "") != TRACKING


Chosen = tuple[tuple[str, tuple[type[PartModel] | None, ...]], ...]
"""(key at the top, its models); None for an item of a list whose kind has an issue."""


@functools.cache
def part_model(role: str, kind: str) -> type[PartModel]:
    """Return the model of one kind.

    Raises:
        LookupError: there is no such kind.
        ImportError: its module cannot be imported.
        PartError: its class is not a valid component of the role.
    """
    info = find(role, kind)
    part = load_class(info)
    try:
        fields = fields_of(part)
        demand_port(part, role)
        if {"kind", "assumes", "part"} & set(fields):
            raise PartError("has a field named 'kind', 'assumes' or 'part', which are reserved")
        choice: Any = (Literal[kind], kind) if kind == ROLES[role].default else (Literal[kind], ...)
        base = TrackerModel if role == "tracker" else PartModel
        return made_model(part, base, {"kind": choice, **fields})
    except PartError as error:
        raise PartError(f"{info.path} {error}") from None


@functools.cache
def scenario_model(chosen: Chosen) -> type[Scenario]:
    """Return the model of scenarios with exactly these kinds."""
    fields: dict[str, Any] = {}
    for key, models in chosen:
        about = Field(description=AT_TOP[key].purpose)
        if key == AT_TOP[key].listed:
            each = tuple(model or Any for model in models)
            fields[key] = (tuple[each], about)  # type: ignore[valid-type]
        else:
            fields[key] = (models[0], about)
    return create_model("Scenario", __base__=Scenario, **fields)
