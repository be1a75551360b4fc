"""What the compilation of kernels imports."""

import subprocess
import sys

import pytest

WITHOUT_SCIPY = """
import sys
import wsnsim.kernels.acoustic
from numba.np import arraymath, linalg
assert not any(name.startswith("scipy.linalg") for name in sys.modules), "kernels need no SciPy"
assert arraymath._HAVE_BLAS, "kernels of others have a BLAS"
linalg.ensure_blas()
assert sys.modules["scipy.linalg.cython_blas"] is not None
"""


@pytest.mark.thorough
def test_our_kernels_leave_scipy_alone_and_linear_algebra_in_kernels_of_others_has_its_blas():
    subprocess.run([sys.executable, "-c", WITHOUT_SCIPY], check=True, timeout=300)
