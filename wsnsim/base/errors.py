r"""The errors of wsnsim, as one tree.

WsnsimError                    exit code
├── UsageError                 2   the command line is wrong
├── ScenarioError              2   a scenario is invalid; carries every Issue of the file
├── ResultError                1   a result file cannot be read, written or trusted
│   └── StorageError           1   it cannot be written, and neither can any other file of the folder
└── RunError                   1   a simulation failed; names seed, replicate and simulated time
    └── PluginAnswerError      1   a plug-in answered otherwise than its port says

Texts of files, plug-ins and names are printed with escapes (`printable`): a name such as 'x\x1b[2J' would clear the
terminal, and bidirectional characters reorder a line.
"""

from __future__ import annotations

import contextlib
import difflib
import functools
import re
import unicodedata
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from wsnsim.base.files import read_sections
from wsnsim.base.plugin_code import plugin_fault

FILLERS: Final = (
    "model",
    "filter",
    "sensor",
    "tracker",
    "motion",
    "mac",
    "protocol",
    "kind",
    "the",
    "m",
    "s",
    "hz",
    "dbm",
)
"""Words that a name may have more than a row of the table."""


@functools.cache
def synonyms() -> dict[str, tuple[str, ...]]:
    """Return what each word may mean, the likeliest first: the rows of synonyms.table."""
    found: dict[str, tuple[str, ...]] = {}
    for _, rows in read_sections(Path(__file__).with_name("synonyms.table")):
        for words, names in rows:
            for word in words.split(", "):
                found[word] = (*found.get(word, ()), *names.split())
    return found


def meant_by(word: str, known: Collection[str]) -> list[str]:
    """Return the known names that a word may mean, the likeliest first; none if the table has no such word."""
    by_form = {_form(name): name for name in sorted(known, reverse=True)}
    for form in _forms(word):
        names = [form, *synonyms().get(form, ())]
        found = [by_form[name] for name in dict.fromkeys(names) if name in by_form]
        if found and _form(word) not in known:
            return found
    return []


def _forms(word: str) -> Iterator[str]:
    """Yield the word, then without fillers, then each of its own words."""
    form = _form(re.sub(r"(?<=[a-z])(?=[A-Z])", "_", word))
    pieces = form.split("_")
    yield form
    yield form.replace("_", "")
    yield form.removesuffix("s")
    yield "_".join(piece for piece in pieces if piece not in FILLERS)
    if len(pieces) > 1:
        yield from (piece for piece in pieces if piece not in FILLERS and len(piece) > 1)


def _form(word: str) -> str:
    return re.sub(r"[\s.\-/]+", "_", word.strip().lower())


MOST_PRINTED: Final = 50
"""Issues of one scenario or sweep that a message names."""
LONGEST_PATH: Final = 200
"""Characters of a path of keys in a message."""
TYPING_ERROR: Final = 0.85
"""Similarity from which a word is a typing error of another."""
ALIKE: Final = 0.6
"""Similarity from which a name is suggested that a word may be."""


class WsnsimError(Exception):
    """An error that a user of wsnsim can act on. `str(error)` is the whole message, without control characters."""

    exit_code = 1

    def __str__(self) -> str:
        return printable(super().__str__())


class UsageError(WsnsimError):
    """The command line is wrong: an unknown name, or options that exclude each other."""

    exit_code = 2


def dotted(path: tuple[str | int, ...]) -> str:
    """Return a path as messages write it: targets.0.bound."""
    return ".".join(str(key) for key in path)


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
        path = dotted(self.path)
        path = path if len(path) <= LONGEST_PATH else f"{path[:LONGEST_PATH]}…"
        head = ": ".join(piece for piece in (self.place, "error", path) if piece)
        return printable(f"{head}: {self.message}" + (f"\n{self.excerpt}" if self.excerpt else ""))


class ScenarioError(WsnsimError):
    """A scenario is invalid. `issues` holds everything that is wrong with it; the message names the first 50."""

    exit_code = 2

    def __init__(self, issues: Iterable[Issue]) -> None:
        self.issues = tuple(issues)
        more = len(self.issues) - MOST_PRINTED
        rest = [f"and {more} more error{'s' * (more > 1)}"] if more > 0 else []
        super().__init__("\n".join([*(str(issue) for issue in self.issues[:MOST_PRINTED]), *rest]))


