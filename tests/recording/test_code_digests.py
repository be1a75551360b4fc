"""Digests of code: every file that a run can execute counts, of this package and of plug-ins."""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest

import wsnsim
from wsnsim.recording.provenance import NOT_IN_A_RUN, code_digest, module_digests, package_digests

ROOT = Path(wsnsim.__file__).parent


def write(folder: Path, files: Mapping[str, str]) -> None:
    for name, text in files.items():
        place = folder / name
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text(text)


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder on Python's path."""
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    return tmp_path


def test_the_digests_of_the_package_are_those_of_what_a_run_can_execute() -> None:
    files = package_digests()
    assert {"wsnsim/experiment.py", "wsnsim/trackers/pso_mhpf.py", "wsnsim/base/rng.py"} <= files.keys()
    assert not [name for name in files if name.startswith(("wsnsim/cli/", "wsnsim/report/", "wsnsim/papers/"))]
    assert len(set(files.values())) > 0.9 * len(files) and len(code_digest()) == 16


def test_what_a_run_can_execute_imports_nothing_that_is_left_out() -> None:
    left_out = "|".join(name.removesuffix(".py") for name in NOT_IN_A_RUN)
    forbidden = re.compile(rf"^\s*(from|import) wsnsim(\.| import )({left_out})\b", re.MULTILINE)
    own = [name for name in package_digests() if name != "wsnsim/__init__.py"]  # it hands names on, at their first use
    assert [name for name in own if forbidden.search((ROOT.parent / name).read_text(encoding="utf-8"))] == []
    assert forbidden.search("    from wsnsim.campaign import sweep") and forbidden.search("import wsnsim.cli")


def test_a_module_beside_others_counts_with_what_it_imports_from_there(place: Path) -> None:
    write(place, {"mine_a.py": "import mine_b, numpy\n", "mine_b.py": "from mine_c.inner import x\n", "other.py": ""})
    write(place, {"mine_c/__init__.py": "", "mine_c/inner.py": "import mine_a\nx = 1\n"})
    before = module_digests("mine_a")
    assert sorted(before) == ["mine_a.py", "mine_b.py", "mine_c/__init__.py", "mine_c/inner.py"]
    write(place, {"mine_c/inner.py": "x = 2\n", "other.py": "x = 2\n"})
    after = module_digests("mine_a")
    assert {name for name in before if before[name] != after[name]} == {"mine_c/inner.py"}
    assert "mine_a" not in sys.modules


def test_a_module_of_a_package_counts_with_the_whole_package(place: Path) -> None:
    files = {"my_lab/__init__.py": "import broken_one", "my_lab/trackers/one.py": "(", "my_lab/two.py": ""}
    write(place, files)
    assert sorted(module_digests("my_lab.trackers.one")) == sorted(files)


def test_a_folder_without_init_file_counts_with_the_named_module_only(place: Path) -> None:
    write(place, {"my_space/one.py": "", "my_space/two.py": ""})
    assert sorted(module_digests("my_space.one")) == ["my_space/one.py"]


def test_a_module_of_a_folder_without_init_file_counts_with_what_it_imports_by_any_name(place: Path) -> None:
    files = {
        "my_space/one.py": "from .two import x\nfrom . import three\nimport six",
        "my_space/two.py": "from my_space.inner import four\nfrom .. import outside",
        "my_space/three.py": "from .inner.five import y",
        "my_space/inner/four.py": "from ..two import x\nfrom .... import beyond",
        "my_space/inner/five.py": "from ..regular import z",
        "my_space/regular/__init__.py": "",
        "my_space/regular/deep.py": "",
        "six.py": "",
    }
    write(place, {**files, "my_space/seven.py": "", "outside.py": "", "eight.py": ""})
    before = module_digests("my_space.one")
    assert sorted(before) == sorted([*files, "outside.py"])
    write(place, {"my_space/two.py": "x = 2"})
    assert [name for name, digest in module_digests("my_space.one").items() if before[name] != digest] == [
        "my_space/two.py"
    ]


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("import one as x, two.inner", "one two"),
        ("from one import (  # import three\n    x,\n    y as z,\n)\nfrom . import two", "one two"),
        ("if x: import one\nelse: y = {1: 2}; from .two.inner import z; import \\\n three", "one two three"),
        ("def f(x: int = 1):\n    def g(): from one import x", "one"),
        ("\ufefftry:\n\tfrom two import*\nexcept ValueError:\n\tfrom.one import(x)", "one two"),
        ("def f():\n    yield from one\nraise ValueError from two", ""),
        ('"""\nimport one\n"""\nx = "import two"', ""),
        ("import one\nx = '\\d' is 'x'\n" + "-" * 20000, "one"),  # a parser would warn, or end with MemoryError
    ],
)
def test_what_a_file_imports_is_what_its_statements_say(place: Path, text: str, found: str) -> None:
    files = {"mine_f.py": text, "one.py": "", "two.py": "", "three.py": ""}
    write(place, files)
    assert set(module_digests("mine_f")) == {"mine_f.py", *(f"{name}.py" for name in found.split())}


@pytest.mark.parametrize("module", ["no_such_module", "sys", "_thread", "no..name", "\0"])
def test_what_has_no_file_has_no_digests(module: str) -> None:
    assert module_digests(module) == {}


def test_an_installed_module_counts_alone(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = place / "site-packages"
    write(folder, {"mine_d.py": "import mine_e", "mine_e.py": ""})
    monkeypatch.setattr(sys, "path", [str(folder), *sys.path])
    assert sorted(module_digests("mine_d")) == ["mine_d.py"]
