"""No module imports itself through others, imports inside functions and under TYPE_CHECKING included."""

from __future__ import annotations

import ast
import sysconfig
from collections.abc import Iterator
from importlib.machinery import PathFinder
from pathlib import Path

import networkx as nx
import pytest

PACKAGE = Path(__file__).resolve().parent.parent / "wsnsim"
ROOT = "wsnsim"
"""The package itself only passes names on, and may name everything below it."""
KNOWN: set[frozenset[str]] = set()
"""Circles that are still there. Nothing is added to this list."""


def modules() -> dict[str, Path]:
    """Return every module of the package with its file."""
    found = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = (ROOT, *path.relative_to(PACKAGE).with_suffix("").parts)
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def imported(path: Path, known: dict[str, Path]) -> Iterator[str]:
    """Yield the modules that a file imports, wherever the statement stands."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in known)
        elif isinstance(node, ast.ImportFrom) and node.module in known:
            assert node.level == 0, f"{path}: a relative import"
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                yield inner if inner in known else node.module


def import_graph() -> nx.DiGraph:
    """Return the graph of imports between the modules, without the package itself."""
    known = modules()
    graph = nx.DiGraph()
    graph.add_nodes_from(known)
    graph.add_edges_from((name, target) for name, path in known.items() for target in imported(path, known))
    graph.remove_node(ROOT)
    return graph


@pytest.mark.thorough
def test_no_modules_import_each_other_in_a_circle() -> None:
    graph = import_graph()
    circles = {frozenset(circle) for circle in nx.strongly_connected_components(graph) if len(circle) > 1}
    assert circles == KNOWN, "\n".join(" ⇄ ".join(sorted(circle)) for circle in circles ^ KNOWN)
    assert not list(nx.selfloop_edges(graph))


@pytest.mark.thorough
def test_the_graph_sees_lazy_and_type_only_imports() -> None:
    graph = import_graph()
    assert graph.has_edge("wsnsim.scenario.load", "wsnsim.scenario.check"), "imported inside a function"
    assert graph.has_edge("wsnsim.scenario.load", "wsnsim.scenario.schema"), "imported for its types"
    assert graph.has_edge("wsnsim.scenario.check", "wsnsim.scenario.registry"), "imported at the top"
    assert len(graph) > 150


@pytest.mark.thorough
def test_a_class_name_is_defined_once_in_the_package():
    names = [
        node.name.lstrip("_")
        for path in modules().values()
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ClassDef)
    ]
    assert len(names) > 300
    assert [name for name in set(names) if names.count(name) > 1] == []


def test_no_folder_of_tests_has_the_name_of_a_library() -> None:
    """Pytest imports the tests of a folder as a package of its name: later imports of the library would get that."""
    folders = [path.name for path in sorted(Path(__file__).parent.iterdir()) if path.is_dir()]
    assert "network" in folders
    paths = [sysconfig.get_path("purelib"), sysconfig.get_path("stdlib")]
    assert PathFinder.find_spec("packaging", paths) is not None, "such as this one, which matplotlib needs"
    assert [name for name in folders if (spec := PathFinder.find_spec(name, paths)) and spec.loader] == []
