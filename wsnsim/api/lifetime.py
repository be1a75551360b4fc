"""How long a network lives, from Python: `lifetime` estimates it, and its result shows itself."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Unpack, final

import pandas as pd

import wsnsim.experiment as experiment
from wsnsim.analysis import lifetime_result, lifetime_text
from wsnsim.api.arguments import Changes, file_given, of_campaign, overrides_of, renamed, shown
from wsnsim.base.errors import UsageError, did_you_mean
from wsnsim.campaign.engines import CampaignProgress
from wsnsim.campaign.sweeping import engine_of, needs_main_guard
from wsnsim.campaign.visits import estimate_lifetime
from wsnsim.scenario import Overrides
from wsnsim.scenario.load import demand_scenario

TABLES: Final = ("criteria", "lifetimes", "deaths", "nodes", "causes", "curves")


@final
@dataclass(frozen=True, repr=False)
class LifetimeResult:
    """The estimated lifetime of a network. `print` shows the answer; a notebook also shows the figures.

    Attributes:
        outcome: all values, as in the file: `wsnsim.analysis.lifetime_result`.
    """

    outcome: dict[str, Any]

    def table(self, name: str = "criteria") -> pd.DataFrame:
        """A table: criteria, lifetimes (s by path), deaths, nodes, causes (W of the mean node) or curves.

        Raises:
            UsageError: there is no such table.
        """
        if name not in TABLES:
            raise UsageError(f"table: there is no table '{name}' ({did_you_mean(name, TABLES)})")
        return pd.DataFrame(self.outcome[name])

    def plot(self, out: str | Path) -> Path:
        """Write the figures to a file: .png, .svg or .pdf. Raises UsageError, StorageError."""
        from wsnsim.analysis import lifetime_plots

        return lifetime_plots.write(self.outcome, file_given("out", out, ".png", ".svg", ".pdf"))

    def save(self, out: str | Path) -> Path:
        """Write the JSON file that `wsnsim info` shows. Raises UsageError, StorageError."""
        path = file_given("out", out, ".json")
        lifetime_result.write(path, [self.outcome], "wsnsim.lifetime")
        return path

    def __str__(self) -> str:
        return lifetime_text.text(self.outcome)

    def __repr__(self) -> str:
        return f"<LifetimeResult of {self.outcome['name']}: {lifetime_text.answer(self.outcome)}>"

    def _repr_html_(self) -> str:
        from wsnsim.report import lifetime_page

        return f"<div>{lifetime_page.section(self.outcome)}</div>"


def lifetime(  # noqa: PLR0913
    scenario: Any,
    intrusions: float | str | Sequence[float] | None = None,
    *,
    visits: str | Path | None = None,
    seed: int | None = None,
    overrides: Overrides | None = (),
    workers: int | None = None,
    scheduler: str | None = None,
    progress: bool | Callable[[CampaignProgress], None] | None = None,
    plugins: bool = False,
    **changes: Unpack[Changes],
) -> LifetimeResult:
    """Estimate how long a network lives whose target comes again and again.

    Example::

        lifetime("gmtt", "1/h", lifetime={"horizon": "1000 d", "until": "half_dead"}, visits="results/visits")

    Args:
        scenario: a name, a file, a dict, or what `load` returned. Unless its motion is `visits`, it is one visit.
        intrusions: visits per second, such as '1/h', or the times in s at which they begin; None: those of the
            scenario, else one an hour.
        visits: folder in which simulated visits are kept, which makes the estimate resumable; None: they are not kept.
        seed: the seed, if not that of the scenario.
        overrides: values to change, {'lifetime.horizon': '1000 d'} or ['lifetime.error=2 %'].
        workers: number of processes, all cores by default; 0, or a script without a main guard: this process.
        scheduler: address of a Dask scheduler, on whose workers to run instead.
        progress: whether to show a progress bar (by default in notebooks), or a function of a `CampaignProgress`.
        plugins: whether a result file may name any plug-in, as in `load`.
        changes: roles and other keys of the scenario, as in `simulate`; `lifetime={...}` is what is asked.

    Returns:
        The estimate: criteria with prediction and confidence intervals, sample paths, who dies first and why.

    Raises:
        ScenarioError: the scenario is invalid.
        UsageError: the scenario has no lifetime (no network, no target), or there is no such argument.
        RunError: a visit could not be simulated.
    """
    demand_scenario(scenario)
    chosen = list(overrides_of("lifetime", changes, overrides, seed, ()))
    if intrusions is not None:
        one = isinstance(intrusions, str | int | float)
        chosen.append(("lifetime.intrusions", intrusions) if one else ("lifetime.times", list(intrusions)))  # type: ignore[arg-type]
    workers = 0 if workers is None and needs_main_guard() else workers
    with ExitStack() as stack:
        with renamed():
            loaded = experiment.load(scenario, chosen, plugins)
        folder = Path(visits or stack.enter_context(tempfile.TemporaryDirectory(prefix="wsnsim-")))
        report = stack.enter_context(shown(progress, loaded.name, "visits", of_campaign)) or (lambda now: None)
        return LifetimeResult(
            estimate_lifetime(loaded, folder, lambda: engine_of(folder, workers, scheduler), report=report)
        )
