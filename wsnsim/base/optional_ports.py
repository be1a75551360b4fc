"""Optional ports: protocols that components may implement in addition to the port of their role.

Shapes and units are those of `base.ports`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple, Protocol, runtime_checkable

from wsnsim.base.arrays import Bools, Estimate, Floats, Ints, Reading
from wsnsim.base.requests import Member, Parcel


@lru_cache
def defined_together(kind: type, *names: str) -> bool:
    """Whether one and the same class, this one or a base, defines all of these methods.

    A short cut (`energy_law`) stands for what a method does (`log_likelihood`). A class that overrides the method and
    inherits the short cut has that of another method; one that only passes on what it lacks (`__getattr__`) has none.
    """
    definers = [next((each for each in kind.__mro__ if name in vars(each)), None) for name in names]
    return definers[0] is not None and all(each is definers[0] for each in definers)


@runtime_checkable
class Continuous(Protocol):
    """Optional port of a motion model: a trajectory in continuous time, the same at every sampling interval."""

    @property
    def continuous(self) -> bool:
        """Whether it is one."""


@runtime_checkable
class MayBeAbsent(Protocol):
    """Optional port of a built-in motion model: states of its `truth` may be NaN, where the target is absent."""

    @property
    def may_be_absent(self) -> bool:
        """Whether they may."""


@runtime_checkable
class LinearGaussian(Protocol):
    """Optional port of a motion model, a sensor model or a tracker, for χ² intervals of NEES and NIS.

    A model that is linear with Gaussian noise, or a tracker that is exact for such models. Where motion, sensor and
    tracker say so, the posterior is Gaussian (column `estimates.gaussian`).
    """

    @property
    def linear_gaussian(self) -> bool:
        """Whether the model is linear with Gaussian noise, or the tracker exact for such models."""


@runtime_checkable
class Informs(Protocol):
    """Optional port of a sensor model: the Fisher information of its measurements, for Cramér-Rao bounds."""

    def information(self, points: Floats, positions: Floats, traits: Floats) -> Floats:
        """(S, P, P, N) Fisher's information about the position in one reading of each sensor, at points (P, N).

        The information in a variance that depends on the state is included: g gᵀ / R + (∂R / R)(∂R / R)ᵀ / 2.
        """


@runtime_checkable
class MeasuresEnergy(Protocol):
    """Optional port of a sensor model with the likelihood of acoustic energy: compiled code weighs by its law.

    The law counts where the class that defines it defines `log_likelihood` as well.
    """

    def energy_law(self, traits: Floats) -> tuple[tuple[float, float, float, float, float], Floats]:
        """(σ², I, α, 2c/N_sam, inflation) and the gains (S,) of sensors with traits (S, T)."""


@runtime_checkable
class Ranks(Protocol):
    """Optional port of a sensor model whose larger measurements do not mean a nearer target: ranks measurements.

    A sensor model whose readings have several components needs it.
    """

    def strength(self, reading: Reading) -> float:
        """A number that is larger for a nearer target; the same for all readings that say nothing of the distance."""


@runtime_checkable
class VectorReadings(Protocol):
    """Optional port of a sensor model whose reading has several components, or a component that is an angle.

    Readings of n nodes are (n,) for M = 1 component, and (n, M) otherwise. `measure` is given as many standard normal
    numbers. `linearise` returns n M rows instead of n, node by node (all components of the first node, then those of
    the second); the components of a reading are independent. `log_likelihood` takes readings (n,) or (n, M), and does
    not depend on whole periods. Filters take such rows by `rows` and `near`.
    """

    @property
    def components(self) -> tuple[str, ...]:
        """The names of the M components of a reading."""

    @property
    def periods(self) -> tuple[float, ...]:
        """The period of each component, such as 2 pi for an angle in rad; 0 if it has none."""


@runtime_checkable
class Detects(Protocol):
    """Optional port of a sensor model: which nodes measure the target, if not all within `reach`."""

    def detects(self, points: Floats, positions: Floats) -> Bools:
        """(n, S) whether a target at each of the points (n, P) gives a reading at each of the sensors (S, 2)."""


@runtime_checkable
class HasHeights(Protocol):
    """Optional port of a deployment: the heights of its nodes, for sensor models with the trait `height`."""

    @property
    def heights(self) -> Floats | None:
        """(N,) height of each node in m, in the order of the positions; None if they are unknown."""


@runtime_checkable
class NamesNodes(Protocol):
    """Optional port of a deployment: the names by which recorded data refer to its nodes; else they are numbers."""

    @property
    def names(self) -> tuple[str, ...]:
        """The name of each node, in the order of the positions."""


@runtime_checkable
class MovesInSpace(Protocol):
    """Optional port of a motion model: the target's height, for sensor models with the trait `height`."""

    def heights(self, steps: int, dt: float) -> Floats | None:
        """(steps + 1,) height of the target in m at each step of a trajectory; None if it is unknown."""


@runtime_checkable
class IsShadowed(Protocol):
    """Optional port of a sensor model: sampled readings have an error that is correlated along the target's path.

    Recorded readings are left as they are.
    """

    @property
    def shadowing(self) -> float:
        """Its standard deviation, in the unit of a reading; 0: there is none."""

    @property
    def decorrelation(self) -> float:
        """The length (m) of path after which its correlation has fallen to 1/e."""


