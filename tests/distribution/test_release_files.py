"""The files that accompany a release agree with the package: version, date, licence, addresses, and their formats."""

from __future__ import annotations

import re
import shutil
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.distribution import wheel
from tests.distribution.pythons import HOME
from tests.helpers.git import git
from wsnsim.base.version import RELEASED, __version__

AUTHOR_KEYS = {"name", "family-names", "given-names", "orcid", "affiliation"}
"""Of the Citation File Format 1.2.0: those that authors may have here."""


@pytest.fixture(scope="module")
def project() -> dict[str, Any]:
    """The table `project` of pyproject.toml."""
    table: dict[str, Any] = tomllib.loads((HOME / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return table


@pytest.fixture(scope="module")
def citation() -> dict[str, Any]:
    """The content of CITATION.cff."""
    content: dict[str, Any] = yaml.load((HOME / "CITATION.cff").read_text(encoding="utf-8"), Loader=yaml.BaseLoader)
    return content


def test_the_changelog_begins_with_this_version_and_its_date(citation: dict[str, Any]) -> None:
    headings = re.findall(r"^## (.+)$", (HOME / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    released = [heading for heading in headings if heading != "Unreleased"]
    assert released[0] == f"{__version__} ({citation['date-released']})"


def test_the_version_is_a_semantic_version() -> None:
    assert re.fullmatch(r"(0|[1-9]\d*)\.(0|[1-9]\d*)\.(0|[1-9]\d*)((a|b|rc)\d+)?", __version__)


def test_the_citation_has_what_the_format_requires(citation: dict[str, Any], project: dict[str, Any]) -> None:
    assert {"cff-version", "message", "title", "authors"} <= set(citation)
    assert citation["cff-version"] == "1.2.0" and citation["type"] == "software"
    assert (citation["version"], citation["date-released"]) == (__version__, RELEASED)
    assert citation["license"] == project["license"]
    assert citation["authors"] and all(set(author) <= AUTHOR_KEYS for author in citation["authors"])
    assert [author["name"] for author in citation["authors"]] == [author["name"] for author in project["authors"]]


def test_the_citation_names_the_address_of_the_project(citation: dict[str, Any], project: dict[str, Any]) -> None:
    assert citation.get("repository-code") == project.get("urls", {}).get("Repository")


def test_a_release_without_addresses_is_refused_by_name(
    project: dict[str, Any], tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(wheel, "HOME", tmp_path)
    (tmp_path / "pyproject.toml").write_text('[project.urls]\nRepository = "https://wsnsim.test"\n')
    with pytest.raises(wheel.DistributionError, match=r"urls\] lacks Documentation, Issues, Changelog"):
        wheel.demand_addresses()
    lines = "".join(f'{name} = "https://wsnsim.test"\n' for name in wheel.ADDRESSES)
    (tmp_path / "pyproject.toml").write_text(f"[project.urls]\n{lines}")
    wheel.demand_addresses()


def test_classifiers_name_the_versions_that_are_tested(project: dict[str, Any]) -> None:
    from tests.distribution.versions import SUPPORTED

    prefix = "Programming Language :: Python :: 3."
    named = [line.removeprefix(prefix) for line in project["classifiers"] if line.startswith(prefix)]
    assert named == [str(minor) for _, minor in SUPPORTED]
    assert project["requires-python"] == f">=3.{SUPPORTED[0][1]}"


def conflict_markers(folder: Path) -> list[str]:
    """FILE:LINE:TEXT of each line in a tracked file that a merge left behind. Underlined headings are none."""
    found = git(folder, "grep", "-nIE", "^(<{7}|>{7}|[|]{7}) ", check=False)
    assert found.returncode == int(not found.stdout), found.stderr
    return found.stdout.splitlines()


@pytest.mark.skipif(shutil.which("git") is None or not (HOME / ".git").exists(), reason="this is no clone")
def test_no_tracked_file_has_the_markers_of_a_merge(tmp_path: Path) -> None:
    assert conflict_markers(HOME) == []
    page = "Heading\n=======\n" + "".join(f"{mark * 7} HEAD\nwords\n" for mark in "<|>")
    (tmp_path / "page.rst").write_text(page, encoding="utf-8")
    git(tmp_path, "init", "-q")
    git(tmp_path, "add", "page.rst")
    assert conflict_markers(tmp_path) == [
        f"page.rst:{line}:{mark * 7} HEAD" for line, mark in zip((3, 5, 7), "<|>", strict=True)
    ]
