"""Run the suite with several Pythons and with the newest or the lowest declared versions of the packages.

    python -m tests.distribution.versions newest 3.11 3.12 3.13 -- -k energy      arguments behind -- go to pytest
    python -m tests.distribution.versions lowest 3.11
    python -m tests.distribution.versions peers 3.11 -- tests/trackers/test_peers.py

`newest` takes every Python of the list that is installed, `lowest` and `peers` the first. `peers` also installs the
extra of this name, other libraries of filters with which ours are compared; there a test that is skipped fails. Each
environment is a folder of its own below `.venv-matrix`, kept until pyproject.toml changes. Packages come from the
registry that pip is configured for.
"""

from __future__ import annotations

import hashlib
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from tests.distribution.pythons import HOME, interpreter

ENVIRONMENTS = HOME / ".venv-matrix"
PEERS = "peers"
REQUIRED = "WSNSIM_PEERS"
"""With the value 'required', a test that misses a package of the extra `peers` fails instead of being skipped."""
SUPPORTED = ((3, 11), (3, 12), (3, 13))
SHOWN = ("numpy", "scipy", "pandas", "h5py", "numba", "pydantic", "matplotlib", "distributed", "pyarrow")
_REQUIREMENT = re.compile(r"(?P<name>[\w.-]+)>=(?P<low>[\w.]+)")
_UNREACHABLE = re.compile(r"connection broken|Max retries|timed out|Temporary failure in name resolution")


class InstallationError(Exception):
    """The packages could not be installed; the message is one sentence."""


def requirements(project: dict[str, Any], lowest: bool, peers: bool = False) -> list[str]:
    """What the project and its extra `dev` require, one line a package; `lowest` pins each to its lower bound.

    Args:
        project: the table `project` of pyproject.toml.
        lowest: whether `name>=1.2` becomes `name==1.2`.
        peers: whether the extra `peers` counts as well.

    Raises:
        ValueError: a requirement is not of the form `name>=version`, so that it has no lowest version.
    """
    lines = [*project["dependencies"], *_of_extras(project, ["dev", PEERS] if peers else ["dev"])]
    for line in lines:
        if not _REQUIREMENT.fullmatch(line):
            raise ValueError(f"pyproject.toml: requirement {line!r} is not of the form name>=version")
    return sorted({line.replace(">=", "==") if lowest else line for line in lines})


def _of_extras(project: dict[str, Any], names: Iterable[str]) -> Iterator[str]:
    """Yield what extras require, with the extras that they name, such as `wsnsim[cluster,parquet]`."""
    for name in names:
        for line in project.get("optional-dependencies", {}).get(name, ()):
            if inner := re.fullmatch(rf"{re.escape(project['name'])}\[(.+)\]", line):
                yield from _of_extras(project, inner[1].split(","))
            else:
                yield line


def installed(python: str, name: str, lines: Iterable[str]) -> Path:
    """The Python of the environment of this name; created again unless it has these requirements.

    Raises:
        InstallationError: pip could not install them.
    """
    folder = ENVIRONMENTS / name
    text = "".join(f"{line}\n" for line in lines)
    project = (HOME / "pyproject.toml").read_text(encoding="utf-8")
    mark, digest = folder / ".ready", hashlib.sha256(f"{HOME}\n{text}{project}".encode()).hexdigest()
    own = folder / "bin" / "python"
    if not mark.exists() or mark.read_text(encoding="utf-8") != digest:
        print(f"installing the packages of {folder.relative_to(HOME)}", flush=True)
        subprocess.run([python, "-m", "venv", "--clear", str(folder)], check=True)
        wanted = folder / "requirements.txt"
        wanted.write_text(text, encoding="utf-8")
        _install(own, "--only-binary", ":all:", "--no-compile", "-r", str(wanted))  # most modules are never imported
        _install(own, "--no-deps", "--no-build-isolation", "-e", str(HOME))
        mark.write_text(digest, encoding="utf-8")  # last, so that an interrupted installation is repeated
    return own


def _install(python: Path, *what: str) -> None:
    """Install with pip."""
    command = [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *what]
    done = subprocess.run(command, cwd=HOME, capture_output=True, text=True, check=False)
    if done.returncode == 0:
        return
    if _UNREACHABLE.search(done.stderr):
        raise InstallationError("pip cannot reach its package registry; the suite needs packages from there")
    errors = re.findall(r"^ERROR: (.*)", done.stderr, re.MULTILINE) or [f"exit code {done.returncode}"]
    raise InstallationError(f"pip: {errors[0]}")


def versions_in(python: Path) -> str:
    """The versions of the main packages of an environment, as `numpy 2.0.0, scipy 1.15.0, …`."""
    code = "import sys, importlib.metadata as m; print(', '.join(f'{n} {m.version(n)}' for n in sys.argv[1:]))"
    command = [str(python), "-c", code, *SHOWN]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


def tested(which: str, version: str, arguments: list[str]) -> Iterator[str]:
    """Run the suite with one Python; gives at most one line that says what failed."""
    python = interpreter(version)
    if python is None:
        print(f"Python {version}: skipped, not installed")
        return
    lines = requirements(_project(), which == "lowest", which == PEERS)
    try:
        own = installed(python, f"{which}-{version}", lines)
    except InstallationError as error:
        if tuple(map(int, version.split("."))) > SUPPORTED[-1]:
            print(f"Python {version}: skipped, {error}")
        else:
            yield f"Python {version}, {which} packages: {error}"
        return
    print(f"Python {version} with {versions_in(own)}", flush=True)
    environment = {**os.environ, REQUIRED: "required"} if which == PEERS else None
    command = [str(own), "-m", "pytest", *arguments]
    if code := subprocess.run(command, cwd=HOME, check=False, env=environment).returncode:
        yield f"Python {version}, {which} packages: pytest ended with exit code {code}"


def _project() -> dict[str, Any]:
    """The table `project` of pyproject.toml."""
    table: dict[str, Any] = tomllib.loads((HOME / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return table


def main(arguments: list[str]) -> int:
    """Run the suite with each Python wanted; 0 if at least one is installed and none failed."""
    which, *versions = arguments[: arguments.index("--")]
    found = [version for version in versions if interpreter(version)]
    if not found:
        print(f"none of Python {', '.join(versions)} is installed", file=sys.stderr)
        return 1
    chosen = versions if which == "newest" else found[:1]
    rest = arguments[arguments.index("--") + 1 :]
    failures = [line for version in chosen for line in tested(which, version, rest)]
    print(*failures, sep="\n", end="\n" if failures else "", file=sys.stderr)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
