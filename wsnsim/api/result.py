"""The result of one or many Monte Carlo runs, as an object; and plots of results and of result files by one function.

result = wsnsim.simulate("pso_mhpf", keep=["estimates"])
result.estimates, result.energy, result.table("clusters")      pandas DataFrames
result.plot.track();  result.report("page.html");  result.save("run.h5")
wsnsim.plot("run.h5", "track")
"""

from __future__ import annotations

import html as markup
import math
import os
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, final

from wsnsim.analysis.quantities import ONLY_IF_NOT_ZERO, QUANTITIES, beside, medians
from wsnsim.analysis.result_facts import facts_of_report
from wsnsim.api.arguments import file_given, result_file
from wsnsim.api.result_plots import ResultPlots
from wsnsim.base.errors import ResultError, UsageError, WsnsimError, counted, did_you_mean, shown_value
from wsnsim.base.tables import TABLES

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

    from wsnsim.experiment import Report
    from wsnsim.recording import MemoryResult
    from wsnsim.scenario.schema import Scenario

HDF5: Final = ".h5"
SHOWN: Final = (
    "rmse", "median_error", "nees", "nees_median", "singular", "tracked", "ever_lost", "lost", "lost_limit",
    "lost_window", "energy", "packet_delivery_ratio", "first_death",
)  # fmt: skip
"""The quantities that a notebook shows, where they have a value."""


