"""What is read from a result file, checked before anything is allocated: a file may come from anybody.

    content = Content(file_id)
    group = content.group(b"runs")                     # a table, all of whose links stay in the file
    column = content.column(group, "rmse")             # its rows, type and chunks, which the file really holds
    column.values(slice(0, 10))
    content.attribute(group, "columns")                # texts and numbers of a limited size
    content.text("provenance_json")

A result holds what `writer` writes and nothing else. Refused are links that lead elsewhere, external storage, virtual
datasets, other filters than deflate and shuffle, other indices of chunks, missing chunks, and sizes that the stored
bytes cannot fill: deflate makes 1,032 bytes of one at most. Chunks are inflated here: HDF5 fills what a short one lacks
from its own memory.
"""

from __future__ import annotations

import os
import struct
from collections import defaultdict
from collections.abc import Sequence
from typing import Any, Final, final

import numpy as np
from h5py import h5a, h5d, h5f, h5g, h5i, h5l, h5o, h5s, h5t, h5z

from wsnsim.recording.object_headers import StoredColumn, check_attributes, check_heap, check_layout
from wsnsim.recording.rows import CHUNK, DamagedContent

DEFLATE_LIMIT: Final = 1_032
"""Bytes that deflate makes of one at most (zlib, Technical Details: maximum compression factor)."""
INDEX_ENTRY: Final = 32
"""Bytes that each chunk of a column takes in its index (HDF5 File Format Specification 3.0, III.A.1)."""
MOST_LINKS: Final = 1_024
"""Objects of a group, and texts of an attribute."""
LONGEST_WORDS: Final = 1_000_000
"""Bytes of the texts of an attribute."""
LONGEST_TEXT: Final = 100_000_000
"""Bytes of a text such as `scenario/resolved_json`."""
FILTERS: Final = ((), (h5z.FILTER_DEFLATE,), (h5z.FILTER_SHUFFLE, h5z.FILTER_DEFLATE))
TYPES: Final = ("u1", "u2", "u4", "u8", "f8", "f4", "i2", "i4", "i8", "i1")


_TYPES: Final[dict[int, list[tuple[h5t.TypeID, np.dtype]]]] = defaultdict(list)
"""The types of columns by their size. Translating a type takes longer than comparing it with these."""
for _dtype in map(np.dtype, TYPES):
    _TYPES[_dtype.itemsize].append((h5t.py_create(_dtype), _dtype))


