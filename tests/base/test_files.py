"""Files that are read: what is a regular file, and digests of contents."""

from __future__ import annotations

import gzip
import hashlib
import os
import socket
from pathlib import Path

import pytest

from wsnsim.base import files
from wsnsim.base.files import content_digest, is_too_long, read_regular, why_not_regular


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


TEXT = b"time,node,reading\n" + b"0,1,-70\n" * 1000


def test_a_compressed_file_has_the_digest_of_its_content(tmp_path: Path) -> None:
    plain, packed, parts = tmp_path / "a.csv", tmp_path / "a.csv.gz", tmp_path / "b.csv.gz"
    plain.write_bytes(TEXT)
    packed.write_bytes(gzip.compress(TEXT))
    parts.write_bytes(gzip.compress(TEXT[:100], 1) + gzip.compress(TEXT[100:], 9))
    expected = f"sha256:{hashlib.sha256(TEXT).hexdigest()}"
    assert content_digest(plain) == content_digest(packed) == content_digest(parts) == expected


def test_damaged_data_is_an_error(tmp_path: Path) -> None:
    path = tmp_path / "a.csv.gz"
    data = gzip.compress(TEXT)
    for damaged in (data[:-9], data[:12] + b"\xff\xff\xff" + data[15:], data[:-8] + b"\0" * 8):
        path.write_bytes(damaged)
        with pytest.raises(OSError, match=r"damaged|CRC"):
            content_digest(path)


def test_a_small_file_that_holds_too_much_has_no_digest(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(files, "MOST_BYTES", 2_000_000)
    path = tmp_path / "much.csv.gz"
    path.write_bytes(gzip.compress(bytes(2_000_000)))
    assert content_digest(path).startswith("sha256:")
    path.write_bytes(gzip.compress(bytes(2_000_001)))
    with pytest.raises(OSError, match="it is more than 2 MB when decompressed"):
        content_digest(path)
