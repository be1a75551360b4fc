"""The Python files of a study: `study.py` with its measures and figures, and files beside it that it imports.

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
from typing import Any, Final, final

from wsnsim.base.errors import UsageError
from wsnsim.base.plugin_code import PluginImport, announce, note_plugin, plugin_fault

ENTRY: Final = "study"
MAPPINGS: Final = ("MEASURES", "FIGURES", "SUMMARIES", "EXPERIMENTS")


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
