"""What gzip data holds, up to a limit: a small file may hold gigabytes.

decompressed(file) -> a binary file
"""

from __future__ import annotations

import gzip
import io
from typing import Any, BinaryIO, Final, final

MAGIC: Final = b"\x1f\x8b"
"""The first bytes of gzip data."""
MOST_BYTES: Final = 200_000_000
"""Greatest size of the content of a compressed file (our choice): about eight million readings."""


def decompressed(file: BinaryIO) -> io.BufferedReader:
    """The content of gzip data; reading beyond `MOST_BYTES` is an OSError."""
    return io.BufferedReader(_Limited(gzip.GzipFile(fileobj=file)))


@final
class _Limited(io.RawIOBase):
    """Decompressed content that ends with an error where there is too much of it."""

    def __init__(self, content: gzip.GzipFile) -> None:
        self._content, self._left = content, MOST_BYTES

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        """Read into the buffer, and return the number of bytes. Raises OSError beyond `MOST_BYTES`."""
        count = self._content.readinto(buffer)
        self._left -= count
        if self._left < 0:
            limit = f"more than {MOST_BYTES // 10**6} MB when decompressed"
            raise OSError(f"it is {limit}; decompress it first if it is so large")
        return count
