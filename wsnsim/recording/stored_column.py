"""A column of a table as it is stored, and its values.

Chunks are inflated here, not by HDF5, which fills what a short chunk lacks from its own memory.
"""

from __future__ import annotations

import zlib
from typing import NamedTuple

import numpy as np
from h5py import h5d, h5s, h5z

from wsnsim.recording.object_headers import DamagedContent


class StoredColumn(NamedTuple):
    """A column of a table, checked.

    Attributes:
        name: table and column, for messages.
        dataset: the dataset.
        dtype: type of its values.
        rows: number of its values.
        stored: bytes in the file.
        chunk: rows of a chunk; 0 if it is stored in one piece.
        filters: numbers of the filters of its chunks.
        chunks: the first row of each chunk that is there, in order.
    """

    name: str
    dataset: h5d.DatasetID
    dtype: np.dtype
    rows: int
    stored: int
    chunk: int = 0
    filters: tuple[int, ...] = ()
    chunks: tuple[int, ...] = ()

    def values(self, rows: slice = slice(None)) -> np.ndarray:
        """The values of some rows, consecutive ones.

        Raises:
            DamagedContent: a chunk does not hold what it should.
        """
        start, stop, _ = rows.indices(self.rows)
        found = np.empty(max(stop - start, 0), self.dtype)
        if not self.chunk:
            if len(found):
                space = self.dataset.get_space()
                space.select_hyperslab((start,), (len(found),))
                self.dataset.read(h5s.create_simple((len(found),)), space, found)
            return found
        for first in range(start - start % self.chunk, stop, self.chunk):
            piece = self._chunk(first)
            low, high = max(start, first), min(stop, first + self.chunk)
            found[low - start : high - start] = piece[low - first : high - first]
        return found

    def _chunk(self, first: int) -> np.ndarray:
        """The values of the chunk that begins with this row."""
        mask, raw = self.dataset.read_direct_chunk((first,))
        size = self.chunk * self.dtype.itemsize
        if self.filters and not mask:
            inflater = zlib.decompressobj()
            try:
                raw = inflater.decompress(raw, size + 1)
            except zlib.error as error:
                raise DamagedContent(f"{self.name}: inflate() failed: {error}") from error
            if not inflater.eof:
                raise DamagedContent(f"{self.name}: a chunk is incomplete")
        if len(raw) != size:
            raise DamagedContent(f"{self.name}: a chunk has {len(raw)} bytes, not {size}")
        if self.filters[:1] == (h5z.FILTER_SHUFFLE,):
            shuffled = np.frombuffer(raw, np.uint8).reshape(self.dtype.itemsize, self.chunk)
            return np.ascontiguousarray(shuffled.T).view(self.dtype).ravel()
        return np.frombuffer(raw, self.dtype)
