"""What can go wrong, as one tree.

WsnsimError                    exit code
├── UsageError                 2   the command line asks for what is not there
├── ScenarioError              2   a scenario says what cannot be: carries every Fault of the file at once
├── ResultError                1   a result file cannot be read, written or trusted
│   └── StorageError           1   it cannot be written: nor could any other beside it
└── RunError                   1   a simulation could not go on: names seed, replicate and simulated time
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from dataclasses import dataclass


class WsnsimError(Exception):
    """Whatever a user of wsnsim can act on. `str(error)` is the whole message."""

    exit_code = 1


class UsageError(WsnsimError):
    """The command line asks for what is not there."""

    exit_code = 2


@dataclass(frozen=True)
class Issue:
    """One fault of a scenario: where (a path of keys such as ('tracker', 'kind')), and what.

    `place` is where the text stands ('x.yaml:14:9' or '--set link.reach'), `excerpt` the line with a caret under it;
    both are filled in by the loader, which alone knows the text.
    """

    path: tuple[str | int, ...]
    message: str
    place: str = ""
    excerpt: str = ""

    def __str__(self) -> str:
        dotted = ".".join(str(key) for key in self.path)
        head = ": ".join(piece for piece in (self.place, "error", dotted) if piece)
        return f"{head}: {self.message}" + (f"\n{self.excerpt}" if self.excerpt else "")


class ScenarioError(WsnsimError):
    """A scenario says what cannot be; `faults` holds every fault found."""

    exit_code = 2

    def __init__(self, faults: Iterable[Issue]) -> None:
        self.faults = tuple(faults)
        super().__init__("\n".join(str(fault) for fault in self.faults))


class ResultError(WsnsimError):
    """A result file cannot be read, written or trusted."""


class StorageError(ResultError):
    """A result cannot be written: the disk is full, the folder is gone or takes nothing."""


class RunError(WsnsimError):
    """A simulation could not go on."""


def failed_run(time: float, seed: int, replicate: int, reason: BaseException) -> RunError:
    """The error of a run that failed: where it can be repeated, and why it ended."""
    name = "" if isinstance(reason, WsnsimError) else f"{type(reason).__name__}: "
    return RunError(
        f"the run failed at {time:g} s of simulated time (seed {seed}, replicate {replicate}): {name}{reason}"
    )


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """The closing words of a message about an unknown name: the nearest known one, or all of them if none is near."""
    names = sorted(known)
    near = difflib.get_close_matches(word.lower(), [name.lower() for name in names], n=1, cutoff=0.6)
    if near:
        original = next(name for name in names if name.lower() == near[0])
        return f"did you mean '{original}'?"
    return "known: " + ", ".join(names) if names else "none is known"
