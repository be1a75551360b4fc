"""Run numerical tests as on other processors: NumPy with fewer instruction sets, kernels for a generic processor.

    python -m tests.distribution.processors tests/kernels tests/models     arguments go to pytest

Each setting is a run of pytest with an environment of its own. Settings of the linear-algebra library stay as they are.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping, Sequence

from llvmlite import binding
from numpy._core import _multiarray_umath as umath

from tests.distribution.pythons import HOME

GENERIC = {"NUMBA_CPU_NAME": "generic"}
WIDE = ("X86_V4", "AVX512")
"""Prefixes of the instruction sets that the first step disables. The second step disables everything above
NumPy's baseline. Names differ between versions of NumPy: X86_V4 and X86_V3 were AVX512F and AVX2 before 2.4."""


def settings(dispatch: Sequence[str], found: Mapping[str, bool], host: str) -> dict[str, dict[str, str]]:
    """{name: environment} of each setting; an empty environment if this processor has nothing to switch off.

    Args:
        dispatch: the instruction sets above its baseline for which NumPy has code.
        found: whether this processor has them, by name.
        host: this processor's name, for which kernels are compiled; 'generic' if LLVM does not know it.
    """
    above = [name for name in dispatch if found.get(name)]
    narrow = disabling([name for name in above if name.startswith(WIDE)])
    baseline = disabling(above)
    generic = {} if host in GENERIC.values() else GENERIC
    return {
        "NumPy without AVX-512": narrow,
        "NumPy's baseline": baseline,
        "kernels for a generic processor": generic,
        "NumPy's baseline and kernels for a generic processor": {**baseline, **generic} if baseline and generic else {},
    }


def disabling(names: Sequence[str]) -> dict[str, str]:
    """The environment in which NumPy does not use these instruction sets."""
    return {"NPY_DISABLE_CPU_FEATURES": " ".join(names)} if names else {}


def settings_here() -> dict[str, dict[str, str]]:
    """The settings for this processor and this NumPy."""
    return settings(umath.__cpu_dispatch__, umath.__cpu_features__, str(binding.get_host_cpu_name()))


def main(arguments: Sequence[str]) -> int:
    """Run pytest in each setting; 0 if at least one was possible and no test failed."""
    codes = {}
    for name, environment in settings_here().items():
        if not environment:
            print(f"{name}: skipped, there is nothing that it would change on this processor", flush=True)
            continue
        print(f"{name}: {' '.join(f'{key}={value!r}' for key, value in environment.items())}", flush=True)
        command = [sys.executable, "-m", "pytest", *arguments]
        codes[name] = subprocess.run(command, cwd=HOME, check=False, env={**os.environ, **environment}).returncode
    failures = [f"{name}: pytest ended with exit code {code}" for name, code in codes.items() if code]
    print(*failures, sep="\n", end="\n" if failures else "", file=sys.stderr)
    return 1 if failures or not codes else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