@final
class Content:
    """The content of an open file.

    Args:
        file: the file; its root must be a plain one.

    Raises:
        DamagedContent: a link of the root leads elsewhere, or the file begins with something else.
    """

    def __init__(self, file: h5f.FileID) -> None:
        plan = file.get_create_plist()
        if plan.get_userblock() or plan.get_sizes() != (8, 8):
            raise DamagedContent("the file does not begin as wsnsim writes it")
        self._descriptor: int = file.get_vfd_handle()
        self._size = os.fstat(self._descriptor).st_size
        self._checked: set[int] = set()
        self.root = h5g.open(file, b"/")
        self.names = names_in(self.root)

    def holds(self, name: str) -> bool:
        """Whether there is an object 'name' or 'group/name'."""
        folder, _, last = name.rpartition("/")
        if not folder:
            return last in self.names
        return folder in self.names and last in names_in(h5g.open(self.root, folder.encode()))

    def group(self, name: str) -> h5g.GroupID:
        """A group of the root; KeyError if there is none. Each of its links is checked."""
        group = h5g.open(self.root, name.encode())
        names_in(group)
        return group

    def columns(self, group: h5g.GroupID, names: Sequence[str], complete: bool = True) -> list[StoredColumn]:
        """Columns of a table, equally long.

        Args:
            group: the table.
            names: the columns.
            complete: whether every chunk must be there; those of an unfinished file need not.
        """
        found = [self.column(group, name, complete) for name in names]
        if sum(column.stored for column in found) > self._size:
            raise DamagedContent("columns state more bytes than the file has")
        if complete and len({column.rows for column in found}) > 1:
            raise DamagedContent(f"the columns of {name_of(group)} differ in their number of rows")
        return found

    def column(self, group: h5g.GroupID, name: str, complete: bool = True) -> StoredColumn:
        """A column of a table; KeyError if there is none."""
        dataset = self._dataset(group, name)
        shown = f"{name_of(group)}.{name}"
        plan = dataset.get_create_plist()
        layout = plan.get_layout()
        if layout == h5d.VIRTUAL or plan.get_external_count():
            raise DamagedContent(f"{shown}: the values are stored in another file")
        dtype, rows = _type_of(dataset, shown), _rows_of(dataset, shown)
        if layout == h5d.CHUNKED:
            return self._chunked(StoredColumn(shown, dataset, dtype, rows, 0), plan, complete)
        stored, offset = dataset.get_storage_size(), dataset.get_offset()
        if stored != rows * dtype.itemsize or (offset or 0) + stored > self._size:
            raise DamagedContent(f"{shown}: states {rows} values, but holds {stored} bytes")
        if rows and layout == h5d.CONTIGUOUS and offset is None:
            raise DamagedContent(f"{shown}: its values are missing")
        return StoredColumn(shown, dataset, dtype, rows, stored)

    def stored_bytes(self, group: h5g.GroupID, name: str) -> int:
        """The bytes of a column in the file, as HDF5 states them."""
        dataset = self._dataset(group, name)
        if dataset.get_create_plist().get_layout() == h5d.CHUNKED:
            return sum(info.size for info in self._stored_chunks(dataset, f"{name_of(group)}.{name}"))
        return int(dataset.get_storage_size())

    @staticmethod
    def _dataset(group: h5g.GroupID, name: str) -> h5d.DatasetID:
        """A dataset of a group, none of another group: 'a/b' would be one."""
        if "/" in name or name in ("", "."):
            raise DamagedContent(f"'{name}' cannot name a column")
        return h5d.open(group, name.encode())

    def _stored_chunks(self, dataset: h5d.DatasetID, shown: str) -> list[Any]:
        """What the index says of each chunk. A tree whose branches share twigs could name trillions of them."""
        check_layout(self._read, h5o.get_info(dataset).addr)
        found: list[Any] = []
        most = self._size // INDEX_ENTRY

        def note(info: Any) -> bool | None:  # a value ends the iteration
            found.append(info)
            return True if len(found) > most else None

        dataset.chunk_iter(note)
        if len(found) > most:
            raise DamagedContent(f"{shown}: its index names more chunks than the file can hold")
        return found

    def _chunked(self, column: StoredColumn, plan: Any, complete: bool) -> StoredColumn:
        """The column, its chunks checked."""
        shown, rows, itemsize = column.name, column.rows, column.dtype.itemsize
        filters = tuple(plan.get_filter(number)[0] for number in range(plan.get_nfilters()))
        if filters not in FILTERS:
            raise DamagedContent(f"{shown}: is stored with other filters than deflate and shuffle")
        (chunk,) = plan.get_chunk()
        found = self._stored_chunks(column.dataset, shown)
        firsts = tuple(sorted(info.chunk_offset[0] for info in found))
        expected = range(0, rows, chunk)
        if chunk > CHUNK or len(set(firsts)) != len(firsts):
            raise DamagedContent(f"{shown}: has other chunks than wsnsim writes")
        if complete and (len(firsts) != len(expected) or firsts != tuple(expected)):
            raise DamagedContent(f"{shown}: states {rows} values, but {len(firsts)} chunks of {chunk} are stored")
        stored, size = sum(info.size for info in found), chunk * itemsize
        left_out = 1 << (len(filters) - 1) if filters else 0
        for info in found:
            if info.filter_mask not in (0, left_out):
                raise DamagedContent(f"{shown}: a chunk was stored with other filters")
            most = DEFLATE_LIMIT * info.size if filters and not info.filter_mask else info.size
            if size > most or info.size > self._size or info.byte_offset + info.size > self._size:
                raise DamagedContent(f"{shown}: a chunk of {size} bytes cannot be stored in {info.size}")
        return column._replace(stored=stored, chunk=chunk, filters=filters, chunks=firsts)

    def attribute(self, holder: Any, name: str) -> Any:
        """The value of an attribute: a text, a number, or a list of them; None if there is none."""
        if not h5a.exists(holder, name.encode()):
            return None
        found = h5a.open(holder, name.encode())
        kind, shape = found.get_type(), found.shape
        known = kind.get_class() in (h5t.STRING, h5t.INTEGER, h5t.FLOAT)
        if not known or shape is None or len(shape) > 1 or (shape and shape[0] > MOST_LINKS):
            raise DamagedContent(f"the attribute '{name}' is of another kind than wsnsim writes")
        if kind.get_class() == h5t.STRING:
            if kind.is_variable_str():
                self._check_attributes(h5o.get_info(holder).addr)
            elif kind.get_size() * (shape[0] if shape else 1) > LONGEST_WORDS:
                raise DamagedContent(f"the attribute '{name}' is too long")
        values = np.empty(shape, found.dtype)
        found.read(values)
        if kind.get_class() == h5t.STRING:
            texts = [value.decode("utf-8") if isinstance(value, bytes) else str(value) for value in values.flat]
            return texts if shape else texts[0]
        return values.tolist()

    def _check_attributes(self, address: int) -> None:
        """Check the texts in the attributes of an object, once."""
        if address not in self._checked:
            check_attributes(self._read, address, LONGEST_WORDS)
            self._checked.add(address)

    def text(self, name: str) -> str:
        """One of the texts; KeyError if there is none."""
        folder, _, last = name.rpartition("/")
        holder = self.group(folder) if folder else self.root
        dataset = h5d.open(holder, last.encode())
        kind, plan = dataset.get_type(), dataset.get_create_plist()
        plain = plan.get_layout() == h5d.CONTIGUOUS and not plan.get_external_count() and dataset.shape == ()
        if not plain or kind.get_class() != h5t.STRING or not kind.is_variable_str() or dataset.get_offset() is None:
            raise DamagedContent(f"the text '{name}' is stored otherwise than wsnsim stores it")
        length, heap = struct.unpack("<IQ", self._read(dataset.get_offset(), 12))
        if length > min(LONGEST_TEXT, self._size):
            raise DamagedContent(f"the text '{name}' states {length} bytes")
        if length:
            check_heap(self._read, heap)
        values = np.empty((), dataset.dtype)
        dataset.read(h5s.create(h5s.SCALAR), dataset.get_space(), values)
        return bytes(values[()]).decode("utf-8")

    def _read(self, address: int, count: int) -> bytes:
        """Bytes of the file."""
        if address < 0 or count < 0 or address + count > self._size:
            raise DamagedContent("an address is outside of the file")
        return os.pread(self._descriptor, count, address)


