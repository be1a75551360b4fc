"""Where caches go: a folder that somebody else can write to is not used, because compiled code in it would be run."""

import os
import stat
from pathlib import Path

import pytest

from wsnsim.base.files import prepare_matplotlib, private_folder, reason, wished_folder
from wsnsim.base.version import __version__

pytestmark = pytest.mark.skipif(not hasattr(os, "getuid"), reason="this system has no owners of files")


@pytest.fixture
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A temporary directory as systems have it: everybody can write to it, and delete only what is their own."""
    place = tmp_path / "tmp"
    place.mkdir()
    place.chmod(0o1777)
    monkeypatch.setattr("tempfile.tempdir", str(place))
    return place


def test_the_private_folder_is_of_one_user_and_one_version_and_closed_to_others(temporary: Path) -> None:
    folder = private_folder()
    assert folder == temporary / f"wsnsim-{os.getuid()}-{__version__}" == private_folder()
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    folder.chmod(0o755)  # others may read
    assert private_folder() == folder


@pytest.mark.parametrize("mode", [0o770, 0o702, 0o777])
def test_a_private_folder_that_others_can_write_to_is_refused(temporary: Path, mode: int) -> None:
    private_folder().chmod(mode)
    with pytest.raises(PermissionError, match="can be written by others"):
        private_folder()


def test_a_private_folder_of_somebody_else_is_refused(temporary: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder, owner = private_folder(), os.getuid()
    folder.rename(temporary / f"wsnsim-{owner + 1}-{__version__}")
    monkeypatch.setattr("os.getuid", lambda: owner + 1)
    with pytest.raises(PermissionError, match="belongs to another user"):
        private_folder()


def test_a_link_to_a_folder_is_no_private_folder(temporary: Path, tmp_path: Path) -> None:
    mine = tmp_path / "mine"
    mine.mkdir(mode=0o700)
    (temporary / f"wsnsim-{os.getuid()}-{__version__}").symlink_to(mine)
    with pytest.raises(OSError, match="is no folder") as caught:
        private_folder()
    assert reason(caught.value) == f"{temporary}/wsnsim-{os.getuid()}-{__version__}: is no folder"


def test_a_temporary_directory_in_which_others_can_rename_is_refused(temporary: Path) -> None:
    temporary.chmod(0o777)
    with pytest.raises(PermissionError, match="can be written by others"):
        private_folder()


def test_a_temporary_directory_that_cannot_be_written_is_an_os_error(tmp_path: Path, monkeypatch) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "file" / "tmp"))
    with pytest.raises(OSError, match="Not a directory"):
        private_folder()


def test_the_wished_folder_holds_one_of_each_version(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("WSNSIM_CACHE", raising=False)
    assert wished_folder() is None
    monkeypatch.setenv("WSNSIM_CACHE", str(tmp_path / "caches"))
    assert wished_folder() == tmp_path / "caches" / __version__
    (tmp_path / "file").touch()
    monkeypatch.setenv("WSNSIM_CACHE", str(tmp_path / "file"))
    with pytest.raises(OSError, match="Not a directory"):
        wished_folder()


def test_matplotlib_keeps_its_own_folder_where_it_has_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("MPLCONFIGDIR", "XDG_CONFIG_HOME", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path))
    prepare_matplotlib()
    assert "MPLCONFIGDIR" not in os.environ


def test_matplotlib_gets_our_folder_where_home_is_a_file(
    temporary: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("WSNSIM_CACHE", "XDG_CONFIG_HOME", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    (tmp_path / "file").touch()
    monkeypatch.setenv("HOME", str(tmp_path / "file"))
    monkeypatch.setenv("MPLCONFIGDIR", "")
    prepare_matplotlib()
    assert os.environ["MPLCONFIGDIR"] == str(private_folder() / "matplotlib")
    monkeypatch.setenv("MPLCONFIGDIR", "of the user")
    prepare_matplotlib()
    assert os.environ["MPLCONFIGDIR"] == "of the user"
