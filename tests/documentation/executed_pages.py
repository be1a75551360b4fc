"""Runs the examples of documentation pages: files are written, commands and Python blocks executed, output compared.

On a page, in order and in one temporary folder:

- a `yaml` or `python` block whose first line is `# file: NAME` is written to NAME, without that line;
- a `console` block holds commands, each on a line that begins with `$ `, and below a command what it prints: each line
  must occur in the real output, in order; `...` stands for anything. `wsnsim`, `python` and `head` run, others are
  skipped; `console pyproj gpxpy` is run where these modules are installed;
- any other `python` block is executed; the blocks of a page share their names.

A block opened by ```` ```{code-block} ```` or in another language is not executed here; blocks in `r`, `octave` and
`matlab` are executed by `test_r_and_octave_pages`, where these programs are installed.
"""

from __future__ import annotations

import importlib.util
import os
import re
import shlex
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from tests.documentation.example_server import ROOT, SECONDS, SETTINGS, server

FENCE = re.compile(r"^( *)(`{3,}|~{3,})(.*)$")
FILE = re.compile(r"# file: (\S+)$")
RUNS = ("wsnsim", "python", "head")
SHELL = re.compile(r"[|&;<>$`(){}*?~#]")
"""Characters that mean something to a shell."""


class ExampleError(AssertionError):
    """An example of a page does not do what the page says."""


@dataclass(frozen=True)
class Block:
    """A fenced block: its language, its lines, and the line number of the first of them."""

    language: str
    lines: tuple[str, ...]
    first: int


@dataclass(frozen=True)
class Command:
    """A command of a console block, its line number, and the lines that it is said to print."""

    text: str
    line: int
    printed: list[str] = field(default_factory=list)

    @property
    def runs(self) -> bool:
        """Whether the first program of the command is one that the tests run."""
        words = [word for word in self.text.split() if not re.match(r"\w+=", word)]
        return bool(words) and words[0] in RUNS


def blocks(text: str) -> Iterator[Block]:
    """Yield the fenced blocks of a Markdown page; blocks inside a directive are part of the directive."""
    opened: tuple[str, str, str, int] | None = None
    lines: list[str] = []
    for number, line in enumerate(text.splitlines(), 1):
        fence = FENCE.match(line)
        if opened is None:
            if fence:
                opened, lines = (fence[1], fence[2], fence[3].strip(), number), []
            continue
        indent, mark, language, start = opened
        if fence and fence[2].startswith(mark) and not fence[3].strip():
            yield Block(language, tuple(lines), start + 1)
            opened = None
        else:
            lines.append(line.removeprefix(indent))


def commands(block: Block) -> list[Command]:
    """Return the commands of a console block; a line that ends in a backslash goes on in the next."""
    found: list[Command] = []
    continued = False
    for number, line in enumerate(block.lines, block.first):
        if continued:
            last = found.pop()
            found.append(Command(f"{last.text}\n{line.removeprefix('> ')}", last.line))
        elif line.startswith("$ "):
            found.append(Command(line[2:], number))
        elif found and line.strip():
            found[-1].printed.append(line)
        continued = line.endswith("\\") and not (found and found[-1].printed)
    return found


def squeezed(line: str) -> str:
    """Return a line in which any run of spaces is one."""
    return " ".join(line.split())


def first_missing(printed: list[str], output: str) -> str | None:
    """Return the first line that does not occur in the output after the line before it; None if all do."""
    rest = [squeezed(line) for line in output.splitlines()]
    for line in printed:
        wanted = squeezed(line)
        if wanted == "...":
            continue
        pattern = re.compile(".*".join(re.escape(part.strip()) for part in wanted.split("...")))
        row = next((row for row, real in enumerate(rest) if pattern.search(real)), None)
        if row is None:
            return line
        rest = rest[row + 1 :]
    return None


