"""Pipes, long names, endless chains and control characters, given to the command line: one message each."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

from wsnsim.cli import main

ROOT = Path(__file__).parents[2]
TINY = "extends: rkf\nduration: 2 s\n"


@pytest.fixture(autouse=True)
def _alone(fresh_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.setattr(os, "environ", os.environ.copy())


def said(words: list[str], code: int, capsys: pytest.CaptureFixture[str]) -> str:
    """What a command that fails with this code says on stderr."""
    assert main(words) == code
    return capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (["check", "pipe"], 2),
        (["run", "pipe"], 2),
        (["run", "pipe.h5"], 1),
        (["sweep", "pipe", "--replicates", "1"], 2),
        (["info", "pipe"], 2),
        (["info", "pipe.h5"], 1),
        (["plot", "pipe.h5"], 1),
        (["report", "pipe.h5"], 1),
        (["verify", "pipe.h5"], 1),
        (["trace", "pipe.h5", "--step", "1"], 1),
        (["diff", "pipe.h5", "pipe.h5"], 2),
        (["export", "pipe.h5", "--parquet", "out"], 1),
        (["recover", "pipe.h.1.tmp", "--out", "x.h5"], 1),
        (["run", "rkf", "--out", "pipe.h5"], 2),
    ],
)
def test_a_pipe_is_refused_wherever_a_file_is_expected(
    words: list[str], code: int, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("pipe", "pipe.h5", "pipe.h.1.tmp"):
        os.mkfifo(name)
    message = said(words, code, capsys)
    assert "is a pipe, not a regular file" in message and message.count("\n") == 1


def test_a_pipe_behind_a_path_of_a_scenario_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    os.mkfifo("nodes.csv")
    Path("x.yaml").write_text(TINY + "deploy: {kind: file, path: nodes.csv}\n")
    assert "nodes.csv: cannot be read: is a pipe, not a regular file" in said(["check", "x.yaml"], 2, capsys)


def test_a_chain_of_extended_scenarios_has_an_end(capsys: pytest.CaptureFixture[str]) -> None:
    Path("s0.yaml").write_text(TINY)
    for number in range(1, 40):
        Path(f"s{number}.yaml").write_text(f"extends: s{number - 1}\n")
    assert main(["check", "s13.yaml"]) == 0
    capsys.readouterr()
    message = said(["check", "s39.yaml"], 2, capsys)
    assert "extends: more than 16 files extend each other" in message and message.count("error") == 1


def test_at_most_fifty_errors_of_a_scenario_are_printed(capsys: pytest.CaptureFixture[str]) -> None:
    Path("x.yaml").write_text(TINY + "".join(f"unknown{number}: 1\n" for number in range(173)))
    lines = said(["check", "x.yaml"], 2, capsys).splitlines()
    assert sum("error: unknown" in line for line in lines) == 50
    assert lines[-1] == "and 123 more errors"


@pytest.mark.parametrize("name", ["x" * 101, "ж" * 80])
def test_a_name_that_is_too_long_for_a_file_is_refused(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    Path("x.yaml").write_text(f"{TINY}name: {name}\n", encoding="utf-8")
    message = "is too long to name a file: at most 100 characters and 150 bytes are allowed"
    assert message in said(["check", "x.yaml"], 2, capsys)
    assert message in said(["new", name], 2, capsys)
    Path("sweep.yaml").write_text(f"name: {name}\nscenario: rkf\nreplicates: 1\n", encoding="utf-8")
    assert message.replace("a file", "a folder") in said(["sweep", "sweep.yaml"], 2, capsys)


def test_an_output_whose_temporary_name_would_be_too_long_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    message = said(["run", "rkf", "--out", f"{'x' * 160}.h5"], 2, capsys)
    assert "the name of a file has at most 150 bytes" in message
    assert list(Path().iterdir()) == []


@pytest.mark.parametrize("name", ["a\x1b[31mb", "a\u202eb", "a\x9bb", "a\rb"])
def test_control_characters_of_a_name_are_not_echoed(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    Path(f"{name}.yaml").write_text(TINY + "tracker: {kind: x\n", encoding="utf-8")
    Path("x.yaml").write_text(f'{TINY}"k{name}": "{name.encode("unicode_escape").decode()}"\n', encoding="utf-8")
    commands = [["check", f"{name}.yaml"], ["check", "x.yaml"], ["run", name], ["list", name], ["plot", f"{name}.h5"]]
    for words in [*commands, ["run", "rkf", "--set", f"{name}=1"], ["run", "rkf", f"--{name}"], [name]]:
        assert main(words) in (1, 2)
        found = "".join(capsys.readouterr())
        assert found and name not in found
        assert all(c.isprintable() or c == "\n" for c in found)


def test_every_command_prints_through_the_function_that_escapes() -> None:
    for file in sorted((ROOT / "wsnsim").rglob("*.py")):
        text = file.read_text(encoding="utf-8")
        if file.name not in ("shared.py", "progress.py", "interrupts.py") or file.parent.name != "cli":
            assert "click.echo(" not in text and "click.secho(" not in text, file


def test_a_trace_begins_at_the_largest_error_if_there_is_a_target(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "rkf", "--set", "duration=3 s", "--out", "x.h5", "--quiet"]) == 0
    assert main(["run", "beacons", "--set", "duration=1 s", "--out", "y.h5", "--quiet"]) == 0
    capsys.readouterr()
    assert main(["trace", "x.h5"]) == 0 and "replicate 0, step " in capsys.readouterr().out
    assert (
        said(["trace", "y.h5"], 2, capsys) == "wsnsim: error: y.h5 has no target, and no largest error: give --step K\n"
    )


@pytest.mark.parametrize(
    ("words", "suffix"),
    [
        (["run", "rkf", "--out", "x.csv"], ".h5"),
        (["run", "rkf", "-o", "x"], ".h5"),
        (["report", "x.h5", "--out", "x.pdf"], ".html"),
        (["lifetime", "lifetime", "--out", "x.csv"], ".json"),
        (["lifetime", "rkf", "--page", "x.pdf"], ".html"),
    ],
)
def test_a_file_whose_suffix_belongs_to_another_format_is_refused_before_anything_runs(
    words: list[str], suffix: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", "rkf", "--set", "duration=3 s", "--out", "x.h5", "--quiet"]) == 0
    message = said(words, 2, capsys)
    assert f"expected a file with the suffix {suffix}" in message and message.count("\n") == 1
    assert {path.name for path in Path().iterdir()} == {"x.h5"}