class ResultError(WsnsimError):
    """A result file cannot be read, written or trusted."""


class StorageError(ResultError):
    """A result cannot be written: the disk is full, or the folder is missing or read-only."""


class RunError(WsnsimError):
    """A simulation failed."""


class PluginAnswerError(RunError):
    """A plug-in answered, or asked, otherwise than its port says.

    Attributes:
        said: what it answered, and what was expected.
        place: file and line in the plug-in's code; '' if the traceback says it.
    """

    def __init__(self, said: str, place: str = "") -> None:
        super().__init__(f"{place}: {said}" if place else said)
        self.said, self.place = said, place


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
        ours = isinstance(reason, WsnsimError) and not isinstance(reason, PluginAnswerError)
        in_plugin = bool(plugin_fault(reason))
        if (ours if in_plugin else not classes) or isinstance(reason, ResultError):
            raise
        failed = reason if ours else failed_run(0.0, seed, replicate, reason)
        raise (failed if in_plugin else RunError(f"{failed} (with the plug-in {', '.join(classes)})")) from reason


def did_you_mean(word: str, known: Iterable[str], otherwise: str = "") -> str:
    """Return the end of a message about an unknown name: the known names that it may mean or that are spelled alike.

    Args:
        word: the unknown name.
        known: the known names.
        otherwise: what to say if none is near; '' for a list of all known names.
    """
    names = sorted(known)
    if near := nearest(word, names):
        return f"did you mean {' or '.join(map(repr, near))}?"
    return otherwise or ("known: " + ", ".join(names) if names else "none is known")


def nearest(word: str, known: Sequence[str]) -> list[str]:
    """Return the known names nearest to a word: one that is misspelled, else those that it means, three at most."""
    return _spelled(word, known, TYPING_ERROR) or meant_by(word, known)[:3] or _spelled(word, known, ALIKE)


def _spelled(word: str, known: Sequence[str], cutoff: float) -> list[str]:
    near = difflib.get_close_matches(word.lower(), [name.lower() for name in known], n=1, cutoff=cutoff)
    return [next(name for name in known if name.lower() == near[0])] if near else []


def printable(text: str) -> str:
    """The text with every character escaped that is neither visible nor a space, a tab or the end of a line."""
    return text if _is_plain(text) else "".join(c if _is_shown(c) else _escaped(c) for c in text)


def shortened(text: str, most: int = 60) -> str:
    """The text, or its beginning and its end with '…' between them if it has more than `most` characters."""
    return text if len(text) <= most else f"{text[: most - 10]}…{text[-9:]}"


def printable_json(text: str) -> str:
    """The JSON text with the same characters escaped as JSON escapes them; it holds the same values."""
    return text if _is_plain(text) else "".join(c if _is_shown(c) else _escaped_json(c) for c in text)


def _is_plain(text: str) -> bool:
    """Whether nothing is escaped: a quick answer for most texts."""
    return text.replace("\n", "").replace("\t", "").isprintable()


def _is_shown(c: str) -> bool:
    return c.isprintable() or c in "\n\t" or unicodedata.category(c) == "Zs"


def _escaped(c: str) -> str:
    return c.encode("unicode_escape").decode("ascii")


def _escaped_json(c: str) -> str:
    units = c.encode("utf-16-be", "surrogatepass")
    return "".join(f"\\u{units[i]:02x}{units[i + 1]:02x}" for i in range(0, len(units), 2))


LONGEST_VALUE: Final = 80
"""Characters of a value in a message."""


def shown_value(value: Any) -> str:
    """Return a value as a message shows it: cut where it is long, and its type where it takes several lines."""
    text = repr(value)
    if "\n" in text:
        return f"a {type(value).__name__}"
    return text if len(text) <= LONGEST_VALUE else f"{text[: LONGEST_VALUE - 3]}..."


def counted(count: int, word: str) -> str:
    """A number with its noun: '1 packet', '2 packets', '9,024 bits'."""
    return f"{count:,} {word}{'' if count == 1 else 's'}"
