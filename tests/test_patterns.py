"""Every regular expression is applied in linear time, whatever a text holds: counted by a matcher that backtracks."""

from __future__ import annotations

import ast
import importlib
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

PARSER: Any = re._parser  # type: ignore[attr-defined]
APPLIED = ("compile", "match", "search", "fullmatch", "sub", "split", "findall", "finditer")

FOREIGN = {
    ("interop.ns3", "_SET"): ("match", "$node_(0) set X_ 12.5"),
    ("interop.ns3", "_AT"): ("match", '$ns_ at 4.0 "$node_(3) setdest 80.0 20.0 1.5"'),
    ("interop.ns3", "_GO"): ("match", "$node_(3) setdest 80.0 20.0 1.5"),
    ("interop.ns3", "_COURSE"): ("match", "now=+4s node=3 pos=10:20:0 vel=1.2:0:0"),
    ("interop.ns3", "_TIME"): ("fullmatch", "+4.5e+09ns"),
    ("interop.ns3", "NUMBER"): ("fullmatch", "-12.5e-3"),
    ("interop.trajectories", "'[^\\\\w.-]'"): ("search", "bus 1"),
    ("interop.conventions", "'[\\\\s.\\\\-]+'"): ("search", "a . b"),
    ("interop.conventions", "STATED"): ("search", "range [mm]"),
    ("interop.tables", "DECIMAL_COMMA"): ("fullmatch", "-1,5"),
    ("interop.tables", "DECIMAL_POINT"): ("fullmatch", "-1.5"),
    ("interop.tables", "NUMBER"): ("fullmatch", "-1.5e+3"),
    ("interop.tables", "WIDTHS"): ("search", "Expected 3 fields in line 4, saw 5"),
    ("interop.tables", "'\\\\.\\\\d+$'"): ("search", "x.1"),
    ("interop.tables", "'<!\\\\s*(DOCTYPE|ENTITY)'"): ("search", "<! DOCTYPE"),
    ("models.csvfile", "IDENTIFIER"): ("search", "moteid"),
    ("models.row_checks", "VARYING"): ("search", "is '7,02'"),
    ("models.row_checks", "DATED"): ("search", "must be a finite number, is '2026-01-01"),
    ("interop.trajectories", "'^\\\\W|[^\\\\w.-]'"): ("search", "bus 1"),
    ("scenario.tracker_choices", "PARAMETER"): ("match", " a.b_1.c = 1"),
    ("scenario.tracker_choices", "WITH_PARAMETERS"): ("fullmatch", "pf:particles.a=1"),
    ("scenario.units", "QUANTITY"): ("fullmatch", "-1.5e3  1 / m"),
    ("scenario.units", "FACTOR"): ("fullmatch", "m^-2"),
    ("scenario.units", "'([/*])'"): ("search", "m / s * s"),
    ("scenario.axes", "WRITTEN"): ("fullmatch", "1.5e3  m"),
    ("scenario.schema", "SAFE_CHARACTERS"): ("fullmatch", "a-b.c"),
    ("scenario.texts", "SHEET"): ("search", "sheet : radio"),
    ("scenario.reader", "INT"): ("fullmatch", "-120"),
    ("scenario.reader", "FLOAT"): ("fullmatch", "-12.5e+3"),
    ("scenario.reader", "BOOL"): ("fullmatch", "true"),
    ("scenario.reader", "NULL"): ("fullmatch", "null"),
    ("scenario.reader", "'<<'"): ("fullmatch", "<<"),
    ("scenario.reader", "f'(?:{_pattern.pattern})$'"): ("match", "<<"),
    ("scenario.units", "'[/*]'"): ("search", "m/s"),
    ("scenario.sweep", "'^\\\\W|[^\\\\w.\\\\-]'"): ("search", ".a b"),
    ("papers.reproduction", "FIELD"): ("fullmatch", "rmse[gpf: 5 %].measured"),
    ("recording.atomic_files", "\"error message = '([^']*+)'\""): ("search", "a error message = 'b' c"),
    ("base.errors", "'(?<=[a-z])(?=[A-Z])'"): ("search", "aWord"),
    ("base.errors", "'[\\\\s.\\\\-/]+'"): ("search", "a . b"),
    ("analysis.frames", "'\\\\W'"): ("search", "a b"),
    ("analysis.frames", "'[A-Za-z]'"): ("match", "a"),
}
"""{(module, the pattern or its name): (how it is applied, a text that it fits)}."""

