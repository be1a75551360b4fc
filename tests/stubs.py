"""Stubs of the packages that hand on the kinds of kinds.table, so that type checkers know their names.

python -m tests.stubs        writes them
"""

from __future__ import annotations

from pathlib import Path

import wsnsim
from wsnsim.base.facades import MODELS, TRACKERS, homes

FOLDER = Path(wsnsim.__file__).parent
STUBS = {package: FOLDER / package.partition(".")[2] / "__init__.pyi" for package in (MODELS, TRACKERS)}
HEAD = ["# ruff: noqa", "# fmt: off", "# written by `python -m tests.stubs` from wsnsim/scenario/kinds.table"]


def stub(package: str) -> str:
    """The stub of a package."""
    found = sorted((home, own, name) for name, (home, own) in homes(package).items())
    lines = [f"from {home} import {own} as {own}" for home, own, name in found if name == own]
    lines += ["", *[f"{name} = {own}" for _, own, name in found if name != own]]
    return "\n".join([*HEAD, *lines, ""])


if __name__ == "__main__":
    for package, path in STUBS.items():
        path.write_text(stub(package), encoding="utf-8")
