"""The files of a study: the keys of `study.yaml`, and what the functions of its Python files are.

Claims are written out. YAML's anchors and merge keys serve for what repeats: `reason: &far "..."`, then `reason: *far`;
`- &first {...}`, then `- {<<: *first, name: again}`.

`study.py` may define these mappings from names to functions; it imports from `wsnsim.papers.toolkit`:

    MEASURES     (data, variant) -> one value for each run, a Series by replicate
    FIGURES      (figure, data), draws
    SUMMARIES    (data) -> lines beneath an experiment's rows
    EXPERIMENTS  (study, folder of data or None) -> {variants: ..., claims: ...}, as `study.yaml` has them

The code of a study that does not come with wsnsim is plug-in code: it is imported only for the command that names its
folder, is announced, and its errors are reported with file and line.
"""

from __future__ import annotations

import hashlib
import importlib
import sys
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any, Final, TypeAlias, final

from wsnsim.base.errors import UsageError
from wsnsim.base.plugin_code import PluginImport, announce, note_plugin, plugin_fault
from wsnsim.scenario.messages import DocumentModel

Published: TypeAlias = int | float | tuple[float, float]
"""A printed value, or two whose ratio is claimed."""


class ClaimEntry(DocumentModel):
    """What is claimed of a variant ('pf'), of an order ('ekf < pf'), of a list of them, or of `all` variants.

    `rows` holds several claims: each variant or order has all of them, one variant after the other. `published` and
    `reason` may be mappings by variant or order. See reproduction.Claim for the other keys.
    """

    of: str | tuple[str, ...] = ""
    rows: tuple[ClaimEntry, ...] = ()
    id: str = ""
    quantity: str = ""
    measure: str = ""
    published: Published | dict[str, Published] | None = None
    where: str = ""
    bound: str = ""
    reason: str | dict[str, str] = ""
    read: bool = False
    judged: bool = True
    fraction: bool = False
    literal: bool = True
    shown: bool = True
    basis: str = ""
    deterministic: bool = False
    published_runs: int | None = None
    published_runs_assumed: bool = False


class RegisteredHypothesis(DocumentModel):
    """A hypothesis that is registered before the runs: that a measure of a variant is above, or below, a threshold."""

    says: str
    of: str
    measure: str
    above: float | None = None
    below: float | None = None


class StudyFigure(DocumentModel):
    """A figure, drawn from the results by the function `draw` of the study's FIGURES (default: `name`)."""

    name: str
    caption: str
    draw: str = ""
    size: tuple[float, float] = (7.0, 4.5)


class Runs(DocumentModel):
    """Monte Carlo runs of each variant in a quick and in a full reproduction, and in one task of the campaign."""

    quick: int
    full: int
    block: int = 5


class ExperimentEntry(DocumentModel):
    """An experiment; see reproduction.Experiment.

    `variants` gives each variant's scenario (a file beside `study.yaml`, or the name of a shipped one), or a list of it
    and of the settings laid on it. An experiment named in the study's EXPERIMENTS has variants and claims from there.
    Claims on variants in `repairs` are not counted among the paper's. `bases` lists the variants of a basis: a claim
    without a `basis` of its own has that of its variant, or else the experiment's. `reading` says how the experiment
    reads what the paper leaves open: rows of the same paper, `where`, `id` and variant are of one printed number. With
    `published_runs_assumed` the numbers of runs behind published values are ours: the paper does not give them.
    """

    name: str
    title: str
    reading: str = ""
    variants: dict[str, str | tuple[str, ...]] = {}  # noqa: RUF012 (pydantic copies it)
    runs: Runs
    claims: tuple[ClaimEntry, ...] = ()
    hypotheses: tuple[RegisteredHypothesis, ...] = ()
    figures: tuple[StudyFigure, ...] = ()
    record: tuple[str, ...] = ()
    sets: tuple[str, ...] = ()
    quick_sets: tuple[str, ...] = ()
    repairs: tuple[str, ...] = ()
    bases: dict[str, tuple[str, ...]] = {}  # noqa: RUF012 (pydantic copies it)
    basis: str = "evidence"
    summary: str = ""
    literal: bool = True
    published_runs_assumed: bool = False


class StudyDocument(DocumentModel):
    """A study: what is run, what is claimed and registered about the results, and what the measures and figures need.

    `published` holds what a paper prints, `registered` thresholds that were written before the runs.
    `published_runs` is the number of Monte Carlo runs behind a published value, where a claim gives no other.
    """

    source: str
    takes_data: bool = False
    published_runs: int = 0
    published: dict[str, Any] = {}  # noqa: RUF012 (pydantic copies it)
    registered: dict[str, Any] = {}  # noqa: RUF012 (pydantic copies it)
    experiments: tuple[ExperimentEntry, ...]


ENTRY: Final = "study"


@final
class StudyCode:
    """The functions of a study.

    Args:
        folder: the study's folder.
        ours: whether it comes with wsnsim.
    """

    def __init__(self, folder: Path, ours: bool) -> None:
        self._folder = folder
        self._ours = ours
        self._package = f"wsnsim_study_{zlib.crc32(str(folder).encode()):08x}"

    def functions(self, mapping: str) -> Mapping[str, Callable[..., Any]]:
        """One of MAPPINGS; empty if `study.py` does not define it, or does not exist.

        Raises:
            UsageError: it cannot be imported, or it is no mapping of functions.
        """
        found = getattr(self.module(ENTRY), mapping, {}) if (self._folder / f"{ENTRY}.py").is_file() else {}
        if not isinstance(found, Mapping) or not all(callable(each) for each in found.values()):
            raise UsageError(f"{self._folder / ENTRY}.py: {mapping} must be a mapping from names to functions")
        return found

    def digest(self) -> str:
        """The SHA-256 of the Python files in the folder."""
        files = sorted(self._folder.glob("*.py"))
        return hashlib.sha256(b"\0".join(path.name.encode() + b"\0" + path.read_bytes() for path in files)).hexdigest()

    def module(self, name: str) -> ModuleType:
        """One of the study's Python files, imported once.

        Raises:
            UsageError: it cannot be imported; names file and line.
        """
        if self._package not in sys.modules:
            package = ModuleType(self._package)
            package.__path__ = [str(self._folder)]
            sys.modules[self._package] = package
        whole = f"{self._package}.{name}"
        if whole not in sys.modules and not self._ours:
            announce(PluginImport("study", str(self._folder), name, str(self._folder / f"{name}.py")))
            note_plugin(whole)
        try:
            return importlib.import_module(whole)
        except (Exception, SystemExit) as error:
            if self._ours:
                raise
            said = plugin_fault(error) or f"{self._folder / name}.py: {type(error).__name__}: {error}"
            raise UsageError(said) from error
