"""An error in a plug-in's code names the plug-in: its file, its line, and where the run was."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import wsnsim
from wsnsim.base import plugin_code
from wsnsim.base.errors import UsageError
from wsnsim.campaign import sweeping
from wsnsim.cli import main
from wsnsim.scenario import fields, registry

HINT = " (set WSNSIM_TRACEBACK=1 for the traceback)\n"
FAULTY = """
import sys
import faulty_helper
from wsnsim import part
from wsnsim.models.ungm import Ungm
from wsnsim.trackers.bootstrap_pf import Pf

@part
class Steps(Pf):
    def step(self, belief, scene):
        return self.nothing  # line 11
        yield

@part
class Exits(Pf):
    def step(self, belief, scene):
        sys.exit(0)  # line 17
        yield

@part
class Helped(Pf):
    def step(self, belief, scene):
        faulty_helper.fail()
        yield

@part
class Checks(Pf):
    def check(self, setup):
        raise KeyError("missing")  # line 29

@part
class Builds(Pf):
    def __post_init__(self):
        raise LookupError("no table")  # line 34

@part
class Moves(Ungm):
    def truth(self, steps, dt, rng):
        raise OverflowError("too fast")  # line 39
"""
HELPER = "def fail():\n    raise ArithmeticError('of the helper')\n"
LAB = """
extends: ungm_pf
name: faulty
duration: 6 s
"""


@pytest.fixture(autouse=True)
def _lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "faulty.py").write_text(FAULTY)
    (tmp_path / "faulty_helper.py").write_text(HELPER)
    (tmp_path / "lab.yaml").write_text(LAB)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.setattr(registry, "SEARCHED", [])
    for module in ("faulty", "faulty_helper", "broken"):
        monkeypatch.delitem(sys.modules, module, raising=False)
    fields.part_model.cache_clear()


AT = "the run failed at 1 s of simulated time (seed 20220101, replicate 0): "


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ("tracker.kind=faulty:Steps", f"{AT}faulty.py:11: AttributeError: 'Steps' object has no attribute 'nothing'"),
        ("tracker.kind=faulty:Exits", f"{AT}faulty.py:17: SystemExit: 0"),
        ("tracker.kind=faulty:Helped", f"{AT}faulty_helper.py:2: ArithmeticError: of the helper"),
        ("tracker.kind=faulty:Checks", "faulty.py:29: KeyError: 'missing'"),
        ("tracker.kind=faulty:Builds", "faulty.py:34: LookupError: no table"),
        (
            "motion.kind=faulty:Moves",
            "the run failed at 0 s of simulated time (seed 20220101, replicate 0): "
            "faulty.py:39: OverflowError: too fast",
        ),
    ],
)
def test_an_error_in_a_plugin_names_its_file_and_line(kind: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "lab.yaml", "--set", kind, "--quiet"]) == 1
    assert capsys.readouterr().err == f"wsnsim: error: {said}{HINT}"
    assert not list(Path("results").glob("*"))


@pytest.mark.thorough
def test_in_a_network_too(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--set", "tracker.kind=faulty:Steps", "--set", "duration=0.4 s", "--quiet"]
    assert main(["run", "jiang_field", *words]) == 1
    said = capsys.readouterr().err
    assert said.startswith("wsnsim: error: the run failed at ") and "replicate 0): faulty.py:11: AttributeE" in said


def test_an_error_while_it_is_imported_is_a_finding_of_the_scenario(capsys: pytest.CaptureFixture[str]) -> None:
    for content, said in (
        ("x = 1\ny = = 2\n", "broken.py:2: SyntaxError: invalid syntax"),
        ("import no_such_library\n", "broken.py:1: ModuleNotFoundError: No module named 'no_such_library'"),
    ):
        Path("broken.py").write_text(content)
        assert main(["run", "lab.yaml", "--set", "tracker.kind=broken:X"]) == 2
        assert f"error: broken:X cannot be imported: {said}\n" in capsys.readouterr().err


@pytest.mark.thorough
def test_check_reports_an_error_of_a_plugin(capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "lab.yaml", "--set", "tracker.kind=faulty:Checks", "--quiet"]) == 1
    assert capfd.readouterr().err == f"lab.yaml: error: faulty.py:29: KeyError: 'missing'{HINT}"


# a script without a main guard


SCRIPT = """
import wsnsim
wsnsim.sweep("ungm_pf", out="c", vary=["tracker.particles=10,20"], replicates=2)
"""


@pytest.mark.thorough
def test_a_sweep_of_a_script_without_a_main_guard_is_one_error_at_once(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    here = str(Path(wsnsim.__file__).parents[1])
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, env={"PYTHONPATH": here})
    assert done.returncode == 1
    assert done.stderr.count("Traceback") == 1
    last = done.stderr.splitlines()[-1]
    assert last.startswith("wsnsim.base.errors.UsageError: ") and 'if __name__ == "__main__":' in last
    assert not (tmp_path / "c").exists()


@pytest.mark.parametrize(
    ("content", "line", "guarded"),
    [
        ("sweep()", 1, False),
        ("if __name__ == '__main__':\n    sweep()", 2, True),
        ("if '__main__' == __name__ and True:\n    sweep()", 2, True),
        ("if __name__ != '__main__':\n    raise SystemExit\nsweep()", 3, True),
        ("if True:\n    sweep()", 2, False),
        ("def f():\n    pass\nfor x in y:\n    sweep()", 4, False),
        ("if (lambda: {1: 2}[1:])() or __name__ == '__main__':\n    sweep()", 2, True),
        ("if True: print(__name__)\nsweep()", 2, False),
        ("def f():\n    if __name__ == '__main__':\n        pass\nsweep()", 4, False),
        ("sweep()\nif __name__ == '__main__':\n    pass", 1, False),
        ("(", 1, True),
    ],
)
def test_what_is_a_main_guard(content: str, line: int, guarded: bool) -> None:
    assert sweeping.is_guarded(content, line) is guarded


def test_a_worker_that_imports_the_script_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    script = {"__name__": "__mp_main__", "sweep": wsnsim.sweep}
    with pytest.raises(UsageError, match="under if __name__"):
        exec(compile("sweep('ungm_pf', out='c')", "script.py", "exec"), script)


def test_a_folder_whose_name_begins_like_that_of_python_or_wsnsim_is_no_part_of_them() -> None:
    for known in (Path(subprocess.__file__).parent, Path(wsnsim.__file__).parent):
        assert not plugin_code._is_foreign(str(known / "x.py"))
        assert plugin_code._is_foreign(str(known.with_name(f"{known.name}-mine") / "x.py"))