@final
class Result:
    """The tables of one or many Monte Carlo runs, with plots, a page and a summary.

    `simulate` and `run` return results. Each access to a table returns a new DataFrame with the columns
    of `wsnsim.read`: SI units, categories as Categoricals. A result in memory can be pickled.
    """

    def __init__(self, report: Report, memory: MemoryResult | None = None) -> None:
        self._report = report
        self._memory = memory

    @property
    def scenario(self) -> Scenario:
        """The checked scenario: `result.scenario.tracker.particles`."""
        scenario: Scenario = self._report.scenario
        return scenario

    @property
    def name(self) -> str:
        """The name of the scenario."""
        return self.scenario.name

    @property
    def seed(self) -> int:
        """The seed of every random stream."""
        return self.scenario.seed

    @property
    def replicates(self) -> tuple[int, ...]:
        """The numbers of the Monte Carlo runs."""
        return tuple(int(summary.run["replicate"]) for summary in self._report.summaries)

    @property
    def out(self) -> Path | None:
        """The result file; None for a result in memory."""
        return None if self._memory is not None else self._report.out

    @property
    def tables(self) -> tuple[str, ...]:
        """The names of the tables that were recorded."""
        if self._memory is not None:
            return self._memory.tables
        from wsnsim.recording import table_names

        return tuple(table_names(self._report.out))

    def table(self, name: str) -> pd.DataFrame:
        """Return a table: one row per run, step, event or node, as `wsnsim.read(file, name)` does.

        Args:
            name: name of the table, such as 'tracks' or 'clusters'.

        Raises:
            ResultError: the table was not recorded.
            UsageError: there is no such table.
        """
        from wsnsim.analysis.campaigns import data_frame, read_file

        if name not in TABLES:
            raise UsageError(f"there is no table '{name}' ({did_you_mean(str(name), TABLES)})")
        if name not in self.tables:
            raise ResultError(
                f"table {name} was not recorded: record it with keep=['{name}'], or record: {{{name}: true}} in the"
                f" scenario; recorded: {', '.join(self.tables)}"
            )
        if self._memory is not None:
            return data_frame(*self._memory.table(name))
        return read_file(self._report.out, name)

    @property
    def runs(self) -> pd.DataFrame:
        """The table `runs`: one row per Monte Carlo run with its errors (m), energy (J) and counts."""
        return self.table("runs")

    @property
    def estimates(self) -> pd.DataFrame:
        """The table `estimates`: one row per run, target and step with the estimate and its error (m)."""
        return self.table("estimates")

    @property
    def events(self) -> pd.DataFrame:
        """The table `events`: what happened in the network, with the joules of each event.

        Raises:
            ResultError: the table was not recorded; `keep=["events"]` records it.
        """
        return self.table("events")

    @property
    def energy(self) -> pd.DataFrame:
        """The table `energy`: joules by run, node and cause."""
        return self.table("energy")

    @property
    def plot(self) -> ResultPlots:
        """The plots: `.track()`, `.states()`, `.gospa()`, `.error()`, `.consistency()`, `.energy()`, `.particles()`."""
        return ResultPlots(self._file)

    def save(self, path: str | Path) -> Path:
        """Write the result file, as `wsnsim run` writes it, and return its path.

        Args:
            path: the file, with the suffix .h5. Its folder must exist.

        Raises:
            UsageError: `path` is not the path of such a file.
            ResultError: the result's own file is missing.
            StorageError: the file cannot be written.
        """
        import shutil

        from wsnsim.recording.atomic_files import replacing

        target = result_file("path", path)
        if self._memory is not None:
            self._memory.save(target)
        elif target.resolve() != self._report.out.resolve():
            if not self._report.out.is_file():
                raise ResultError(f"{self._report.out}: the file of this result is missing: it was moved or deleted")
            with replacing(target) as unfinished:
                shutil.copyfile(self._report.out, unfinished)
        return target

    def report(self, path: str | Path, *, replicate: int | None = None, megabytes: float = 2.0) -> Path:
        """Write an HTML page with summary, replay and figures, as `wsnsim report` does, and return its path.

        Args:
            path: the page, with the suffix .html.
            replicate: the run to replay, by default the first.
            megabytes: largest size of the page; replay and figures are reduced to fit.

        Raises:
            UsageError: there is no such run, or `path` is not the path of a page.
            ResultError: the page cannot be written.
        """
        import wsnsim.report as pages
        from wsnsim.papers import published

        page = file_given("path", path, ".html", ".htm")
        with self._file() as file:
            return pages.write([file], page, replicate, int(1e6 * megabytes), published, plugins=True).path

    def answer(self) -> str:
        """Return one sentence: whether the target was followed, how well against the bound, and for how many joules."""
        from wsnsim.analysis.answer import answer

        with self._file() as file:
            return answer(replace(self._report, out=file))

    def summary(self, *, bounds: bool = False) -> str:
        """Return the summary as text: whether the target was followed, how well, and for how many joules.

        Args:
            bounds: whether to compare the error with all three bounds, as `wsnsim run --bound` does.
        """
        with self._file() as file:
            # a temporary file's name says nothing to the reader
            return str(self._summary(file, bounds, False)).replace(str(file), str(self.out or "in memory"))

    def to_dict(self, *, bounds: bool = False) -> dict[str, Any]:
        """Return the summary as plain values: SI units, NaN for what is unknown, as `wsnsim run --json` prints it.

        Args:
            bounds: whether to compute all three bounds of the error.
        """
        with self._file() as file:
            found = self._summary(file, bounds, True)
        assert isinstance(found, dict)
        return found | {"file": "" if self.out is None else str(self.out)}

    def _summary(self, file: Path, bounds: bool, json: bool) -> str | dict[str, Any]:
        """The summary of the result in a file, as text or as plain values."""
        from wsnsim.analysis.summary_text import summary_of
        from wsnsim.papers import published

        return summary_of(replace(self._report, out=file), published, bounds, json)

    def __repr__(self) -> str:
        found = [counted(len(self.replicates), "Monte Carlo run")]
        found += [f"{name} {value}" for key, name, value in _quantities(self._report) if key in ("rmse", "energy")]
        return f"<Result {self.name}: {', '.join(found)}, {self.out or 'in memory'}>"

    def __str__(self) -> str:
        return self.summary()

    def _repr_html_(self) -> str:
        try:
            return _html(self._report, self.answer(), str(self.out or "in memory"), self.tables)
        except WsnsimError as error:  # a notebook shows the object even if its file is gone
            return f"<div><p>{markup.escape(repr(self))}</p><p>{markup.escape(str(error))}</p></div>"

    def __getattr__(self, name: str) -> Any:
        if name in TABLES:
            keep = f"the table is result.table({name!r}), recorded with keep=[{name!r}]"
            raise AttributeError(f"a result has no attribute '{name}': {keep}")
        known = [own for own in vars(type(self)) if not own.startswith("_")]
        raise AttributeError(f"a result has no attribute '{name}' ({did_you_mean(name, known)})")

    def __dir__(self) -> list[str]:
        return [name for name in super().__dir__() if not name.startswith("_") or name.startswith("__")]

    def __getstate__(self) -> dict[str, Any]:
        from wsnsim.scenario import resolved

        # the class of a scenario is made at run time and cannot be pickled: its values can
        return {
            "report": replace(self._report, scenario=resolved(self._report.scenario)),
            "memory": self._memory,
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        import wsnsim.experiment as experiment

        report = state["report"]
        self._report = replace(report, scenario=experiment.load(report.scenario))
        self._memory = state["memory"]

    @contextmanager
    def _file(self) -> Iterator[Path]:
        """The result file; for a result in memory, a temporary one, which error messages leave out."""
        if self._memory is None:
            yield self._report.out
            return
        with tempfile.TemporaryDirectory(prefix="wsnsim-") as folder:
            path = Path(folder) / f"{self.name}{HDF5}"
            self._memory.save(path)
            try:
                yield path
            except (ResultError, UsageError) as error:
                raise _without(path, error) from error


def _without(path: Path, error: WsnsimError) -> WsnsimError:
    """The same error without the name of a temporary file."""
    return type(error)(str(error).replace(f"{path}: ", ""))


def _html(report: Report, answer: str, place: str, tables: tuple[str, ...]) -> str:
    """Return the summary as HTML: a sentence, what was run, a small table of quantities, and which tables it holds."""
    runs = counted(len(report.summaries), "Monte Carlo run")
    steps = max(int(one.run["steps"]) for one in report.summaries)
    heading = f"{runs} of {counted(steps, 'step')}, seed {report.scenario.seed} ({place})"
    rows = "".join(
        f"<tr><th style='text-align:left'>{markup.escape(name)}</th><td>{markup.escape(value)}</td></tr>"
        for _, name, value in _quantities(report)
    )
    return (
        f"<div><p>{markup.escape(answer)}</p>"
        f"<p><b>{markup.escape(report.scenario.name)}</b>: {markup.escape(heading)}</p>"
        f"<table><tbody>{rows}</tbody></table><p>Tables: {markup.escape(', '.join(tables))}</p></div>"
    )


def _quantities(report: Report) -> Iterator[tuple[str, str, str]]:
    """Yield (key, name, value with unit) of the quantities that have a value."""
    facts = facts_of_report(report)
    run_medians = medians(facts)
    for key in SHOWN:
        value = QUANTITIES[key].value(facts)
        if math.isfinite(value) and (value or key not in ONLY_IF_NOT_ZERO):
            note = beside(key, run_medians, facts.consistent, facts.unit)
            yield key, QUANTITIES[key].name, QUANTITIES[key].text(value, facts.unit) + (f" ({note})" if note else "")


def plot(result: Result | str | Path, what: str = "track", *, ax: Axes | None = None, **options: Any) -> Axes:
    """Draw one plot of a result, or of a result file, and return its axes.

    Examples::

        plot("results/pso_mhpf.h5", "error")
        plot(wsnsim.simulate("pso_mhpf"), "states", column="vx")

    It is `result.plot(what, ...)` for results and files alike.

    Args:
        result: what `simulate` or `run` returned, or the path of a result file.
        what: 'track', 'states', 'gospa', 'error', 'consistency', 'energy' or 'particles'.
        ax: matplotlib axes to draw on; by default those of a new figure.
        options: what the plot of this name takes beside `ax`, such as `replicate` and `target` of 'track', `column` of
            'states', `step` of 'particles' (see `ResultPlots`).

    Raises:
        UsageError: there is no such plot, option, column, run or target, or `result` is neither a result nor a path.
        ResultError: the file cannot be read, or a table that the plot needs was not recorded.
    """
    return ResultPlots(_file_of(result))(what, ax, **options)


def gospa(result: Result | str | Path, cutoffs: Sequence[float] = (), order: float = 2.0) -> pd.DataFrame:
    """Compute GOSPA (α = 2) and its parts at each step of each run, where readings name no target.

    Examples::

        gospa("results/scans_crossing.h5", [5.0, 10.0, 20.0]).groupby("cutoff").gospa.mean()

    Tracks are assigned to targets at each step. `runs.gospa` is the root mean square of one run at the default c.

    Args:
        result: what `simulate` or `run` returned, or the path of a result file.
        cutoffs: distances c in the unit of the position; by default the error above which a track is lost, or 20 m if
            that is infinite.
        order: the order p, at least 1.

    Returns:
        The columns `replicate`, `step`, `time` (s), `cutoff`, `gospa`, `gospa_localisation`, `gospa_missed` and
        `gospa_false`.

    Raises:
        UsageError: a cutoff is not a positive number, the order is below 1, or `result` is no result.
        ResultError: readings name their targets, or `truth` and `estimates` were not recorded.
    """
    from wsnsim.analysis.multi_target import gospa_table

    with _file_of(result)() as file:
        return gospa_table(file, cutoffs, order)


def _file_of(result: object) -> Callable[[], AbstractContextManager[Path]]:
    """What opens the file of a result, or of a path that was given in place of one."""
    if isinstance(result, Result):
        return result._file
    if not isinstance(result, str | os.PathLike):
        raise UsageError(
            f"result: expected what wsnsim.simulate or wsnsim.run returned, or the path of a result file, got "
            f"{shown_value(result)}"
        )
    return lambda: nullcontext(Path(result))
