"""Right checksums for object headers that were changed: HDF5 refuses a header whose checksum is wrong.

with_checksums(raw) -> raw        headers of version 2 ('OHDR', 'OCHK') that still have their first eight bytes

The checksum is lookup3 by Bob Jenkins (2006, public domain), hashlittle with the initial value 0, as the HDF5 File
Format Specification 3.0 says.
"""

from __future__ import annotations

import struct

WORD = 0xFFFF_FFFF


def with_checksums(raw: bytearray) -> bytearray:
    """The file with right checksums of its object headers, as far as their sizes are within the file."""
    at = raw.find(b"OHDR")
    while at >= 0:
        _mend_header(raw, at)
        at = raw.find(b"OHDR", at + 4)
    return raw


def lookup3(data: bytes) -> int:
    """The checksum of some bytes."""
    a = b = c = (0xDEADBEEF + len(data)) & WORD
    rest = data
    while len(rest) > 12:
        x, y, z = struct.unpack_from("<III", rest)
        a, b, c = _mixed((a + x) & WORD, (b + y) & WORD, (c + z) & WORD)
        rest = rest[12:]
    if not rest:
        return c
    x, y, z = struct.unpack("<III", rest.ljust(12, b"\0"))
    return _final((a + x) & WORD, (b + y) & WORD, (c + z) & WORD)


def _mend_header(raw: bytearray, at: int) -> None:
    flags = raw[at + 5]
    start = at + 6 + (16 if flags & 0x20 else 0) + (4 if flags & 0x10 else 0)
    width = 1 << (flags & 3)
    size = int.from_bytes(raw[start : start + width], "little")
    step = 6 if flags & 4 else 4
    pieces = [(at, start + width, start + width + size)]
    for begin, first, end in pieces:
        _mend(raw, begin, end)
        place = first
        while place + step <= min(end, len(raw) - 20) and len(pieces) < 20:
            kind, length = raw[place], int.from_bytes(raw[place + 1 : place + 3], "little")
            if kind == 0x10 and length == 16:
                other, whole = struct.unpack_from("<QQ", raw, place + step)
                if raw[other : other + 4] == b"OCHK":
                    pieces.append((other, other + 4, other + whole - 4))
            place += step + length


def _mend(raw: bytearray, begin: int, end: int) -> None:
    if begin < end <= len(raw) - 4:
        raw[end : end + 4] = struct.pack("<I", lookup3(bytes(raw[begin:end])))


def _turned(value: int, bits: int) -> int:
    return ((value << bits) | (value >> (32 - bits))) & WORD


def _mixed(a: int, b: int, c: int) -> tuple[int, int, int]:
    for first, second, third in ((4, 6, 8), (16, 19, 4)):
        a, c = ((a - c) & WORD) ^ _turned(c, first), (c + b) & WORD
        b, a = ((b - a) & WORD) ^ _turned(a, second), (a + c) & WORD
        c, b = ((c - b) & WORD) ^ _turned(b, third), (b + a) & WORD
    return a, b, c


def _final(a: int, b: int, c: int) -> int:
    for first, second, third in ((14, 11, 25), (16, 4, 14)):
        c = ((c ^ b) - _turned(b, first)) & WORD
        a = ((a ^ c) - _turned(c, second)) & WORD
        b = ((b ^ a) - _turned(a, third)) & WORD
    return ((c ^ b) - _turned(b, 24)) & WORD
