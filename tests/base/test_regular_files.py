"""Pipes, sockets and devices are no files: reading one might never end."""

from __future__ import annotations

import os
import socket
from pathlib import Path

import pytest

from wsnsim.base.regular_files import is_too_long, read_regular, why_not_regular


def test_a_pipe_a_socket_a_device_and_a_folder_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # the path of a socket is short
    os.mkfifo("pipe")
    with socket.socket(socket.AF_UNIX) as bound:
        bound.bind("socket")
        Path("link").symlink_to("pipe")
        kinds = {"pipe": "a pipe", "socket": "a socket", "/dev/zero": "a device", "link": "a pipe", ".": "a folder"}
        for path, kind in kinds.items():
            assert why_not_regular(path) == f"is {kind}, not a regular file"
            with pytest.raises(OSError, match="not a regular file"):
                read_regular(path)


def test_a_file_is_read_up_to_a_limit_and_a_missing_one_is_the_system_s_error(tmp_path: Path) -> None:
    (tmp_path / "x").write_bytes(b"1234")
    assert why_not_regular(tmp_path / "x") == why_not_regular(tmp_path / "none") == why_not_regular("a\0b") == ""
    assert (read_regular(tmp_path / "x"), read_regular(tmp_path / "x", 2)) == (b"1234", b"12")
    with pytest.raises(FileNotFoundError):
        read_regular(tmp_path / "none")


def test_a_name_is_too_long_if_its_temporary_name_would_be() -> None:
    assert not is_too_long("x" * 150) and is_too_long("x" * 151) and is_too_long("ж" * 76)
