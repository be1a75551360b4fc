"""Build the wheel, install it into an empty environment of each Python given, and run a scenario there.

    python -m tests.distribution.wheel PYTHON ...    such as python3.11 python3.13; those that do not start are skipped

Packages come from the registry that pip is configured for. The scenario runs outside of the source tree.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

HOME = Path(__file__).parents[2]
OLDEST = (3, 11)
RUN = ("run", "pso_mhpf", "--set", "duration=0.4 s", "--quiet", "--out", "x.h5")


def version_of(python: str) -> tuple[int, int] | None:
    """(major, minor) of a Python, None if it does not start."""
    code = "import sys; print(*sys.version_info[:2])"
    try:
        answer = subprocess.run([python, "-c", code], capture_output=True, text=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError):
        return None
    major, minor = map(int, answer.split())
    return major, minor


def built(folder: Path) -> Path:
    """The wheel, built into the folder."""
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(command, cwd=HOME, check=True, stdout=subprocess.DEVNULL)
    (wheel,) = folder.glob("*.whl")
    return wheel


def check(python: str, wheel: Path) -> None:
    """Install the wheel for a Python and run a scenario. Raises CalledProcessError or AssertionError if that fails."""
    with tempfile.TemporaryDirectory() as place:
        environment, bin_folder = Path(place) / "venv", Path(place) / "venv" / "bin"
        subprocess.run([python, "-m", "venv", str(environment)], check=True)
        install = [str(bin_folder / "python"), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
        subprocess.run([*install, str(wheel)], check=True)
        command = str(bin_folder / "wsnsim")
        listed = subprocess.run([command, "list"], cwd=place, check=True, capture_output=True, text=True).stdout
        assert "pso_mhpf" in listed, "the wheel lists no scenario"
        subprocess.run([command, *RUN], cwd=place, check=True)
        assert (Path(place) / "x.h5").stat().st_size > 10_000, "the run left no result"


def main(pythons: list[str]) -> int:
    """Check the wheel with each Python; 0 if at least one could be checked and none failed."""
    checked = 0
    with tempfile.TemporaryDirectory() as folder:
        wheel = built(Path(folder))
        for python in pythons:
            version = version_of(python)
            if version is None or version < OLDEST:
                print(f"{python}: skipped, {'is too old' if version else 'does not start'}")
                continue
            check(python, wheel)
            print(f"{python} ({'.'.join(map(str, version))}): the wheel installs, lists and runs")
            checked += 1
    return 0 if checked else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
