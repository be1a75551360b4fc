"""Which versions of the packages `make lowest` and `make matrix` install, and what they say when that is impossible."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Any

import pytest

from tests.distribution import pythons, versions
from tests.distribution.pythons import interpreter
from tests.distribution.versions import InstallationError, installed, main, requirements

PROJECT = {
    "name": "x",
    "dependencies": ["numpy>=2.0", "pyyaml>=6.0"],
    "optional-dependencies": {
        "parquet": ["pyarrow>=16"],
        "peers": ["other>=3"],
        "dev": ["x[parquet]", "pytest>=8.2"],
    },
}


class Commands:
    """Commands that would have been run, and what pip would have answered."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, folder: Path, stderr: str = "", code: int = 0) -> None:
        self.run: list[list[str]] = []
        self.stderr, self.code = stderr, code
        (folder / "pyproject.toml").write_text('[project]\nname = "x"\ndependencies = ["numpy>=2.0"]\n')
        monkeypatch.setattr(versions, "HOME", folder)
        monkeypatch.setattr(versions, "ENVIRONMENTS", folder / "environments")
        monkeypatch.setattr(versions.subprocess, "run", self)

    def __call__(self, command: list[str], **_: Any) -> subprocess.CompletedProcess[str]:
        self.run.append(command)
        if "venv" in command:
            Path(command[-1]).mkdir(parents=True, exist_ok=True)
        pip = "pip" in command
        return subprocess.CompletedProcess(command, self.code if pip else 0, "", self.stderr if pip else "")


def test_the_lowest_versions_are_the_lower_bounds_of_the_project_and_all_its_extras() -> None:
    assert requirements(PROJECT, lowest=True) == ["numpy==2.0", "pyarrow==16", "pytest==8.2", "pyyaml==6.0"]
    newest = ["numpy>=2.0", "pyarrow>=16", "pytest>=8.2", "pyyaml>=6.0"]
    assert requirements(PROJECT, lowest=False) == newest
    assert requirements(PROJECT, lowest=False, peers=True) == sorted([*newest, "other>=3"])


def test_each_requirement_of_pyproject_has_a_lowest_version() -> None:
    lowest = requirements(versions._project(), lowest=True)
    names = {line.split("==")[0] for line in lowest}
    assert len(names) == len(lowest) and names >= set(versions.SHOWN)


@pytest.mark.parametrize("line", ["numpy", "numpy>2", "numpy>=2,<3", "numpy ~= 2.0"])
def test_a_requirement_without_a_lowest_version_is_named(line: str) -> None:
    with pytest.raises(ValueError, match=f"requirement '{line}' is not of the form"):
        requirements({"name": "x", "dependencies": [line]}, lowest=True)


def test_an_environment_is_made_once_until_pyproject_changes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    commands = Commands(monkeypatch, tmp_path)
    own = installed("python3.11", "lowest-3.11", ["numpy==2.0"])
    assert own == tmp_path / "environments" / "lowest-3.11" / "bin" / "python"
    assert len(commands.run) == 3
    installed("python3.11", "lowest-3.11", ["numpy==2.0"])
    assert len(commands.run) == 3
    (tmp_path / "pyproject.toml").write_text("[project]\n")
    installed("python3.11", "lowest-3.11", ["numpy==2.0"])
    assert len(commands.run) == 6


@pytest.mark.parametrize(
    ("stderr", "said"),
    [
        ("WARNING: Retrying after connection broken by 'NewConnectionError'\nERROR: No match\n", "cannot reach"),
        ("WARNING: odd\nERROR: No matching distribution found for numpy==2.0\nERROR: more\n", "found for numpy==2.0"),
        ("", "exit code 1"),
    ],
)
def test_packages_that_cannot_be_installed_are_one_sentence(
    stderr: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    commands = Commands(monkeypatch, tmp_path, stderr, code=1)
    with pytest.raises(InstallationError, match=said) as caught:
        installed("python3.11", "lowest-3.11", ["numpy==2.0"])
    assert "\n" not in str(caught.value)
    monkeypatch.setattr(versions, "interpreter", lambda version: f"python{version}")
    assert main(["lowest", "3.11", "3.12", "--", "-k", "x"]) == 1
    assert said in capsys.readouterr().err
    assert main(["newest", "3.14", "--"]) == 0, "a Python for which there are no packages yet is skipped"
    assert "Python 3.14: skipped" in capsys.readouterr().out
    assert not any("pytest" in command for command in commands.run)


def test_arguments_go_to_pytest_and_its_failure_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    commands = Commands(monkeypatch, tmp_path)
    monkeypatch.setattr(versions, "interpreter", lambda version: f"python{version}" if version != "3.11" else None)
    assert main(["lowest", "3.11", "3.12", "3.13", "--", "-k", "energy"]) == 0
    assert [command[1:] for command in commands.run if "pytest" in command] == [["-m", "pytest", "-k", "energy"]]
    monkeypatch.setattr(versions, "versions_in", lambda python: "numpy 2.0")
    monkeypatch.setattr(versions.subprocess, "run", lambda command, **_: subprocess.CompletedProcess(command, 5))
    assert main(["lowest", "3.12", "--"]) == 1
    assert "Python 3.12, lowest packages: pytest ended with exit code 5" in capsys.readouterr().err


def test_pythons_of_pyenv_are_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    python = tmp_path / "versions" / "3.12.7" / "bin" / "python"
    python.parent.mkdir(parents=True)
    python.touch()
    monkeypatch.setenv("PYENV_ROOT", str(tmp_path))
    monkeypatch.setattr(pythons, "version_of", lambda place: (3, 12) if place == str(python) else None)
    assert interpreter("3.12") == str(python)
    assert interpreter("3.13") is None
    assert main(["newest", "3.13", "--"]) == 1
