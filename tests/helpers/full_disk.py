"""A stream to a disk without space."""

from __future__ import annotations

import errno
import io
import os


class FullDisk(io.StringIO):
    """A text stream on which nothing can be written."""

    def write(self, text: str) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
