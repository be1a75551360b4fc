"""The digest of what a data file holds, by which train and test data are told apart.

content_digest(path) -> 'sha256:…'
"""

from __future__ import annotations

import gzip
import hashlib
import zlib
from pathlib import Path
from typing import Final

from wsnsim.base.regular_files import read_regular

GZIP_MAGIC: Final = b"\x1f\x8b"


def content_digest(path: str | Path) -> str:
    """'sha256:' and the digest of a file's content, decompressed if it is gzip: a file packed again has the same one.

    Raises:
        OSError: the path is not a regular file, it cannot be read, or its gzip data is damaged.
    """
    content = read_regular(path)
    if content.startswith(GZIP_MAGIC):
        try:
            content = gzip.decompress(content)
        except (EOFError, zlib.error) as error:
            raise OSError(f"its gzip data is damaged or cut off ({error})") from error
    return f"sha256:{hashlib.sha256(content).hexdigest()}"
