"""Damaged and hostile result files, made from an intact one: each differs in one thing that a stranger could do.

mutants(intact, seed, count) -> Iterator[Mutant]      edited ones first, then random ones
random_mutants(intact, seed) -> Iterator[Mutant]      endless: bytes, blocks, sizes, headers with a right checksum
"""

from __future__ import annotations

import io
import itertools
import random
import struct
from collections.abc import Callable, Iterator
from typing import NamedTuple

import h5py

from tests.fuzz.hdf5_checksums import with_checksums
from tests.fuzz.hdf5_edits import EDITS


class Mutant(NamedTuple):
    """A file that is not as wsnsim wrote it.

    Attributes:
        name: what was changed; it can name a file.
        content: the bytes of the file.
    """

    name: str
    content: bytes


def mutants(intact: bytes, seed: int, count: int) -> Iterator[Mutant]:
    """The edited mutants, and random ones up to this number."""
    return itertools.islice(itertools.chain(edited_mutants(intact), random_mutants(intact, seed)), count)


def edited_mutants(intact: bytes) -> Iterator[Mutant]:
    """One mutant for each of the `EDITS`, made with h5py."""
    for name in EDITS:
        yield Mutant(name, edited(intact, name))


def edited(intact: bytes, name: str) -> bytes:
    """The file with one of the `EDITS`."""
    memory = io.BytesIO(intact)
    with h5py.File(memory, "r+", libver=("v108", "latest")) as file:
        EDITS[name](file)
    return memory.getvalue()


def random_mutants(intact: bytes, seed: int) -> Iterator[Mutant]:
    """Mutants of random places, the same for the same seed."""
    chance = random.Random(seed)
    for number in itertools.count():
        make = chance.choice(RANDOM)
        yield Mutant(f"{make.__name__.strip('_')}-{seed}-{number}", bytes(make(bytearray(intact), chance)))


def _flipped(raw: bytearray, chance: random.Random) -> bytearray:
    for _ in range(chance.choice((1, 1, 2, 8, 64))):
        raw[chance.randrange(len(raw))] ^= 1 << chance.randrange(8)
    return raw


def _cut(raw: bytearray, chance: random.Random) -> bytearray:
    return raw[: chance.randrange(len(raw))]


def _spliced(raw: bytearray, chance: random.Random) -> bytearray:
    size = chance.choice((8, 64, 512, 4096))
    start, end = (chance.randrange(max(len(raw) - size, 1)) for _ in range(2))
    raw[end : end + size] = raw[start : start + size]
    return raw


def _filled(raw: bytearray, chance: random.Random) -> bytearray:
    size, start = chance.choice((4, 8, 64, 512)), chance.randrange(len(raw))
    size = min(size, len(raw) - start)
    raw[start : start + size] = bytes([chance.choice((0, 0xFF, 0x41))]) * size
    return raw


def _resized(raw: bytearray, chance: random.Random) -> bytearray:
    """A number in an object header that counts bytes or places becomes a large one; the checksum is right."""
    start = _some_header(raw, chance)
    at, width = start + chance.randrange(6, 200), chance.choice((2, 4, 8))
    value = chance.choice((0, 1, 0xFFFF, 0xFFFF_FFFF, 1 << 40, len(raw), len(raw) - 1)) % (1 << 8 * width)
    raw[at : at + width] = value.to_bytes(width, "little")
    return with_checksums(raw)


def _header_flipped(raw: bytearray, chance: random.Random) -> bytearray:
    """Bits of an object header flip, and its checksum is right."""
    start = _some_header(raw, chance)
    for _ in range(chance.choice((1, 2, 4))):
        raw[min(start + chance.randrange(4, 250), len(raw) - 1)] ^= 1 << chance.randrange(8)
    return with_checksums(raw)


def _some_header(raw: bytearray, chance: random.Random) -> int:
    found = chance.randrange(len(raw))
    at = raw.find(b"OHDR", found)
    return at if at >= 0 else raw.find(b"OHDR")


RANDOM: tuple[Callable[[bytearray, random.Random], bytearray], ...] = (
    _flipped, _cut, _spliced, _filled, _resized, _header_flipped
)  # fmt: skip


def long_text(intact: bytes) -> bytes:
    """The file, with a text whose stated length is 4 GiB."""
    with h5py.File(io.BytesIO(intact)) as file:
        at = file["provenance_json"].id.get_offset()
    return intact[:at] + struct.pack("<I", 0xFFFF_FFFF) + intact[at + 4 :]
