"""The errors of wsnsim, as one tree.

WsnsimError                    exit code
├── UsageError                 2   the command line is wrong
├── ScenarioError              2   a scenario is invalid; carries every Issue of the file
├── ResultError                1   a result file cannot be read, written or trusted
│   └── StorageError           1   it cannot be written, and neither can any other file of the folder
└── RunError                   1   a simulation failed; names seed, replicate and simulated time
"""

from __future__ import annotations

import contextlib
import difflib
import warnings
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from wsnsim.base.plugin_code import plugin_fault

MOST_PRINTED: Final = 50
"""Issues of one scenario or sweep that a message names."""
LONGEST_PATH: Final = 200
"""Characters of a path of keys in a message."""


class WsnsimError(Exception):
    """An error that a user of wsnsim can act on. `str(error)` is the whole message."""

    exit_code = 1


class UsageError(WsnsimError):
    """The command line is wrong: an unknown name, or options that exclude each other."""

    exit_code = 2


@dataclass(frozen=True)
class Issue:
    """One finding of the validation: where it is, and what is wrong.

    Attributes:
        path: keys that lead to the value, such as ('tracker', 'kind').
        message: what is wrong, what is allowed, and what is nearest.
        place: position in the text ('x.yaml:14:9' or '--set link.reach'); filled in by the loader.
        excerpt: the line of the text with a caret under it; filled in by the loader.
    """

    path: tuple[str | int, ...]
    message: str
    place: str = ""
    excerpt: str = ""

    def __str__(self) -> str:
        dotted = ".".join(str(key) for key in self.path)
        dotted = dotted if len(dotted) <= LONGEST_PATH else f"{dotted[:LONGEST_PATH]}…"
        head = ": ".join(piece for piece in (self.place, "error", dotted) if piece)
        return f"{head}: {self.message}" + (f"\n{self.excerpt}" if self.excerpt else "")


class ScenarioError(WsnsimError):
    """A scenario is invalid. `issues` holds everything that is wrong with it; the message names the first 50."""

    exit_code = 2

    def __init__(self, issues: Iterable[Issue]) -> None:
        self.issues = tuple(issues)
        more = len(self.issues) - MOST_PRINTED
        rest = [f"and {more} more error{'s' * (more > 1)}"] if more > 0 else []
        super().__init__("\n".join([*(str(issue) for issue in self.issues[:MOST_PRINTED]), *rest]))

    @property
    def faults(self) -> tuple[Issue, ...]:
        """The old name of `issues`."""
        warnings.warn("ScenarioError.faults is now ScenarioError.issues", DeprecationWarning, stacklevel=2)
        return self.issues


class ResultError(WsnsimError):
    """A result file cannot be read, written or trusted."""


class StorageError(ResultError):
    """A result cannot be written: the disk is full, or the folder is missing or read-only."""


class RunError(WsnsimError):
    """A simulation failed."""


def failed_run(time: float, seed: int, replicate: int, reason: BaseException) -> RunError:
    """Return the error of a run that failed: how to repeat it, and the reason."""
    name = "" if isinstance(reason, WsnsimError) else f"{type(reason).__name__}: "
    said = plugin_fault(reason) or f"{name}{reason}"
    return RunError(f"the run failed at {time:g} s of simulated time (seed {seed}, replicate {replicate}): {said}")


@contextlib.contextmanager
def plugin_faults_of_run(seed: int, replicate: int, classes: Sequence[str] = ()) -> Iterator[None]:
    """Report an exception in the code of a plug-in as a failed run; others pass unchanged.

    Args:
        seed: Seed of the run.
        replicate: Number of the run.
        classes: The classes of plug-ins that take part. What fails elsewhere, perhaps because of their answers, is
            reported with their names.
    """
    try:
        yield
    except (Exception, SystemExit) as reason:
        in_plugin, ours = bool(plugin_fault(reason)), isinstance(reason, WsnsimError)
        if (ours if in_plugin else not classes) or isinstance(reason, ResultError):
            raise
        failed = reason if ours else failed_run(0.0, seed, replicate, reason)
        raise (failed if in_plugin else RunError(f"{failed} (with the plug-in {', '.join(classes)})")) from reason


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Return the end of a message about an unknown name: the nearest known name, or all of them if none is near."""
    names = sorted(known)
    near = difflib.get_close_matches(word.lower(), [name.lower() for name in names], n=1, cutoff=0.6)
    if near:
        original = next(name for name in names if name.lower() == near[0])
        return f"did you mean '{original}'?"
    return "known: " + ", ".join(names) if names else "none is known"


def __getattr__(name: str) -> type[Issue]:
    """Return a class by its old name."""
    if name != "Fault":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    warnings.warn("wsnsim.base.errors.Fault is now Issue", DeprecationWarning, stacklevel=2)
    return Issue
