"""Where compiled kernels are kept if home, installation and NUMBA_CACHE_DIR cannot be written.

Everything lies below a regular file, because permissions mean nothing to root.
"""

from __future__ import annotations

import errno
import json
import os
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from wsnsim.base.version import __version__
from wsnsim.kernels import compilation

pytestmark = pytest.mark.skipif(not hasattr(os, "getuid"), reason="this system has no owners of files")

PROBE = """
import json
import multiprocessing
import os
import sys
import warnings

if user := int(os.environ.get("PROBE_USER", "0")):  # the interpreter may be root's: what it needs is imported before
    import numba

    assert numba.njit(lambda x: x + 1)(1) == 2
    os.setgroups([])
    os.setgid(user)
    os.setuid(user)

if os.environ.get("PROBE_NAMELESS"):  # a user whom the system does not know
    import pwd

    def unknown(user):
        raise KeyError(user)

    pwd.getpwuid = unknown

with warnings.catch_warnings(record=True) as said:
    warnings.simplefilter("always")
    from wsnsim.kernels.compilation import inner, kernel

    @inner
    def twice(x):
        return 2 * x

    @kernel
    def twice_and_one(x):
        return twice(x) + 1

answer = twice_and_one(int(sys.argv[1]))
print(json.dumps([answer, sum(twice_and_one.stats.cache_hits.values()), [str(each.message) for each in said]]))
"""
WHERE = ("HOME", "XDG_CACHE_HOME", "NUMBA_CACHE_DIR", "WSNSIM_CACHE")


@pytest.fixture
def place() -> Iterator[Path]:
    """A folder that everybody may enter, with a probe beside which nothing can be kept, and a regular file."""
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        folder.chmod(0o755)
        (folder / "probe.py").write_text(PROBE)
        (folder / "__pycache__").touch()
        (folder / "file").touch()
        (folder / "tmp").mkdir(mode=0o700)
        yield folder


