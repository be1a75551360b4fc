"""The tests' compiled kernels are kept until a source of a kernel changes."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from tests.helpers.kernel_cache import kernel_cache, lasting_cache


def clone(root: Path, source: str) -> Path:
    (root / "wsnsim" / "kernels").mkdir(parents=True, exist_ok=True)
    (root / "wsnsim" / "kernels" / "sums.py").write_text(source)
    return root


def test_kernels_are_kept_until_a_source_changes(tmp_path: Path) -> None:
    first = kernel_cache(clone(tmp_path, "a = 1"), tmp_path / ".venv")
    (first / "compiled").touch()
    assert kernel_cache(clone(tmp_path, "a = 1"), tmp_path / ".venv") == first and (first / "compiled").exists()
    second = kernel_cache(clone(tmp_path, "a = 2"), tmp_path / ".venv")
    assert second != first and second.is_dir() and not first.exists()


def test_kernels_for_another_processor_have_a_folder_beside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folders = []
    for name in ("generic", "nocona"):
        monkeypatch.setenv("NUMBA_CPU_NAME", name)
        folders.append(kernel_cache(clone(tmp_path, "a = 1"), tmp_path / ".venv"))
    assert folders[0].is_dir() and folders[1].is_dir() and folders[0] != folders[1]


def test_another_clones_environment_keeps_nothing(tmp_path: Path) -> None:
    elsewhere = kernel_cache(clone(tmp_path / "clone", "a = 1"), tmp_path / "venv")
    assert not elsewhere.is_relative_to(tmp_path) and not any(elsewhere.iterdir())
    shutil.rmtree(elsewhere)
    lasting = lasting_cache(tmp_path / "clone", tmp_path / "venv")
    assert lasting.is_relative_to(tmp_path / "clone" / "build") and lasting.is_dir()
