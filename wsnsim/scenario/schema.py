"""The pydantic model of scenarios.

scenario_model(chosen) -> the model of scenarios of these kinds
with_radio(scenario) -> the scenario with what the radio's datasheet says of the link and the MAC

The latter takes the place of defaults that nobody wrote. A value that a scenario writes stays, and the energy model
refuses it if the radio contradicts it.
"""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Collection
from typing import Annotated, Any, ClassVar, Final, Literal

from pydantic import AfterValidator, BaseModel, Field, PrivateAttr, ValidationInfo, create_model, field_validator
from pydantic.types import Strict

from wsnsim.base import metrics
from wsnsim.base.errors import shown_value
from wsnsim.base.files import LARGEST_NAME, LONGEST_ADDITION, is_too_long
from wsnsim.base.part import Quantity
from wsnsim.base.tables import RECORDED_BY_DEFAULT
from wsnsim.scenario.fields import FROZEN, PartModel, names_of
from wsnsim.scenario.lifetime import AskedLifetime
from wsnsim.scenario.registry import AT_TOP, Role, Scope
from wsnsim.scenario.texts import Keys, LocatedValue, Spot
from wsnsim.scenario.units import Number, refusal, shown

MOST_STEPS: Final = 10_000_000
SAFE_CHARACTERS: Final = re.compile(r"\w[\w.\-]*")
MOST_CHARACTERS: Final = 100
"""Characters of a name; the limit in bytes follows from temporary names."""
WITHOUT_TARGETS: Final = ("beacons", "collection")
"""The kinds of the built-in workloads without targets."""
TRACKING: Final = "tracking"
"""The mechanism of the workload with targets; every other workload has none."""

_Flag = Annotated[bool, Strict()]


def unsafe_name(name: str, what: str) -> str:
    """Return why a name cannot be that of `what` ('a file') on every system, and what is allowed; '' if it can."""
    if not SAFE_CHARACTERS.fullmatch(name):
        return f"cannot name {what}: use letters and digits, then also '_', '-' and '.'"
    if len(name) > MOST_CHARACTERS or is_too_long(name):
        most = LARGEST_NAME - LONGEST_ADDITION
        return f"is too long to name {what}: at most {MOST_CHARACTERS} characters and {most} bytes are allowed"
    return ""


def names(what: str) -> AfterValidator:
    """Return the annotation of a text that names `what` ('a file')."""

    def demand_safe(name: str) -> str:
        if reason := unsafe_name(name, what):
            raise refusal(f"{shown(name)} {reason}")
        return name

    return AfterValidator(demand_safe)


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
        "range, 20 m if that is infinite; a third of the field's diagonal if these exceed the diagonal [m]",
    )

    def lasting(self, step: float) -> int:
        """The number of steps of the window, for steps of this length in s."""
        return max(self.steps, math.ceil(self.window / step - 1e-9))

    def beyond(self, reach: float, diagonal: float) -> float:
        """The limit in m, for sensors of this range, in a field of this diagonal (m), which errors hardly exceed."""
        if self.limit is not None:
            return self.limit
        limit = metrics.LOST_SHARE * reach if math.isfinite(reach) else metrics.LOST_ERROR
        return limit if limit <= diagonal else metrics.LOST_SHARE * diagonal


Record: Final[type[BaseModel]] = create_model(
    "Record", __config__=FROZEN, **{name: (_Flag, default) for name, default in RECORDED_BY_DEFAULT.items()}
)  # type: ignore[call-overload]


class Scenario(BaseModel):  # noqa: PLW1641 - pydantic gives frozen models their hash
    """A checked scenario: one model per role (`scenario.deploy.nodes`), numbers in SI units, frozen.

    The fields of the roles follow from their kinds: see `scenario_model`. Scenarios of equal values are equal, wherever
    they were read.
    """

    model_config = FROZEN
    roles: ClassVar[dict[str, Any]] = AT_TOP
    name: Annotated[str, Strict(), names("a file")] = Field(description="name of scenario and result")
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
    lifetime: AskedLifetime | None = Field(None, description="what `wsnsim lifetime` asks; a run ignores it")

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
        return self._tree.spot_of(path)


def shown_scenario(value: Any) -> str:
    """Return a value as a message shows it; of a result, also where its scenario is."""
    held = isinstance(getattr(value, "scenario", None), Scenario)
    return shown_value(value) + (" (its attribute `scenario` is one)" if held else "")


def is_without_target(workload: PartModel | type[PartModel]) -> bool:
    """Return whether a workload is one without targets."""
    return getattr(workload.part, "mechanism", "") != TRACKING


Chosen = tuple[tuple[str, tuple[type[PartModel] | None, ...]], ...]
"""(key at the top, its models); None for an item of a list whose kind has an issue."""


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


LINK: Final = ("sensitivity", "modulation")
MAC: Final = ("rate", "turnaround")
"""Fields of links and MACs that have the name and the meaning of a value of the datasheet."""
STANDARD_RATE: Final = 250e3
"""The rate in bit/s at which the durations of MACs in symbols (`in_symbols`) have their defaults."""


def with_radio(scenario: Scenario) -> Scenario:
    """Return the scenario with what the radio of its energy model says, where link, MAC and energy model say nothing.

    Durations of the MAC in symbols take as many symbols at the rate of the radio. The output powers of link and energy
    model are one: each follows the other. Where a MAC turns radios off for a shorter time than the usual sleep state
    allows, they are in the state with the least power that they can leave in time.
    """
    energy, link, mac = (getattr(scenario, role, None) for role in ("energy", "link", "mac"))
    radio = getattr(energy, "radio", None)
    rate = getattr(radio, "rate", None)
    if energy is None or link is None or mac is None or not isinstance(rate, float) or rate <= 0.0:
        return scenario
    link = _filled(link, {name: getattr(radio, name, None) for name in LINK})
    mac = _filled(mac, {name: getattr(radio, name, None) for name in MAC})
    link = _filled(link, {"power": getattr(energy, "power", None)})
    energy = _filled(energy, {"power": getattr(link, "power", None)})
    mac = _filled(
        mac, {name: STANDARD_RATE / rate * getattr(mac, name) for name in getattr(mac.part, "in_symbols", ())}
    )
    energy = _in_time(energy, radio, mac)
    return scenario.model_copy(update={"energy": energy, "link": link, "mac": mac})


def _filled(model: PartModel, values: dict[str, Any]) -> PartModel:
    """Return a model with values for the fields that nobody wrote. A default of None means something, and stays."""
    new = {
        name: value
        for name, value in values.items()
        if None not in (value, getattr(model, name, None)) and name not in model.model_fields_set
    }
    return model.model_copy(update=new) if new else model


def _in_time(energy: PartModel, radio: Any, mac: PartModel) -> PartModel:
    """Return an energy model with the sleep state that a MAC needs, unless the usual one will do or one is written."""
    try:
        shortest = getattr(built(mac), "shortest_off", math.inf)
    except InvalidComponent:
        return energy
    states = getattr(radio, "sleep_states", ())
    wakes = dict(zip(states, getattr(radio, "sleep_wakes", ()), strict=False))
    usual = wakes.get(getattr(energy, "sleep_state", None), getattr(radio, "wake", 0.0))
    if not hasattr(energy, "off_state") or "off_state" in energy.model_fields_set or radio.doze + usual <= shortest:
        return energy
    offers = zip(radio.sleep_powers, states, strict=False)
    quick = [offer for offer in offers if radio.doze + wakes.get(offer[1], math.inf) <= shortest]
    return energy.model_copy(update={"off_state": min(quick)[1]}) if quick else energy
