"""Checks of object headers, before HDF5 trusts what they state; and the values of a column.

    check_attributes(read, address, most)       the lengths of texts in attributes, and where they are
    check_heap(read, address)                   the objects of a heap, in which texts are stored
    check_layout(read, address)                 how the values of a dataset are stored

A text of variable length is stored as its length and the place of its bytes. HDF5 allocates the length that is stated,
up to 4 GB, before it looks at the place, and its interface does not give the stated length. It is therefore read from
the object header, whose two versions are described in the HDF5 File Format Specification 3.0, IV.A.1 and IV.A.2.m.

Since version 4 of the layout (IV.A.2.i), an index of chunks can state trillions of chunks in a few hundred kilobytes.
HDF5 visits each of them, for hours, even if the dataset itself states a few rows. wsnsim writes version 3. Chunks are
inflated here: HDF5 would fill up a chunk that is too short with whatever is in its memory.
"""

from __future__ import annotations

import contextlib
import struct
import zlib
from collections.abc import Callable, Iterator
from typing import Final, NamedTuple

import numpy as np
from h5py import h5d, h5s, h5z

from wsnsim.recording.rows import DamagedContent

Read = Callable[[int, int], bytes]
"""read(address, count) -> that many bytes of the file, or ValueError."""

LAYOUT, ATTRIBUTE, CONTINUATION, ATTRIBUTE_INFO = 0x08, 0x0C, 0x10, 0x15
"""Types of the messages in an object header."""
NEWEST_LAYOUT: Final = 3
"""The version of the layout in files of HDF5 1.8."""
VARIABLE_LENGTH: Final = 9
"""The class of data types to which texts of variable length belong."""
REFERENCE: Final = 16
"""Bytes of the length and the place of a text."""
MOST_BLOCKS: Final = 64
"""Blocks of an object header, with its continuations."""
OBJECT: Final = 16
"""Bytes of the head of a heap, and of the head of an object in it (III.E; the first two are its number)."""
MOST_OBJECTS: Final = 2**16
NOWHERE: Final = 0xFFFF_FFFF_FFFF_FFFF
"""The undefined address."""


def check_attributes(read: Read, address: int, most: int) -> None:
    """Check that no attribute of the object at this address states texts of more than `most` bytes together.

    The heaps in which the texts are get checked as well.

    Raises:
        DamagedContent: one does, or the header is damaged.
    """
    with _damage_reported():
        for kind, flags, data in _messages(read, address):
            if kind == ATTRIBUTE_INFO and _is_dense(data):
                raise DamagedContent("attributes are not stored where wsnsim stores them")
            if kind == ATTRIBUTE:
                if flags & 2:
                    raise DamagedContent("an attribute is shared")
                for heap in _check_attribute(data, most):
                    check_heap(read, heap)


def check_heap(read: Read, address: int) -> None:
    """Check that the objects of the global heap at this address follow one another up to its end.

    HDF5 goes from object to object by the sizes that they state: for ever if one states the size zero.

    Raises:
        DamagedContent: they do not, or there is no heap.
    """
    with _damage_reported():
        head = read(address, OBJECT)
        at, end = address + OBJECT, address + struct.unpack_from("<Q", head, 8)[0]
        if head[:4] != b"GCOL":
            raise DamagedContent("a text is not where it is said to be")
        for _ in range(MOST_OBJECTS):
            if at + OBJECT > end:
                return
            number, size = struct.unpack("<H6xQ", read(at, OBJECT))
            taken = OBJECT + -(-size // 8) * 8 if number else size
            if taken < OBJECT or at + taken > end:
                raise DamagedContent("the place of a text is damaged")
            at += taken
    raise DamagedContent("a text is among more objects than wsnsim writes")


def check_layout(read: Read, address: int) -> None:
    """Check that the values of the dataset at this address are stored in a way that wsnsim writes.

    Raises:
        DamagedContent: they are not, or the header is damaged.
    """
    with _damage_reported():
        if any(kind == LAYOUT and data[0] > NEWEST_LAYOUT for kind, _, data in _messages(read, address)):
            raise DamagedContent("values are stored in a newer way than wsnsim stores them")


@contextlib.contextmanager
def _damage_reported() -> Iterator[None]:
    """Raise DamagedContent if a header ends too early to be unpacked."""
    try:
        yield
    except (struct.error, IndexError) as error:
        raise DamagedContent("the header of an object is damaged") from error


def _messages(read: Read, address: int) -> Iterator[tuple[int, int, bytes]]:
    """(kind, flags, data) of each message in the header of an object, continuations included."""
    head = read(address, 16)
    # version 2 begins with a signature; its continuations have one of their own, and end with a checksum
    if head[:4] == b"OHDR":
        at = address + 6 + (16 if head[5] & 0x20 else 0) + (4 if head[5] & 0x10 else 0)
        width = 1 << (head[5] & 3)
        blocks = [(at + width, int.from_bytes(read(at, width), "little"))]
        before, after, form = 4, 4, struct.Struct("<BHBH" if head[5] & 4 else "<BHB")
    else:
        blocks = [(address + 16, struct.unpack_from("<I", head, 8)[0])]
        before, after, form = 0, 0, struct.Struct("<HHB3x")
    for number in range(MOST_BLOCKS):
        if number == len(blocks):
            return
        block, at = read(*blocks[number]), 0
        while at + form.size <= len(block):
            kind, size, flags = form.unpack_from(block, at)[:3]
            data = block[at + form.size : at + form.size + size]
            if len(data) != size:
                raise DamagedContent("the header of an object is damaged")
            if kind == CONTINUATION:
                place, length = struct.unpack_from("<QQ", data)
                blocks.append((place + before, length - before - after))
            else:
                yield kind, flags, data
            at += form.size + size
    raise DamagedContent("the header of an object has too many pieces")


def _is_dense(data: bytes) -> bool:
    """Whether an attribute info message says that attributes are stored outside of the header."""
    (heap,) = struct.unpack_from("<Q", data, 4 if data[1] & 1 else 2)
    return bool(heap != NOWHERE)


def _check_attribute(data: bytes, most: int) -> set[int]:
    """Check one attribute; returns the addresses of the heaps in which its texts are."""
    version, flags = data[0], data[1]
    sizes = struct.unpack_from("<HHH", data, 2)
    if version == 1:  # which pads name, type and shape to eight bytes each
        starts, sizes = 8, tuple(-(-size // 8) * 8 for size in sizes)
    else:
        starts = 8 if version == 2 else 9
        if flags & 3:
            raise DamagedContent("the type of an attribute is shared")
    name, datatype, dataspace = sizes
    kind = data[starts + name] & 0x0F
    values = data[starts + name + datatype + dataspace :]
    if kind != VARIABLE_LENGTH:
        return set()
    texts = [struct.unpack_from("<IQ", values, at) for at in range(0, len(values) - REFERENCE + 1, REFERENCE)]
    if (stated := sum(length for length, _ in texts)) > most:
        raise DamagedContent(f"an attribute states a text of {stated} bytes")
    return {heap for length, heap in texts if length}


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
        chunks: the first row of each chunk that the file has, in order.
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
        """The values of a range of rows.

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
        if self.filters and not mask:  # a bit of the mask would say that a filter was left out
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