def probed(place: Path, changes: Mapping[str, str], without: str = "") -> tuple[int, int, list[str]]:
    """The answer of a new process, how many kernels it found compiled, and its warnings."""
    env = {name: value for name, value in os.environ.items() if name not in WHERE}
    env |= {"HOME": str(place / "file" / "home"), "NUMBA_CACHE_DIR": str(place / "file" / "numba")}
    env |= {"TMPDIR": str(place / "tmp"), "PYTHONPATH": str(Path(__file__).parents[2]), "NUMBA_DISABLE_JIT": "0"}
    command = [sys.executable, "-B", str(place / "probe.py"), "4"]
    env |= changes
    env.pop(without, None)
    done = subprocess.run(command, env=env, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    answer, hits, said = json.loads(done.stdout)
    return answer, hits, said


@pytest.mark.thorough
def test_kernels_are_kept_in_the_temporary_directory_where_nothing_else_can_be_written(place: Path) -> None:
    folder = place / "tmp" / f"wsnsim-{os.getuid()}-{__version__}"
    for hits in (0, 1):
        answer, found, said = probed(place, {})
        assert (answer, found, len(said)) == (9, hits, 1)
        assert said[0].startswith(f"compiled kernels are kept in {folder}, because")
        assert "WSNSIM_CACHE" in said[0]


@pytest.mark.thorough
def test_a_user_without_a_home_gets_no_folder_named_tilde(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (place / "here").mkdir()
    monkeypatch.chdir(place / "here")
    answer, hits, said = probed(place, {"NUMBA_CACHE_DIR": "", "PROBE_NAMELESS": "1"}, without="HOME")
    assert (answer, hits) == (9, 0) and said[0].startswith(f"compiled kernels are kept in {place / 'tmp'}")
    assert list(Path().iterdir()) == []


@pytest.mark.thorough
def test_kernels_are_compiled_without_a_cache_where_others_could_write_to_it(place: Path) -> None:
    (place / "tmp" / f"wsnsim-{os.getuid()}-{__version__}").mkdir()
    (place / "tmp" / f"wsnsim-{os.getuid()}-{__version__}").chmod(0o777)
    answer, hits, said = probed(place, {"WSNSIM_CACHE": str(place / "file")})
    assert (answer, hits) == (9, 0)
    wished, kept = said
    assert wished.startswith(f"WSNSIM_CACHE: {place / 'file' / __version__}: Not a directory")
    assert kept.startswith("compiled kernels cannot be kept") and "can be written by others" in kept


@pytest.mark.thorough
def test_the_folder_that_wsnsim_cache_names_comes_before_that_of_numba(place: Path) -> None:
    assert probed(place, {"WSNSIM_CACHE": str(place / "wish"), "NUMBA_CACHE_DIR": str(place / "numba")}) == (9, 0, [])
    assert list((place / "wish" / __version__).rglob("*twice_and_one*.nbc"))
    assert not (place / "numba").exists()


@pytest.mark.thorough
def test_another_user_for_whom_nothing_can_be_written_runs_kernels(place: Path) -> None:
    """Here it is permissions that forbid writing: those of a folder that belongs to root."""
    pwd = pytest.importorskip("pwd")
    try:
        nobody = pwd.getpwnam("nobody")
    except KeyError:
        pytest.skip("this system has no user nobody")
    if os.geteuid() != 0:
        pytest.skip("only root can start a process of another user")
    (place / "__pycache__").unlink()
    (place / "tmp").chmod(0o1777)
    changes = {"HOME": "/", "NUMBA_CACHE_DIR": "", "PROBE_USER": str(nobody.pw_uid)}
    answer, hits, said = probed(place, changes)
    folder = place / "tmp" / f"wsnsim-{nobody.pw_uid}-{__version__}"
    assert (answer, hits) == (9, 0) and said[0].startswith(f"compiled kernels are kept in {folder}, because")
    assert (folder.stat().st_uid, folder.stat().st_mode & 0o777) == (nobody.pw_uid, 0o700)


def negative_kernel() -> Any:
    """A kernel of this process that was not compiled yet."""

    @compilation.kernel
    def negative(x: int) -> int:
        return -x

    return negative


def test_a_full_disk_and_a_damaged_cache_end_no_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if compilation.config.DISABLE_JIT:
        pytest.skip("nothing is compiled")
    monkeypatch.setattr(compilation.config, "CACHE_DIR", str(tmp_path))

    with monkeypatch.context() as patched:

        def full(*arguments: Any) -> None:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

        patched.setattr("numba.core.caching.IndexDataCacheFile._save_data", full)
        assert negative_kernel()(3) == -3
    for damage in (b"", b"\x80\x04", b"no pickle"):
        for file in tmp_path.rglob("*.nb*"):
            file.write_bytes(damage)
        assert negative_kernel()(3) == -3
    again = negative_kernel()
    assert again(3) == -3 and sum(again.stats.cache_hits.values()) == 1


@pytest.mark.skipif(compilation.config.DISABLE_JIT, reason="nothing is compiled")
def test_a_kernel_that_another_process_compiles_is_waited_for_and_loaded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fcntl = pytest.importorskip("fcntl")
    monkeypatch.setattr(compilation.config, "CACHE_DIR", str(tmp_path / "other"))
    assert negative_kernel()(3) == -3
    monkeypatch.setattr(compilation.config, "CACHE_DIR", str(tmp_path / "here"))
    waiting, waited = negative_kernel(), compilation.COMPILATION_TIME.wall
    [lock] = (tmp_path / "other").rglob("*.lock")
    lock = tmp_path / "here" / lock.relative_to(tmp_path / "other")
    asked = threading.Event()

    def sleep(seconds: float) -> None:
        asked.set()
        time.sleep(seconds)

    monkeypatch.setattr(compilation, "time", SimpleNamespace(**{**vars(time), "sleep": sleep}))
    with lock.open("wb") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        thread = threading.Thread(target=waiting, args=(3,))
        thread.start()
        assert asked.wait(60.0) and not waiting.signatures
        time.sleep(0.05)
        shutil.copytree(tmp_path / "other", tmp_path / "here", dirs_exist_ok=True)
    thread.join()
    assert waiting(3) == -3 and sum(waiting.stats.cache_hits.values()) == 1
    assert compilation.COMPILATION_TIME.wall >= waited + 0.05


@pytest.mark.skipif(compilation.config.DISABLE_JIT, reason="nothing is compiled")
def test_a_kernel_is_compiled_where_waiting_takes_too_long_or_nothing_can_be_locked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fcntl = pytest.importorskip("fcntl")
    monkeypatch.setattr(compilation.config, "CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(compilation, "PATIENCE", 0.05)
    assert negative_kernel()(3) == -3
    [lock] = tmp_path.rglob("*.lock")
    for file in tmp_path.rglob("*.nb*"):
        file.unlink()
    with lock.open("wb") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        assert negative_kernel()(3) == -3
        monkeypatch.setattr(compilation, "PATIENCE", 60.0)
        loaded = negative_kernel()
        assert loaded(3) == -3 and sum(loaded.stats.cache_hits.values()) == 1, "what is there is loaded without a lock"
    for file in tmp_path.rglob("*.nb*"):
        file.unlink()
    lock.unlink()
    lock.mkdir()
    assert negative_kernel()(3) == -3 and not compilation._HELD and not compilation._CALLS
