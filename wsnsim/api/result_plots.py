"""The plots of a result, as methods: `result.plot.track()`, `result.plot.error(ax=axes)`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

from wsnsim.base.errors import UsageError, did_you_mean

if TYPE_CHECKING:
    from matplotlib.axes import Axes

KINDS = ("track", "states", "gospa", "error", "consistency", "energy", "particles", "step")


@final
class ResultPlots:
    """Plots of a result. Each method draws on `ax`, or on the axes of a new figure, and returns the axes.

    `result.plot()` is `result.plot.track()`, and `result.plot("error")` is `result.plot.error()`.
    """

    def __init__(self, file: Callable[[], AbstractContextManager[Path]]) -> None:
        self._file = file

    def __call__(self, what: str = "track", ax: Axes | None = None, **options: Any) -> Axes:
        """Draw the plot of this name. `options` are arguments of its method.

        Raises:
            UsageError: there is no such plot, or its method has no such argument.
        """
        if what not in KINDS:
            raise UsageError(f"there is no plot '{what!s:.80}' ({did_you_mean(str(what), KINDS)})")
        method = getattr(self, what)
        known = signature(method).parameters
        for option in options.keys() - known.keys():
            raise UsageError(f"the plot '{what}' has no option '{option}' ({did_you_mean(option, known)})")
        drawn: Axes = method(ax=ax, **options)
        return drawn

    def __repr__(self) -> str:
        return f"<plots of a result: {', '.join(f'.{kind}()' for kind in KINDS)}>"

    def track(self, *, replicate: int | None = None, target: int = 0, ax: Axes | None = None) -> Axes:
        """Draw the plane with ground truth, estimates, nodes and cluster heads; on a line, the position over time.

        Args:
            replicate: the run to draw; by default the first one.
            target: the target to draw.
            ax: matplotlib axes to draw on; by default those of a new figure.

        Raises:
            ResultError: the tables `truth` and `estimates` were not recorded.
            UsageError: there is no such run or target.
        """
        return self._drawn("track", ax, replicate=replicate, target=target)

    def states(
        self, column: str | None = None, *, replicate: int | None = None, target: int = 0, ax: Axes | None = None
    ) -> Axes:
        """Draw one state column over time, true and estimated.

        Args:
            column: name of the state column, such as 'vx'; by default the first one.
            replicate: the run to draw; by default the first one.
            target: the target to draw.
            ax: matplotlib axes to draw on; by default those of a new figure.

        Raises:
            ResultError: the tables `truth` and `estimates` were not recorded.
            UsageError: there is no such column, run or target.
        """
        from wsnsim.analysis import plot_data

        if not column:
            with self._file() as path:
                column = next(iter(plot_data.layout(path).units))
        return self._drawn("states", ax, column=column, replicate=replicate, target=target)

    def gospa(self, *, ax: Axes | None = None) -> Axes:
        """Draw GOSPA and its parts at each step over all runs, where readings name no target.

        Args:
            ax: matplotlib axes to draw on; by default those of a new figure.

        Raises:
            ResultError: readings name their targets, or the tables `truth` and `estimates` were not recorded.
        """
        return self._drawn("gospa", ax, plugins=True)

    def error(self, *, ax: Axes | None = None) -> Axes:
        """Draw the position error at each step over all runs: RMSE, median, quartiles and the CRLB.

        Args:
            ax: matplotlib axes to draw on; by default those of a new figure.

        Raises:
            ResultError: the table `estimates` was not recorded.
        """
        return self._drawn("error", ax, plugins=True)

    def consistency(self, *, ax: Axes | None = None) -> Axes:
        """Draw NEES and NIS per degree of freedom at each step: 1 is consistent, above is overconfident.

        Args:
            ax: matplotlib axes to draw on; by default those of a new figure.

        Raises:
            ResultError: the table `estimates` was not recorded.
        """
        return self._drawn("consistency", ax)

    def energy(self, *, ax: Axes | None = None) -> Axes:
        """Draw the energy (J) that the network has spent by each step, stacked by cause.

        Args:
            ax: matplotlib axes to draw on; by default those of a new figure.

        Raises:
            ResultError: the table `energy_steps` was not recorded, or there is no network.
        """
        return self._drawn("energy", ax)

    def particles(
        self,
        step: int | None = None,
        *,
        column: str | None = None,
        replicate: int | None = None,
        target: int = 0,
        ax: Axes | None = None,
    ) -> Axes:
        """Draw the particles at a step with the ground truth: a cloud in the plane, or the histogram of one column.

        Args:
            step: the step; by default the last one that has particles.
            column: a state column; None for the cloud.
            replicate: the run to draw; by default the first one.
            target: the target to draw.
            ax: matplotlib axes to draw on; by default those of a new figure.

        Raises:
            ResultError: the table `particles` was not recorded.
            UsageError: there is no such step, column, run or target.
        """
        return self._drawn("particles", ax, step=step, column=column, replicate=replicate, target=target)

    def step(
        self, step: int | None = None, *, replicate: int | None = None, target: int = 0, ax: Axes | None = None
    ) -> Axes:
        """Draw the plane at a step: nodes, who sensed, the cluster head, ground truth and estimates up to then.

        Args:
            step: the step; by default that of the largest error after the first tenth of the run.
            replicate: the run to draw; by default the first one.
            target: the target to draw.
            ax: matplotlib axes to draw on; by default those of a new figure.

        Raises:
            ResultError: the tables `truth` and `estimates` were not recorded.
            UsageError: there is no such step, run or target, or the position has one column.
        """
        return self._drawn("step", ax, step=step, replicate=replicate, target=target)

    def _drawn(self, what: str, ax: Axes | None, **options: Any) -> Axes:
        """A plot; without a number, of the first run."""
        from wsnsim.analysis import plots
        from wsnsim.analysis.plot_data import first_replicate

        with self._file() as path, _axes(ax) as axes:
            if options.get("replicate", 0) is None:
                options["replicate"] = first_replicate(path)
            axes_drawn: Axes = getattr(plots, what)(axes, path, **options)
            return axes_drawn


@contextmanager
def _axes(ax: Axes | None) -> Iterator[Axes]:
    """The axes given, or those of a new figure in the package's style; the figure is closed if drawing fails."""
    if ax is not None:
        yield ax
        return
    from matplotlib import pyplot, style

    from wsnsim.analysis.figure_style import STYLE

    # this loads the backend, which may set rcParams that `style.context` would restore
    pyplot.draw_if_interactive()  # type: ignore[no-untyped-call]
    with style.context(STYLE):
        figure, axes = pyplot.subplots(figsize=(6.4, 4.6), layout="constrained")
        try:
            yield axes
        except BaseException:
            pyplot.close(figure)
            raise
