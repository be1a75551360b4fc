"""Build the sdist and the wheel, check both, install the wheel with each Python, and run a scenario there.

    python -m tests.distribution.wheel 3.11 3.12 3.13      versions that are not installed are skipped
    python -m tests.distribution.wheel --release 3.11      also demands what a publication needs

The wheel is built from the sdist, as package registries and distributions do. Both pass `twine check --strict` and
`check-wheel-contents`. Each environment is empty before the wheel is installed; packages come from the registry that
pip is configured for. Everything runs outside of the source tree.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tarfile
import tempfile
import tomllib
import zipfile
from email.parser import Parser
from pathlib import Path

from tests.distribution.pythons import HOME, interpreter

RUN = ("run", "pso_mhpf", "--set", "duration=0.4 s", "--quiet", "--out", "x.h5")
DATA = (
    "py.typed",
    "trackers/__init__.pyi",
    "base/columns.table",
    "scenario/kinds.table",
    "scenario/scenarios.table",
    "scenario/units.table",
    "testing/scenarios/mac.yaml",
    "_scenarios/pso_mhpf.yaml",
    "_scenarios/recorded/ble/receivers.csv",
    "_scenarios/papers/jiang2013/study.yaml",
    "_scenarios/studies/frontier/study.py",
)
"""Files of the package that are no modules and that a wheel must hold."""
SHARED = (
    "wsnsim/__init__.py",
    "tests/distribution/wheel.py",
    "scenarios/pso_mhpf.yaml",
    "docs/glossary.md",
    "CITATION.cff",
)
"""Files that an sdist must hold: the sources, and what is needed to test and cite them."""
ADDRESSES = ("Repository", "Documentation", "Issues", "Changelog")
"""The entries of [project.urls] that a published package needs."""


class DistributionError(Exception):
    """The sdist or the wheel lacks something; the message is one sentence."""


def built(folder: Path) -> tuple[Path, Path]:
    """The sdist, and the wheel that is built from it."""
    backend = [sys.executable, "-m", "hatchling", "build", "-d", str(folder)]
    subprocess.run([*backend, "-t", "sdist"], cwd=HOME, check=True, stdout=subprocess.DEVNULL)
    (sdist,) = folder.glob("*.tar.gz")
    with tempfile.TemporaryDirectory() as place, tarfile.open(sdist) as archive:
        archive.extractall(place, filter="data")
        (source,) = Path(place).iterdir()
        subprocess.run([*backend, "-t", "wheel"], cwd=source, check=True, stdout=subprocess.DEVNULL)
    (wheel,) = folder.glob("*.whl")
    return sdist, wheel


def inspect(sdist: Path, wheel: Path) -> None:
    """Check both distributions without installing them.

    Raises:
        DistributionError: a file is missing, or metadata and package disagree.
        CalledProcessError: twine or check-wheel-contents objects; they print why.
    """
    subprocess.run([sys.executable, "-m", "twine", "check", "--strict", str(sdist), str(wheel)], check=True)
    subprocess.run([sys.executable, "-m", "check_wheel_contents", str(wheel)], check=True)
    with tarfile.open(sdist) as archive:
        held = {name.partition("/")[2] for name in archive.getnames()}
    if missing := sorted(set(SHARED) - held):
        raise DistributionError(f"{sdist.name} lacks {', '.join(missing)}")
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
        (place,) = (name for name in names if name.endswith(".dist-info/METADATA"))
        metadata = Parser().parsestr(archive.read(place).decode())
    if missing := sorted(f"wsnsim/{name}" for name in DATA if f"wsnsim/{name}" not in names):
        raise DistributionError(f"{wheel.name} lacks {', '.join(missing)}")
    if stray := sorted(name for name in names if not re.match(r"wsnsim(-[^/]+\.dist-info)?/", name)):
        raise DistributionError(f"{wheel.name} holds {stray[0]}, outside of the package")
    if not (metadata["License-Expression"] and metadata["Requires-Python"] and metadata["Description-Content-Type"]):
        raise DistributionError(f"{wheel.name}: the metadata lack licence, Python version or description")


def demand_addresses() -> None:
    """Raise DistributionError unless the project names its public addresses: only its publisher knows them."""
    project = tomllib.loads((HOME / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    if missing := [name for name in ADDRESSES if name not in project.get("urls", {})]:
        raise DistributionError(
            f"pyproject.toml: [project.urls] lacks {', '.join(missing)}: give the public addresses (CONTRIBUTING.md, "
            "section 'Publishing')"
        )


def check(python: str, wheel: Path) -> None:
    """Install the wheel for a Python and run a scenario.

    Raises:
        CalledProcessError: a command failed.
        DistributionError: it left no result.
    """
    with tempfile.TemporaryDirectory() as place:
        environment, bin_folder = Path(place) / "venv", Path(place) / "venv" / "bin"
        subprocess.run([python, "-m", "venv", str(environment)], check=True)
        install = [str(bin_folder / "python"), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
        subprocess.run([*install, str(wheel)], check=True)
        command = str(bin_folder / "wsnsim")
        listed = subprocess.run([command, "list", "scenarios"], cwd=place, check=True, capture_output=True, text=True)
        if "pso_mhpf" not in listed.stdout:
            raise DistributionError(f"{wheel.name}: wsnsim list scenarios does not list pso_mhpf")
        subprocess.run([command, *RUN], cwd=place, check=True)
        if not (Path(place) / "x.h5").stat().st_size > 10_000:
            raise DistributionError(f"{wheel.name}: the run left no result")
        reads = "import wsnsim; assert len(wsnsim.read('x.h5', 'estimates'))"
        subprocess.run([str(bin_folder / "python"), "-c", reads], cwd=place, check=True)


def main(arguments: list[str]) -> int:
    """Check the distributions with each Python; 0 if at least one could be tried and none failed."""
    versions = [version for version in arguments if version != "--release"]
    tried = 0
    with tempfile.TemporaryDirectory() as folder:
        try:
            if "--release" in arguments:
                demand_addresses()
            sdist, wheel = built(Path(folder))
            inspect(sdist, wheel)
            for version in versions:
                python = interpreter(version)
                if python is None:
                    print(f"Python {version}: skipped, not installed")
                    continue
                check(python, wheel)
                print(f"Python {version}: the wheel installs, lists, runs and reads", flush=True)
                tried += 1
        except (DistributionError, subprocess.CalledProcessError) as error:
            print(error, file=sys.stderr)
            return 1
    return 0 if tried else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