def names_in(group: h5g.GroupID) -> list[str]:
    """The names in a group, all of which are of objects in the file.

    An error must not leave the function that HDF5 calls; it notes what it finds, and a true value ends the iteration.
    """
    names: list[str] = []
    elsewhere: list[str] = []

    def note(name: bytes, link: Any) -> bool:
        (names if link.type == h5l.TYPE_HARD else elsewhere).append(name.decode("utf-8", "backslashreplace"))
        return bool(elsewhere) or len(names) > MOST_LINKS

    group.links.iterate(note, info=True)
    if elsewhere:
        raise DamagedContent(f"'{elsewhere[0]}' is a link that leads elsewhere")
    if len(names) > MOST_LINKS:
        raise DamagedContent(f"{name_of(group)} holds more than {MOST_LINKS} objects")
    return names


def name_of(group: h5g.GroupID) -> str:
    """The name of a table."""
    return h5i.get_name(group).decode("utf-8", "backslashreplace").strip("/") or "the file"


def _type_of(dataset: h5d.DatasetID, shown: str) -> np.dtype:
    kind = dataset.get_type()
    for known, dtype in _TYPES.get(kind.get_size(), ()):
        if known.equal(kind):
            return dtype
    raise DamagedContent(f"{shown}: its type is not that of a column")


def _rows_of(dataset: h5d.DatasetID, shown: str) -> int:
    shape = dataset.shape
    if shape is None or len(shape) != 1:
        raise DamagedContent(f"{shown}: is not a column")
    return int(shape[0])
