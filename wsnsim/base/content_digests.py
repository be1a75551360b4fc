"""The digest of what a data file holds, by which train and test data are told apart.

content_digest(path) -> 'sha256:…'
"""

from __future__ import annotations

import hashlib
import io
import zlib
from pathlib import Path

from wsnsim.base import gzip_content
from wsnsim.base.regular_files import read_regular


def content_digest(path: str | Path) -> str:
    """'sha256:' and the digest of a file's content, decompressed if it is gzip: a file packed again has the same one.

    Raises:
        OSError: the path is not a regular file, it cannot be read, its gzip data is damaged or holds too much.
    """
    data = read_regular(path)
    content = io.BytesIO(data)
    try:
        file = gzip_content.decompressed(content) if data.startswith(gzip_content.MAGIC) else content
        return f"sha256:{hashlib.file_digest(file, 'sha256').hexdigest()}"
    except (EOFError, zlib.error) as error:
        raise OSError(f"its gzip data is damaged or cut off ({error})") from error
