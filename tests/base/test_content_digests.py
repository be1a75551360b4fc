"""Digests of what data files hold: compression does not count, damage and too much content are errors."""

from __future__ import annotations

import gzip
import hashlib
from pathlib import Path

import pytest

from wsnsim.base import gzip_content
from wsnsim.base.content_digests import content_digest

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
    monkeypatch.setattr(gzip_content, "MOST_BYTES", 2_000_000)
    path = tmp_path / "much.csv.gz"
    path.write_bytes(gzip.compress(bytes(2_000_000)))
    assert content_digest(path).startswith("sha256:")
    path.write_bytes(gzip.compress(bytes(2_000_001)))
    with pytest.raises(OSError, match="it is more than 2 MB when decompressed"):
        content_digest(path)