OWN = {
    "report": "pages and figures that we made",
    "watch": "pages that we made",
    "recording": "names",
    "scenario.parameter_info": "numbers",
    "analysis.sweep_lines": "descriptions of our fields",
    "analysis.citing": "a table we ship",
    "cli.listing": "files we ship",
    "base.border": "annotations of our ports",
    "base.facades": "our façades",
}
"""Modules whose patterns meet our own texts, or names of files, which have at most 255 characters."""


def _patterns() -> Iterator[tuple[str, str]]:
    """Yield the module and the text of each pattern of the package; a constant has its name."""
    for path in sorted(Path("wsnsim").rglob("*.py")):
        module = ".".join(path.with_suffix("").parts[1:])
        text = path.read_text(encoding="utf-8")
        nodes = list(ast.walk(ast.parse(text))) if "import re\n" in text else []
        named = {
            id(node.value): ast.unparse(node.target if isinstance(node, ast.AnnAssign) else node.targets[0])
            for node in nodes
            if isinstance(node, ast.Assign | ast.AnnAssign)
        }
        for node in nodes:
            if isinstance(node, ast.Call) and re.fullmatch(rf"re\.({'|'.join(APPLIED)})", ast.unparse(node.func)):
                yield module, named.get(id(node)) or ast.unparse(node.args[0])


def _is_own(module: str) -> bool:
    return any(module == own or module.startswith(f"{own}.") for own in OWN)


def test_every_pattern_is_counted_or_meets_only_our_own_texts() -> None:
    assert {key for key in _patterns() if not _is_own(key[0])} - FOREIGN.keys() == set()


class _Counted:
    """A backtracking matcher of a parsed pattern, which counts its steps."""

    def __init__(self, pattern: str, flags: int, text: str) -> None:
        self.tree, self.flags, self.text, self.steps = PARSER.parse(pattern, flags), flags, text, 0

    def apply(self, how: str) -> None:
        """Apply the pattern in one of the ways of `re`, to the first match."""
        for start in range(len(self.text) + 1) if how == "search" else [0]:
            if any(how != "fullmatch" or end == len(self.text) for end in self._all(list(self.tree), start)):
                return

    def _all(self, items: list[Any], at: int) -> Iterator[int]:
        if not items:
            yield at
            return
        for end in self._one(*items[0], at):
            yield from self._all(items[1:], end)

    def _one(self, op: Any, given: Any, at: int) -> Iterator[int]:
        self.steps += 1
        name = str(op)
        if name == "SUBPATTERN":
            yield from self._all(list(given[-1]), at)
        elif name == "BRANCH":
            for branch in given[1]:
                yield from self._all(list(branch), at)
        elif name in ("MAX_REPEAT", "MIN_REPEAT"):
            yield from self._repeated(name == "MAX_REPEAT", *given, at, 0)
        elif name == "POSSESSIVE_REPEAT":
            yield from list(self._repeated(True, *given, at, 0))[:1]
        elif name == "AT":
            if self._holds(str(given), at):
                yield at
        elif name == "ASSERT":
            if any(True for _ in self._all(list(given[1]), at + min(given[0], 0))):
                yield at
        elif at < len(self.text) and re.match(_one_character(op, given), self.text[at], self.flags):
            yield at + 1

    def _repeated(self, greedy: bool, least: int, most: int, items: Any, at: int, done: int) -> Iterator[int]:
        if not greedy and done >= least:
            yield at
        if done < most:
            for end in self._all(list(items), at):
                if end > at:
                    yield from self._repeated(greedy, least, most, items, end, done + 1)
        if greedy and done >= least:
            yield at

    def _holds(self, where: str, at: int) -> bool:
        if where in ("AT_BEGINNING", "AT_BEGINNING_STRING"):
            return at == 0 or (bool(self.flags & re.MULTILINE) and self.text[at - 1] == "\n")
        assert where == "AT_END", where
        return at == len(self.text) or self.text[at:] == "\n"


