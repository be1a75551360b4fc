"""Random numbers: named streams, and a counter-based hash for draws that must not depend on other draws.

`Streams(seed, replicate)("truth")` is one Generator per purpose. `derive(key, i, k)` hashes integers into a 64-bit key,
and `uniforms(keys, j)`, `normals(keys, j)` are the j-th draw of each key, independent of the order of the calls. This
is the NumPy version of `kernels.elementary` (bit-equal in the hash and the uniforms).
"""

from __future__ import annotations

import hashlib
from typing import Final

import numpy as np

from wsnsim.base.arrays import Floats, Ints, Keys

MASK: Final = 0xFFFF_FFFF_FFFF_FFFF
GOLDEN: Final = 0x9E37_79B9_7F4A_7C15
FIRST: Final = 0xBF58_476D_1CE4_E5B9
SECOND: Final = 0x94D0_49BB_1331_11EB
HEAD_KEY: Final = 0xFFFF_FFFF
"""Replaces the number of a node in the draws that a head makes for the whole track."""
FURTHER_COMPONENTS: Final = 4
"""The draw that is the noise of the second component of a reading; detection and shadowing take earlier ones."""


def name_hash(name: str) -> int:
    """A stable 32-bit number for a stream's name (Python's own hash differs between processes)."""
    return int.from_bytes(hashlib.blake2b(name.encode(), digest_size=4).digest(), "little")


OF_NETWORK: Final = frozenset({"deploy", "gains", "position_error", "shadowing", "clock", "battery"})
"""The streams of what makes a network: where its nodes stand, and the constants of its nodes and links."""
PHASES: Final = frozenset({"wake_up"})
"""The streams of what else makes a network whose clocks do not drift: when nodes wake up."""


class Streams:
    """Random streams by purpose. They depend on seed and run, not on the tracker or the order of the calls.

    Args:
        seed: The seed of the scenario.
        replicate: The number of the Monte Carlo run.
        network: The number of the run whose network this one has, too; None: it has its own.
        drifting: Whether clocks drift, so that the phases of wake-ups are not part of a network.
    """

    def __init__(self, seed: int, replicate: int, network: int | None = None, drifting: bool = False) -> None:
        self.seed = seed
        self.replicate = replicate
        self._network = replicate if network is None else network
        self._kept = OF_NETWORK if drifting else OF_NETWORK | PHASES

    def _sequence(self, name: str) -> np.random.SeedSequence:
        run = self._network if name in self._kept else self.replicate
        return np.random.SeedSequence(self.seed, spawn_key=(run, name_hash(name)))

    def __call__(self, name: str) -> np.random.Generator:
        """A fresh Generator at the start of the named stream."""
        return np.random.Generator(np.random.Philox(self._sequence(name)))

    def key(self, stream: str) -> int:
        """The 64-bit key of the named stream, for counter draws."""
        return int(self._sequence(stream).generate_state(1, np.uint64)[0])


def mix(x: int) -> int:
    """The SplitMix64 finaliser (Steele, Lea, Flood 2014) on one integer."""
    x &= MASK
    x = ((x ^ (x >> 30)) * FIRST) & MASK
    x = ((x ^ (x >> 27)) * SECOND) & MASK
    return x ^ (x >> 31)


def derive(key: int, *numbers: int) -> int:
    """A key for (key, numbers...): equal arguments give equal keys, different ones unrelated keys.

    Args:
        key: A 64-bit key, such as `scene.key`.
        numbers: Integers, such as a step and the number of a node.
    """
    for number in numbers:
        key = mix(key + (number + 1) * GOLDEN)
    return key


def derive_all(key: int, numbers: np.ndarray) -> Keys:
    """`derive(key, i)` for every i of an integer array, as (n,) uint64.

    Args:
        key: A 64-bit key.
        numbers: (n,) integers.
    """
    return _mix_all(np.uint64(key) + (numbers.astype(np.uint64) + np.uint64(1)) * np.uint64(GOLDEN))


def derive_each(keys: Keys, *numbers: Keys) -> Keys:
    """`derive(key, i, k, ...)` element by element, over uint64 arrays that broadcast."""
    for column in numbers:
        keys = _mix_all(keys + (column + np.uint64(1)) * np.uint64(GOLDEN))
    return keys


def reading_noise(key: int, steps: Ints, nodes: Ints, components: int = 1) -> Floats:
    """Standard normal measurement noise of nodes at steps, both (n,): a function of (key, step, node) alone.

    It is (n,), or (n, M) for readings of M > 1 components.
    """
    return component_noise(derive_each(derive_all(key, steps), nodes.astype(np.uint64)), components)


def component_noise(keys: Keys, components: int) -> Floats:
    """Standard normal noise of the readings with these keys (n,): (n,), or (n, M) for M > 1 components."""
    if components == 1:
        return normals(keys, 0)
    draws = [0, *range(FURTHER_COMPONENTS, FURTHER_COMPONENTS + components - 1)]
    return np.stack([normals(keys, draw) for draw in draws], axis=1)


def uniforms(keys: Keys, draw: int) -> Floats:
    """(n,) the `draw`-th uniform number on [0, 1) of each key, with 53 bits.

    Args:
        keys: (n,) uint64.
        draw: The number of the draw, from 0. The uniforms 2 i and 2 i + 1 make the normal i: take others for both.
    """
    hashes = _mix_all(keys + np.uint64(((draw + 1) * GOLDEN) & MASK))
    return (hashes >> np.uint64(11)).astype(np.float64) * 2.0**-53


def normals(keys: Keys, draw: int) -> Floats:
    """(n,) the `draw`-th standard normal number of each key: Box-Muller on the uniforms 2 draw and 2 draw + 1.

    Args:
        keys: (n,) uint64.
        draw: The number of the draw, from 0.
    """
    radius = np.sqrt(-2.0 * np.log1p(-uniforms(keys, 2 * draw)))
    return radius * np.cos(2.0 * np.pi * uniforms(keys, 2 * draw + 1))


def _mix_all(x: Keys) -> Keys:
    """`mix` over an array; products wrap around modulo 2**64, as intended."""
    x = (x ^ (x >> np.uint64(30))) * np.uint64(FIRST)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(SECOND)
    return x ^ (x >> np.uint64(31))