@runtime_checkable
class LimitsReadings(Protocol):
    """Optional port of a sensor model: which readings are possible. Recorded ones beyond are refused or left out."""

    @property
    def reading_limits(self) -> tuple[float, float]:
        """The least and the greatest reading."""


@runtime_checkable
class FewReadings(Protocol):
    """Optional port of a sensor model whose readings take few values: their mean need be none of these.

    `linearise` then holds the mean and the variance of a reading, and `log_likelihood` is that of a probability.
    """

    @property
    def reading_values(self) -> Floats:
        """(C,) the values, ascending; nothing if a reading may be any number."""

    @property
    def reading_bits(self) -> int:
        """The bits of a reading in a packet, beside the header."""


@runtime_checkable
class RelativeReadings(Protocol):
    """Optional port of a sensor model whose readings of a step have an unknown number in common.

    Only their differences say anything of the target, and a reading alone says nothing. `linearise` and `information`
    are those of the given set of sensors, centred: the mean over the sensors is taken off expected readings and
    gradients, so that filters may take the rows as independent. `log_likelihood` is that of the differences. Filters
    take readings by `near`, which takes off their common part.
    """

    @property
    def relative(self) -> bool:
        """Whether it is so."""


@runtime_checkable
class ConstantGaussian(Protocol):
    """Optional port of a sensor model: whether the noise of its readings is Gaussian with one constant variance R.

    The mean of n readings then says as much of the state as all of them, with the variance R / n.
    """

    @property
    def constant_gaussian(self) -> bool:
        """Whether it is so."""


class Recording(NamedTuple):
    """The recorded readings of one target, step by step.

    Attributes:
        readings: (steps + 1, N) the reading of each node; NaN where it has none.
        counts: (steps + 1, N) how many readings of the file it stands for.
    """

    readings: Floats
    counts: Ints


@runtime_checkable
class Replays(Protocol):
    """Optional port of a sensor model whose readings were recorded: no reading is sampled from its law.

    `law` is the sensor model that filters and bounds take the readings to follow.
    """

    @property
    def law(self) -> Any:
        """The sensor model that the readings are taken to follow."""

    @property
    def counted(self) -> bool:
        """Whether filters are given how many readings each one stands for.

        The number is a further trait of the node, which changes from step to step.
        """

    def recordings(self, names: Sequence[str], targets: int, steps: int, dt: float) -> Sequence[Recording]:
        """The readings of each target.

        Args:
            names: The names of the N nodes.
            targets: The number of targets.
            steps: The number of steps after the start.
            dt: The length of a step in s.

        Raises:
            RunError: Some readings are bad; the message names file and line.
        """


@runtime_checkable
class RecordedFile(Protocol):
    """Optional port of a component whose values were recorded in the file `path`: what the provenance says of it."""

    @property
    def path(self) -> str:
        """The file."""

    @property
    def digest(self) -> str:
        """The digest of the file, which is filled in when the scenario is read; empty before."""

    def skipped_rows(self, setup: Any) -> Sequence[str]:
        """The rows that are left out, a text each with file, line and reason. `setup`: the scenario's setup."""


@runtime_checkable
class Portable(Protocol):
    """Optional port of a tracker: a belief small enough to be carried by a wake-up message."""

    def belief_bits(self, belief: Any) -> int:
        """Bits of the belief in such a message."""


@runtime_checkable
class Foresees(Protocol):
    """Optional port of a tracker: whether its forecast is already a prediction, or only its last fix."""

    def foresees(self, belief: Any) -> bool:
        """True once it can predict. A tracker without this port always can."""


@runtime_checkable
class ForecastsSuccession(Protocol):
    """Optional port of a tracker: a forecast of its own for the choice of the next head.

    A head that will lead for many steps is better looked for farther ahead than nodes are woken. Without this port
    `forecast` serves both.
    """

    def successor_forecast(self, belief: Any, scene: Any, ahead: int) -> Estimate:
        """Where the next head is looked for, as an estimate `ahead` steps later or more; see `Tracker.forecast`."""


@runtime_checkable
class Announces(Protocol):
    """Optional port of a tracker: what the announcement of an appointed cluster carries for its members."""

    def announcement(self, belief: Any, scene: Any) -> Parcel | None:
        """A parcel that is sent with the announcement; None: nothing. It arrives in the inbox of the new members.

        `scene` is that of the belief in the head that announces: its `roster` holds the head alone, if the head has
        just taken over.
        """


@runtime_checkable
class Snapshots(Protocol):
    """Optional port of a tracker: its particles for the table `particles`; no node receives them."""

    def snapshot(self, belief: Any, members: Sequence[Member]) -> Iterator[tuple[int, Floats, Floats]]:
        """(node, states (D, n), weights (n,)) of each node that holds some; weights sum to 1 over the whole set."""


@runtime_checkable
class ReportsState(Protocol):
    """Optional port of a tracker: named quantities of its belief, recorded in the table `tracker_state`."""

    def report_state(self, belief: Any) -> Mapping[str, Floats]:
        """Values (n,) by name, recorded after each step. The lengths may differ, and may change from step to step."""