CATEGORIES = {"CATEGORY_DIGIT": r"\d", "CATEGORY_SPACE": r"\s", "CATEGORY_WORD": r"\w", "CATEGORY_NOT_DIGIT": r"\D",
              "CATEGORY_NOT_SPACE": r"\S", "CATEGORY_NOT_WORD": r"\W"}  # fmt: skip


def _one_character(op: Any, given: Any) -> str:
    """The pattern of an item that fits one character."""
    name = str(op)
    if name == "ANY":
        return "."
    if name in ("LITERAL", "NOT_LITERAL"):
        return f"[{'^' * (name != 'LITERAL')}{re.escape(chr(given))}]"
    assert name == "IN", name
    return f"[{''.join(_in_class(str(kind), value) for kind, value in given)}]"


def _in_class(kind: str, value: Any) -> str:
    """A member of a class of characters."""
    if kind == "RANGE":
        return "-".join(re.escape(chr(code)) for code in value)
    return "^" if kind == "NEGATE" else CATEGORIES[str(value)] if kind == "CATEGORY" else re.escape(chr(value))


def _steps(pattern: re.Pattern[str], how: str, text: str) -> int:
    counted = _Counted(pattern.pattern, pattern.flags & (re.ASCII | re.MULTILINE | re.DOTALL), text)
    counted.apply(how)
    return counted.steps


def _quadratic(pattern: re.Pattern[str], how: str, example: str) -> list[str]:
    """The texts whose steps grow faster than their length: those of linear ones are a + b n, so differences double."""
    found = []
    for at in range(1, len(example) + 1):
        begin, rest = example[:at], example[at:]
        for repeated in {begin[-1], example[max(at - 2, 0) : at], " ", "1"}:
            for end in (f"{rest}\n!", "!"):
                few, more, most = (_steps(pattern, how, f"{begin}{repeated * n}{end}") for n in (8, 16, 32))
                if most - more > 2.5 * (more - few) + 20:  # at an end, a few steps come on top
                    found.append(f"{begin}({repeated!r} * n){end!r}: {few}, {more}, {most} steps")
    return found


def _compiled(module: str, name: str) -> re.Pattern[str]:
    value = eval(name, vars(importlib.import_module(f"wsnsim.{module}")))
    return value if isinstance(value, re.Pattern) else re.compile(value)


@pytest.mark.parametrize("key", FOREIGN, ids=lambda key: ".".join(key))
def test_a_text_twice_as_long_takes_at_most_twice_as_many_steps(key: tuple[str, str]) -> None:
    how, example = FOREIGN[key]
    assert getattr(_compiled(*key), how)(example), "the example does not fit"
    assert _quadratic(_compiled(*key), how, example) == []


@pytest.mark.parametrize(
    ("pattern", "how", "example"),
    [
        (r"\d+\.?\d*s", "match", "11s"),
        (r"\$\w+\s+at\s+\S+\s+\"?[^\"]*\"?\s*$", "match", '$ns at 4 "a"'),
        (r"\s*[/*]\s*", "search", "m / s"),
        (r"1\s*(.*)", "fullmatch", "1 m"),
    ],
)
def test_the_matcher_finds_what_was_quadratic(pattern: str, how: str, example: str) -> None:
    assert _quadratic(re.compile(pattern), how, example)
