import ast
from pathlib import Path

import pytest

import wsnsim
from wsnsim.base.version import __version__

ROOT = Path(__file__).parents[2]


def test_the_version_is_written_once_and_the_build_reads_it_there():
    assert wsnsim.__version__ == __version__
    assert 'path = "wsnsim/base/version.py"' in (ROOT / "pyproject.toml").read_text(encoding="utf-8")


STARTERS = ROOT / "wsnsim" / "cli" / "starters"
"""Plug-ins that `wsnsim new` copies for users, and that nothing of the package imports: they import as users do."""


@pytest.mark.thorough
def test_no_module_imports_the_packages_root():
    for path in sorted({*(ROOT / "wsnsim").rglob("*.py")} - {*STARTERS.glob("*.py")}):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [node.module] if isinstance(node, ast.ImportFrom) else []
            names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            assert "wsnsim" not in names, f"{path}:{node.lineno}"
