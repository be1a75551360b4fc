import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba import njit
from scipy import stats

from wsnsim.base import rng
from wsnsim.kernels import elementary

KEYS = st.integers(0, 2**64 - 1)


@njit
def uniforms_in_a_kernel(keys, draw):
    """What a kernel that draws would get."""
    result = np.empty(keys.size)
    for j in range(keys.size):
        result[j] = elementary.uniform(keys[j], draw)
    return result


@pytest.mark.thorough
@given(KEYS, st.integers(0, 1000), st.integers(0, 20))
def test_the_hash_in_kernels_equals_its_numpy_twin_bit_for_bit(key, tag, draw):
    offsets = np.array([0, 3, 5], dtype=np.int64)
    members = np.array([key, key ^ 1], dtype=np.uint64)
    keys = elementary.particle_keys(members, offsets, tag)
    expected = [rng.derive(int(members[m]), tag, j) for m, count in ((0, 3), (1, 2)) for j in range(count)]
    assert keys.tolist() == expected
    assert uniforms_in_a_kernel(keys, draw).tolist() == rng.uniforms(keys, draw).tolist()


@given(KEYS, st.lists(st.integers(-1, 2**31), min_size=1, max_size=4))
def test_deriving_one_by_one_and_all_at_once_agree(key, numbers):
    assert rng.derive_all(key, np.array(numbers)).tolist() == [rng.derive(key, n) for n in numbers]
    columns = [np.array([n], dtype=np.int64).view(np.uint64) for n in numbers]
    assert rng.derive_each(np.array([key], dtype=np.uint64), *columns).tolist() == [rng.derive(key, *numbers)]


def test_counter_draws_look_like_what_they_claim_to_be():
    keys = rng.derive_all(rng.derive(3, 1), np.arange(50_000))
    assert stats.kstest(rng.uniforms(keys, 0), "uniform").pvalue > 1e-3
    normals = np.stack([rng.normals(keys, j) for j in range(3)])
    assert all(stats.kstest(row, "norm").pvalue > 1e-3 for row in normals)
    assert np.abs(np.corrcoef(normals) - np.eye(3)).max() < 0.02
    neighbours = rng.normals(keys, 0)
    assert abs(np.corrcoef(neighbours[:-1], neighbours[1:])[0, 1]) < 0.02


def test_streams_depend_on_seed_replicate_and_purpose_and_on_nothing_else():
    first = rng.Streams(5, 2)("truth").random(4)
    rng.Streams(5, 2)("link").random(100)
    assert rng.Streams(5, 2)("truth").random(4).tolist() == first.tolist()
    others = [rng.Streams(6, 2)("truth"), rng.Streams(5, 3)("truth"), rng.Streams(5, 2)("sense")]
    assert all(other.random(4).tolist() != first.tolist() for other in others)


@pytest.mark.thorough
def test_streams_are_the_same_in_every_process():
    code = "from wsnsim.base.rng import Streams; print(Streams(5, 2)('truth').random(), Streams(5, 2).key('sense'))"
    lines = {
        subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
        for _ in range(2)
    }
    here = f"{rng.Streams(5, 2)('truth').random()} {rng.Streams(5, 2).key('sense')}\n"
    assert lines == {here}
