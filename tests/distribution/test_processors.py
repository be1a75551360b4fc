"""Settings of `make processors`: what they switch off is off, and results made with them have features of their own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from typing import Any

import pytest

from tests.distribution import processors
from tests.distribution.processors import main, settings, settings_here

PROBE = """
import json
from numba.core.registry import cpu_target
from numpy._core import _multiarray_umath as umath
from wsnsim.recording.provenance import cpu_features
processor = cpu_target.target_context.codegen().magic_tuple()[1]
print(json.dumps([umath.__cpu_features__, processor, cpu_features()]))
"""
NUMPY_2_4 = ("X86_V3", "X86_V4", "AVX512_ICL", "AVX512_SPR")
NUMPY_2_0 = ("SSE41", "AVX", "F16C", "FMA3", "AVX2", "AVX512F", "AVX512_SKX")
ARM = ("ASIMDHP", "SVE")
NARROW, BASELINE, GENERIC, BOTH = settings([], {}, "znver4")


def probed(environment: dict[str, str]) -> Any:
    """(features of NumPy, processor of kernels, our features) of a process with these settings."""
    inherited = {name: value for name, value in os.environ.items() if name not in (*environment, "NUMBA_CPU_NAME")}
    inherited.pop("NPY_DISABLE_CPU_FEATURES", None)
    command = [sys.executable, "-c", PROBE]
    done = subprocess.run(command, env={**inherited, **environment}, capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


@pytest.mark.thorough
def test_what_a_setting_switches_off_is_off_and_results_say_so() -> None:
    wanted = {name: environment for name, environment in settings_here().items() if environment}
    features, processor, ours = probed({})
    kinds = [ours]
    for name, environment in wanted.items():
        found, compiled_for, kind = probed(environment)
        off = environment.get("NPY_DISABLE_CPU_FEATURES", "").split()
        assert all(features[each] and not found[each] for each in off), name
        assert compiled_for == environment.get("NUMBA_CPU_NAME", processor), name
        assert not set(off) & set(kind), name
        kinds.append(kind)
    assert len({tuple(kind) for kind in kinds}) == 1 + len({tuple(each.items()) for each in wanted.values()})


@pytest.mark.parametrize(
    ("dispatch", "absent", "narrow", "baseline"),
    [
        (NUMPY_2_4, ["AVX512_SPR"], "X86_V4 AVX512_ICL", "X86_V3 X86_V4 AVX512_ICL"),
        (NUMPY_2_0, [], "AVX512F AVX512_SKX", "SSE41 AVX F16C FMA3 AVX2 AVX512F AVX512_SKX"),
        (NUMPY_2_4, NUMPY_2_4[1:], None, "X86_V3"),
        (ARM, ["SVE"], None, "ASIMDHP"),
        (NUMPY_2_4, NUMPY_2_4, None, None),
    ],
)
def test_names_are_those_of_this_numpy_that_this_processor_has(
    dispatch: tuple[str, ...], absent: list[str], narrow: str | None, baseline: str | None
) -> None:
    found = settings(dispatch, {name: name not in absent for name in dispatch}, "znver4")
    assert found[NARROW] == ({"NPY_DISABLE_CPU_FEATURES": narrow} if narrow else {})
    assert found[BASELINE] == ({"NPY_DISABLE_CPU_FEATURES": baseline} if baseline else {})
    assert found[GENERIC] == {"NUMBA_CPU_NAME": "generic"}
    assert found[BOTH] == ({**found[BASELINE], **found[GENERIC]} if baseline else {})


def test_where_llvm_does_not_know_the_processor_kernels_are_for_a_generic_one_in_any_case() -> None:
    found = settings(NUMPY_2_4, dict.fromkeys(NUMPY_2_4, True), "generic")
    assert found[BASELINE] and not found[GENERIC] and not found[BOTH]


def test_a_setting_that_fails_is_named_and_one_that_is_impossible_is_skipped(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    runs: list[tuple[list[str], dict[str, str]]] = []

    def run(command: list[str], *, env: dict[str, str], **_: Any) -> subprocess.CompletedProcess[str]:
        runs.append((command, env))
        return subprocess.CompletedProcess(command, int("NUMBA_CPU_NAME" in env))

    monkeypatch.delenv("NUMBA_CPU_NAME", raising=False)
    monkeypatch.setattr(processors.subprocess, "run", run)
    monkeypatch.setattr(processors, "settings_here", lambda: {"a": {"X": "1"}, "b": {"NUMBA_CPU_NAME": "c"}, "d": {}})
    assert main(["tests/kernels"]) == 1
    said = capsys.readouterr()
    assert "d: skipped" in said.out and said.err == "b: pytest ended with exit code 1\n"
    assert [(command[1:], env.get("X")) for command, env in runs] == [
        (["-m", "pytest", "tests/kernels"], "1"), (["-m", "pytest", "tests/kernels"], None),
    ]  # fmt: skip
    monkeypatch.setattr(processors, "settings_here", lambda: {"a": {"X": "1"}, "d": {}})
    assert main([]) == 0
    monkeypatch.setattr(processors, "settings_here", lambda: {"d": {}})
    assert main([]) == 1