def environment(folder: Path) -> dict[str, str]:
    """Return the environment of the examples, where `wsnsim` and `python` are those of the tests."""
    programs = folder.parent / f"{folder.name}-programs"
    programs.mkdir(exist_ok=True)
    for name, words in (("wsnsim", "-P -m wsnsim"), ("python", "")):
        program = programs / name
        program.write_text(f'#!/bin/sh\nexec "{sys.executable}" {words} "$@"\n', encoding="utf-8")
        program.chmod(0o755)
    return {
        **os.environ,
        "PATH": os.pathsep.join([str(programs), os.environ["PATH"]]),
        **SETTINGS,
    }


def run_page(page: Path, folder: Path) -> int:
    """Execute the examples of a page in a folder, and return how many commands and Python blocks were executed.

    Raises:
        ExampleError: an example fails or prints something else; the message names page, line and difference.
    """
    name = page.relative_to(ROOT) if page.is_relative_to(ROOT) else page
    env, count = environment(folder), 0
    try:
        for block in blocks(page.read_text(encoding="utf-8")):
            if title := named_file(block):
                place = folder / title
                place.parent.mkdir(parents=True, exist_ok=True)
                place.write_text("\n".join(block.lines[1:]) + "\n", encoding="utf-8")
            elif is_run(block.language):
                for command in filter(lambda command: command.runs, commands(block)):
                    run_command(command, name, folder, env)
                    count += 1
            elif block.language == "python":
                code = "\n" * (block.first - 1) + "\n".join(block.lines)
                if error := server().block(code, str(name), folder, env):
                    raise ExampleError(f"{name}:{block.first}: a Python block fails:\n{error}")
                count += 1
    finally:
        server().end_page()
    return count


def is_run(language: str) -> bool:
    """Whether a block holds commands, and the modules that it names behind `console` are installed."""
    kind, *needed = language.split() or [""]
    return kind == "console" and all(map(importlib.util.find_spec, needed))


def named_file(block: Block) -> str | None:
    """Return the name of the file that a block shows, if its first line gives one."""
    title = FILE.match(block.lines[0]) if block.lines and block.language in ("yaml", "python") else None
    return title[1] if title else None


def outcome(text: str, folder: Path, env: dict[str, str]) -> tuple[int, str]:
    """The exit code of a command and what it prints. Commands that need a shell (pipes, variables) are run by bash."""
    words = shlex.split(text.replace("\\\n", " "))
    if not SHELL.search(text) and (words[0] == "wsnsim" or (words[1:2] and words[1].endswith(".py"))):
        return server().command(words, folder, env)
    done = subprocess.run(
        ["bash", "-c", text],
        cwd=folder,
        env=env,
        capture_output=True,
        text=True,
        timeout=SECONDS,
        stdin=subprocess.DEVNULL,
        check=False,
    )
    return done.returncode, f"{done.stdout}{done.stderr}"


def run_command(command: Command, page: Path, folder: Path, env: dict[str, str]) -> None:
    """Run a command and compare its output; it may fail only if the page shows an error or an exit code."""
    code, printed = outcome(command.text, folder, env)
    output = f"{printed}\nexit code {code}"
    shows_failure = any("error:" in line or line.startswith("exit code") for line in command.printed)
    where = f"{page}:{command.line}: $ {command.text}\n"
    if code and not shows_failure:
        raise ExampleError(f"{where}fails:\n{output}")
    if (missing := first_missing(command.printed, output)) is not None:
        raise ExampleError(f"{where}does not print, at all or in this order:\n{missing}\nIt prints:\n{output}")


def main() -> None:
    """Execute the pages that the command line names: python -m tests.documentation.executed_pages docs/x.md."""
    failed = False
    for page in sys.argv[1:]:
        with tempfile.TemporaryDirectory() as folder:
            work = Path(folder, "work")
            work.mkdir()
            before = time.perf_counter()
            try:
                said = f"{run_page(Path(page).resolve(), work)} examples"
            except ExampleError as error:
                said, failed = str(error), True
            print(f"{page}: {said}, {time.perf_counter() - before:.0f} s")
    raise SystemExit(int(failed))


if __name__ == "__main__":
    main()
