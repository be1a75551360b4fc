"""`wsnsim sweep` and `collect`: their output, files, errors and exit codes.

Tasks run in this process, except where worker processes are tested.
"""

from __future__ import annotations

import json
import os
import shlex
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

import wsnsim
from wsnsim.base.errors import RunError
from wsnsim.campaign import engines, prepare, run_campaign, sweeping
from wsnsim.campaign.engines import FinishedTask
from wsnsim.campaign.task import perform
from wsnsim.cli import main
from wsnsim.models.deploy import Uniform
from wsnsim.scenario.sweep import load_sweep

from .campaign_files import assert_same, files_of, tables_of
from .inline_engine import InlineEngine
from .moody_tracker import TRUSTED, sweep_of, write_sweep
from .processes import children, environment, lives, wait_for

CALM = [{"pause": 0.0}, {"pause": 0.001}]


@pytest.fixture(autouse=True)
def _inline(lab: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engines, "LocalEngine", InlineEngine)


@pytest.fixture
def sweep(lab: Path) -> str:
    return write_sweep(lab / "moods.yaml", sweep_of(CALM, 4))


@pytest.fixture
def poisoned(lab: Path) -> str:
    return write_sweep(lab / "poisoned.yaml", sweep_of([{"mood": "calm"}, {"mood": "raises", "at": 2}], 4))


def resume_of(said: str) -> list[str]:
    """The printed command that resumes the campaign."""
    line = next(line for line in said.splitlines() if line.startswith("wsnsim: resume with: "))
    words = shlex.split(line.partition("with: ")[2])
    assert words[0] == "wsnsim"
    return words[1:]


# what it answers


@pytest.mark.thorough
def test_a_sweep_fills_its_folder_and_prints_a_table_and_again_runs_nothing(
    sweep: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["sweep", sweep]) == 0
    first = capsys.readouterr()
    before = files_of(Path("results/moods"))
    assert "moods: 2 points, 4 runs each" in first.out and "tracker.pause" in first.out
    assert first.err.splitlines()[-1].startswith("wsnsim: 100 % (8 of 8 runs done, 0 failed")
    assert len(before) == 4
    for again in (["sweep", sweep], ["sweep", "results/moods", "--plugins"]):
        assert main([*again, "--quiet"]) == 0
        assert capsys.readouterr() == (first.out, "")
        assert files_of(Path("results/moods")) == before


@pytest.mark.thorough
def test_more_replicates_leave_the_files_that_there_are_as_they_are(sweep: str) -> None:
    assert main(["sweep", sweep, "-q"]) == 0
    before, rows = files_of(Path("results/moods")), wsnsim.read("results/moods", "runs")
    assert main(["sweep", sweep, "--replicates", "7", "-q"]) == 0
    after, more = files_of(Path("results/moods")), wsnsim.read("results/moods", "runs")
    assert before.items() < after.items() and len(more) == 14
    pd.testing.assert_frame_equal(more[more["replicate"] < 4].reset_index(drop=True), rows)


def test_json_is_one_object_and_csv_the_same_table(sweep: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sweep", sweep, "--json", "--csv", "table.csv", "--progress", "json"]) == 0
    said = capsys.readouterr()
    answer = json.loads(said.out, parse_constant=lambda word: pytest.fail(f"{word} is no JSON"))
    assert (answer["schema_version"], answer["name"], answer["folder"]) == (1, "moods", "results/moods")
    assert [point["replicates"] for point in answer["points"]] == [4, 4]
    told = [json.loads(line) for line in said.err.splitlines()]
    assert told[-1]["done"] == told[-1]["total"] == 8 and told[-1]["failed"] == 0 and told[-1]["share"] == 1.0
    table = pd.read_csv("table.csv")
    assert table["median"].tolist() == pytest.approx([point["median"] for point in answer["points"]])


def test_a_dry_run_says_what_it_would_take_and_writes_nothing(
    sweep: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    before = sorted(Path().rglob("*"))
    assert main(["sweep", sweep, "--dry-run"]) == 0
    assert capsys.readouterr().out.startswith("moods: 2 points, 8 runs, 0 of them done\n  missing  8 runs in 4 tasks")
    assert main(["sweep", sweep, "--dry-run", "--json", "--shard", "1/2"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert (answer["replicates"], answer["left"], answer["tasks"]) == (4, 4, 2) and answer["cpu_seconds"] > 0
    monkeypatch.setattr(sweeping, "TRIAL_TIMEOUT", -1.0)  # a trial is cut short at once
    assert main(["sweep", sweep, "--dry-run", "--json"]) == 0
    cut = json.loads(capsys.readouterr().out)
    assert cut["size"] is None and cut["cpu_seconds"] > 0
    assert [place for place in sorted(Path().rglob("*")) if "__pycache__" not in place.parts] == before


@pytest.mark.thorough(fast=["5"])
@pytest.mark.parametrize("replicates", ["1", "2", "5", "7"])
def test_a_dry_run_states_the_bytes_that_are_written_in_full_and_in_partial_tasks(
    sweep: str, replicates: str, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["sweep", sweep, "--replicates", replicates, "-o", "sized"]
    assert main([*command, "--dry-run", "--json"]) == 0
    estimated = json.loads(capsys.readouterr().out)["size"]
    assert main([*command, "-q"]) == 0
    written = sum(file.stat().st_size for file in Path("sized").rglob("*.h5"))
    assert estimated == pytest.approx(written, rel=0.05)


@pytest.mark.thorough
def test_a_dry_run_of_a_campaign_that_is_begun_counts_what_is_there(
    sweep: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["sweep", sweep, "-q"]) == 0
    capsys.readouterr()
    assert main(["sweep", sweep, "--dry-run", "--json", "--replicates", "5"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert (answer["done"], answer["left"], answer["tasks"]) == (8, 2, 2)
    assert answer["source"] == "4 existing files"


@pytest.mark.thorough
def test_parts_collected_are_the_campaign(sweep: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sweep", sweep, "-q", "-o", "whole"]) == 0
    whole = capsys.readouterr().out
    for number in (1, 2):
        assert main(["sweep", sweep, "--shard", f"{number}/2", "-o", f"part{number}"]) == 0
        said = capsys.readouterr()
        assert said.out == "" and f"shard {number} of 2 is complete: 4 runs done, 0 existed before" in said.err
    assert main(["collect", "part1", "-o", "all"]) == 3
    said = capsys.readouterr()
    assert said.err.splitlines() == [
        "wsnsim: all is incomplete:",
        "  tracker.pause = 0.0: replicates 2-3",
        "  tracker.pause = 0.001: replicates 0-1",
    ]
    assert main(["collect", "part1", "part2", "-o", "all"]) == 0
    assert capsys.readouterr() == (whole, "")
    assert_same(tables_of(Path("all")), tables_of(Path("whole")))


# what goes wrong


def test_what_fails_is_named_and_kept_and_the_rest_is_done(poisoned: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sweep", poisoned, "-o", "c", "-q"]) == 3
    said = capsys.readouterr()
    assert "2 points" in said.out
    lines = said.err.splitlines()
    assert "failed: the run failed at 1 s of simulated time" in lines[0] and "out of sorts" in lines[0]
    assert lines[1:] == [
        "wsnsim: c is incomplete, runs missing: 1",
        "  tracker.mood = raises, tracker.at = 2: replicates 2",
        "wsnsim: resume with: wsnsim sweep c --plugins",
    ]
    [note] = Path("c/failed").iterdir()
    assert "replicate 2, tracker.mood = raises" in note.read_text()
    Path("cured").touch()
    assert main(resume_of(said.err)) == 0
    assert not list(Path("c/failed").iterdir())


def test_a_point_without_a_possible_run_is_tried_and_named_once_at_each_start(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    few = ["sweep", "pso_mhpf", "--vary", "deploy.nodes=25", "--set", "deploy.draws=1", "--set", "duration=1"]
    performed: list[str] = []
    monkeypatch.setattr(engines, "perform", lambda task: (performed.append(task.name), perform(task))[1])
    for words in ([*few, "--replicates", "70", "-o", "c", "-q"], ["sweep", "c", "-q"], ["compare", "c", "-q"]):
        performed.clear()
        assert main(words) == 3
        failed, left, *rest = [line for line in capsys.readouterr().err.splitlines() if "no results" not in line]
        assert failed.startswith("wsnsim: deploy.nodes = 25 failed: deploy: none of 1 sampled deployments of 25 nodes")
        assert failed.endswith(
            "replicate 0); runs with other random numbers fail, too, so that the others were not tried"
        )
        assert left == "wsnsim: c is incomplete, runs missing: 70" and not rest and len(performed) == 1
        [report] = Path("c/failed").iterdir()
        assert report.name.endswith(".r00000-00069.txt")
    with pytest.raises(RunError, match="runs with other random numbers fail, too"):
        wsnsim.compare("pso_mhpf", trackers=["ekf", "ppf"], replicates=2, workers=0, deploy=Uniform(nodes=25, draws=1))


REFUSALS: Mapping[str, Mapping[str, Any]] = {
    "deploy: none of 1": {"deploy.nodes": 25, "deploy.draws": 1},
    "deploy: none of 2": {"deploy": {"kind": "jittered_grid", "nodes": 20, "jitter": 1.0, "draws": 2}},
    "nodes.csv: cannot be read": {"deploy": {"kind": "file", "path": "nodes.csv"}},
    "track.csv: cannot be read": {"motion": {"kind": "recorded_track", "path": "track.csv"}},
    "scenario.json: is damaged": {"tracker.particles": 20},
    "out of sorts": {"tracker": {"kind": "moody:Moody", "mood": "starts"}},
    "of sorts": {"tracker": {"kind": "moody:Moody", "mood": "starts"}},
}
"""{reason: what gives it}: of pso_mhpf, the last one of ungm_pf, which has no network."""


@pytest.mark.parametrize("words", REFUSALS)
def test_what_refuses_a_run_in_its_first_step_whatever_is_random_refuses_its_point(lab: Path, words: str) -> None:
    at = "x,y\n0,0\n60,0\n0,60\n60,60\n"
    Path("nodes.csv").write_text(at)
    Path("track.csv").write_text("time,x,y\n0,0,0\n9,9,9\n")
    network = {"deploy.cover": words.startswith("deploy")} if words != "of sorts" else {}
    changes = {**network, "duration": "2 s", **REFUSALS[words]}
    folder = prepare(load_sweep("pso_mhpf" if network else "ungm_pf", [], changes, replicates=60), "c")
    for name in ("nodes.csv", "track.csv"):
        Path(name).unlink()
    if "damaged" in words:
        next(Path("c").glob("*/scenario.json")).write_text("{")
    outcome = run_campaign(folder, InlineEngine(), access=TRUSTED)
    [(point, why)] = outcome.failed.items()
    assert words in why and point == folder.manifest().points[0].id and len(outcome.missing[point]) == 60


def test_a_dry_run_names_a_point_without_a_possible_run(capsys: pytest.CaptureFixture[str]) -> None:
    few = ["--set", "deploy.draws=1", "--set", "duration=0.4 s", "--replicates", "1", "--dry-run"]
    assert main(["sweep", "pso_mhpf", "--vary", "deploy.nodes=25,256", *few]) == 0
    said = capsys.readouterr().out
    assert "estimated from one trial run; deploy.nodes = 25 failed: deploy: none of 1 sampled deployments" in said
    assert main(["sweep", "pso_mhpf", "--vary", "deploy.nodes=25", *few]) == 1
    assert capsys.readouterr().err.startswith("wsnsim: error: deploy.nodes = 25 failed: deploy: none of 1 sampled")


def test_a_run_that_fails_where_others_do_not_refuses_none_of_them(poisoned: str) -> None:
    assert main(["sweep", poisoned, "-o", "c", "-q"]) == 3
    assert len(wsnsim.read("c", "runs")) == 7


@pytest.mark.thorough(fast=["0/2"])
@pytest.mark.parametrize("shard", ["0/2", "3/2", "1/0", "2", "a/b", "1/2/3", "-1/2"])
def test_a_shard_that_is_none_is_refused(sweep: str, shard: str, capsys: pytest.CaptureFixture[str]) -> None:
    for more in ([], ["--dry-run"]):
        assert main(["sweep", sweep, f"--shard={shard}", *more]) == 2
        assert f"--shard takes I/N with 1 <= I <= N, such as 1/2, not '{shard}'" in capsys.readouterr().err
    assert not Path("results").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--metric", "rsme"], "--metric: table runs has no metric 'rsme' (did you mean 'rmse'?)"),
        (
            ["--by", "tracker.pauses"],
            "--by: the campaign does not vary 'tracker.pauses' (did",
        ),
        (["--csv", "nowhere/x.csv"], "--csv nowhere/x.csv: folder does not exist: nowhere"),
        (["-o", "moody.py"], "moody.py is a file; a campaign needs a folder"),
        (["-o", "."], ". is not empty and holds no campaign; give a new folder with --out"),
        (["-o", "moody.py/c"], "cannot write moody.py/c: Not a directory"),
        (["--scheduler", "tcp://x:1", "--scheduler-file", "f"], "--scheduler cannot be combined with --scheduler-file"),
    ],
)
def test_what_could_not_be_answered_is_refused_before_anything_runs(
    sweep: str, words: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["sweep", sweep, *words]) == 2
    assert capsys.readouterr().err.startswith(f"wsnsim: error: {message}")
    assert not list(Path().rglob("r0*.h5"))


def test_a_damaged_manifest_or_result_and_another_version_are_named(
    sweep: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["sweep", sweep, "-q", "-o", "c"]) == 0
    manifest = Path("c/campaign.json").read_text()
    result = sorted(Path("c").glob("*/r*.h5"))[0]
    capsys.readouterr()
    for text, code, words in (
        (manifest[:99], 1, "c/campaign.json: is damaged"),
        (
            manifest.replace('"wsnsim_version": "', '"wsnsim_version": "9'),
            2,
            "versions are not mixed",
        ),
    ):
        Path("c/campaign.json").write_text(text)
        for source in (["c"], [sweep, "-o", "c"]):
            assert main(["sweep", *source]) == code
            said = capsys.readouterr()
            assert words in said.err and said.out == "" and "internal" not in said.err
    Path("c/campaign.json").write_text(manifest)
    result.write_bytes(result.read_bytes()[:2000])
    assert main(["sweep", "c", "-q", "--plugins"]) == 3
    said = capsys.readouterr()
    assert said.err.startswith(f"wsnsim: {result}.damaged: is damaged and was set aside") and said.out == ""
    assert "resume with: wsnsim sweep c --plugins" in said.err
    assert main(["sweep", "c", "-q", "--plugins"]) == 0 and result.is_file()


@pytest.mark.thorough
def test_under_a_rule_a_damaged_result_is_run_again_and_counted_once(
    sweep: str, capsys: pytest.CaptureFixture[str]
) -> None:
    rule: dict[str, Any] = {"metric": "rmse", "half_width": 1e-9, "at_least": 2, "at_most": 6}
    ruled = write_sweep(Path("ruled.yaml"), sweep_of(CALM, until=rule, block=1))
    assert main(["sweep", ruled, "-q", "-o", "c"]) == 0
    before = wsnsim.read("c", "runs").drop(columns="cpu_seconds")
    broken = min(Path("c").glob("*/r00000-00000.h5"))
    broken.write_bytes(b"no result")
    capsys.readouterr()
    assert main(["sweep", "c", "--plugins", "--progress", "json"]) == 0
    last = json.loads(capsys.readouterr().err.splitlines()[-1])
    assert (last["done"], last["total"], last["failed"]) == (12, 12, 0)
    assert wsnsim.read("c", "runs").drop(columns="cpu_seconds").equals(before)


# signals


@pytest.fixture
def no_nohup() -> Iterator[None]:
    """SIGHUP is not ignored, although these tests may run under nohup."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


@pytest.mark.thorough(fast=["numbers3-130-wsnsim: error: interrupted"])
@pytest.mark.parametrize(
    ("numbers", "code", "words"),
    [
        ([signal.SIGINT], 130, "wsnsim: interrupted"),
        ([signal.SIGTERM], 143, "wsnsim: stopped by SIGTERM"),
        ([signal.SIGHUP], 129, "wsnsim: stopped by SIGHUP"),
        ([signal.SIGINT, signal.SIGINT], 130, "wsnsim: error: interrupted"),
    ],
)
def test_a_signal_ends_what_runs_and_prints_the_command_that_goes_on(
    sweep: str,
    no_nohup: None,
    numbers: list[int],
    code: int,
    words: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    class Signalled(InlineEngine):
        def finished(self, timeout: float) -> list[FinishedTask]:
            endings = super().finished(timeout)
            for number in numbers:
                os.kill(os.getpid(), number)
            return endings

    monkeypatch.setattr(engines, "LocalEngine", Signalled)
    assert main(["sweep", sweep, "-o", "a campaign", "-j", "3", "--metric", "median_error", "--json"]) == code
    said = capsys.readouterr()
    assert said.out == "" and said.err.splitlines()[-1] == words
    monkeypatch.setattr(engines, "LocalEngine", InlineEngine)
    command = resume_of(said.err)
    assert command == ["sweep", "a campaign", "--jobs", "3", "--metric", "median_error", "--plugins", "--json"]
    before = files_of(Path("a campaign"))
    assert len(before) == 1
    assert main(command) == 0
    assert before.items() < files_of(Path("a campaign")).items()
    assert json.loads(capsys.readouterr().out)["metric"] == "median_error"


@pytest.mark.thorough
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGHUP, 129)])
def test_ctrl_c_and_a_closed_terminal_let_workers_end_their_tasks(lab: Path, number: signal.Signals, code: int) -> None:
    """The terminal sends the signal to the workers as well. No temporary file, semaphore or shared memory is left."""
    shared = Path("/dev/shm")
    before_shared = set(shared.glob("*"))
    (lab / "tmp").mkdir()
    sweep = write_sweep(lab / "moods.yaml", sweep_of([{"pause": 0.2}], 100, block=1))
    command = [sys.executable, "-m", "wsnsim", "sweep", sweep, "-o", "c", "-j", "1"]
    driver = subprocess.Popen(
        command,
        env=environment(TMPDIR=str(lab / "tmp")),
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGHUP, signal.SIG_DFL),  # tests may run under nohup
    )
    wait_for(lambda: files_of(Path("c")), 120)
    workers, before = children(driver.pid), len(files_of(Path("c")))
    os.killpg(driver.pid, number)
    _, said = driver.communicate(timeout=60)
    assert driver.returncode == code
    assert "Traceback" not in said and resume_of(said) == ["sweep", "c", "--jobs", "1", "--plugins"]
    assert len(files_of(Path("c"))) > before and not list(Path("c").rglob("*.tmp"))
    wait_for(lambda: not any(map(lives, workers)))
    assert not list((lab / "tmp").iterdir())
    assert not [made for made in set(shared.glob("*")) - before_shared if str(driver.pid) in made.name]


@pytest.mark.thorough
def test_a_reader_of_progress_that_goes_away_does_not_end_the_campaign(sweep: str) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    script = (
        "import sys; from wsnsim.campaign import engines; from tests.campaign.inline_engine import InlineEngine;"
        "engines.LocalEngine = InlineEngine; from wsnsim.cli import main; sys.exit(main(sys.argv[1:]))"
    )
    command = [sys.executable, "-c", script, "sweep", sweep, "--progress", "json"]
    done = subprocess.run(command, env=environment(), text=True, check=False, stdout=subprocess.PIPE, stderr=writer)
    os.close(writer)
    assert done.returncode == 0 and done.stdout


@pytest.mark.thorough
def test_a_sweep_does_nothing_that_starts_a_thread_before_its_workers(sweep: str) -> None:
    """pandas may do so, by way of pyarrow: workers would then be spawned, and each would import everything."""
    script = (
        "import sys; from wsnsim.campaign import engines as local; copied = local._can_be_copied;"
        "local._can_be_copied = lambda: print('pandas' in sys.modules, copied()) or copied();"
        "from wsnsim.cli import main; sys.exit(main(sys.argv[1:]))"
    )
    command = [sys.executable, "-c", script, "sweep", sweep, "--quiet", "--replicates", "1"]
    done = subprocess.run(command, env=environment(), text=True, check=True, stdout=subprocess.PIPE)
    assert done.stdout.startswith(f"False {sys.platform == 'linux'}\n")


# disks


Mount = Callable[[str], None]


@pytest.fixture
def disk(lab: Path) -> Iterator[tuple[Path, Mount]]:
    """A small file system, and a function that remounts it with other options."""
    place = lab / "disk"
    place.mkdir()

    def mount(options: str) -> None:
        done = subprocess.run(
            ["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(place)], capture_output=True, text=True
        )
        if done.returncode:
            pytest.skip(f"no file system can be mounted here: {done.stderr.strip()}")

    def again(options: str) -> None:
        subprocess.run(["mount", "-o", f"remount,{options}", str(place)], check=True)

    if not hasattr(os, "geteuid") or os.geteuid() != 0:
        pytest.skip("only root mounts file systems")
    mount("size=4300k")
    try:
        yield place, again
    finally:
        subprocess.run(["umount", "-l", str(place)], check=True)


@pytest.mark.thorough
def test_a_full_disk_ends_the_campaign_which_goes_on_when_there_is_room(
    sweep: str, disk: tuple[Path, Mount], capsys: pytest.CaptureFixture[str]
) -> None:
    place, mount = disk
    assert main(["sweep", sweep, "--replicates", "20", "-q", "-o", str(place / "c")]) == 3
    said = capsys.readouterr().err
    assert "error: the campaign was stopped: " in said and "less than 4 MB are free on the disk" in said
    before = files_of(place / "c")
    assert before and not list(place.rglob("*.tmp"))
    mount("size=20m")
    assert main([*resume_of(said), "-q"]) == 0
    assert before.items() < files_of(place / "c").items()


@pytest.mark.thorough
def test_a_folder_that_takes_nothing_is_refused(
    sweep: str, disk: tuple[Path, Mount], capsys: pytest.CaptureFixture[str]
) -> None:
    place, mount = disk
    mount("size=10m")
    assert main(["sweep", sweep, "-q", "-o", str(place / "c")]) == 0
    mount("ro")
    capsys.readouterr()
    assert main(["sweep", str(place / "c"), "-q"]) == 0 and "RMSE" in capsys.readouterr().out, "it is complete"
    assert main(["sweep", sweep, "-o", str(place / "d")]) == 2
    assert f"wsnsim: error: cannot write {place / 'd'}: Read-only file system\n" == capsys.readouterr().err
    assert main(["collect", str(place / "c"), "-o", "copy"]) == 0


@pytest.mark.thorough
def test_what_a_killed_campaign_with_a_rule_has_done_is_shown_and_what_it_lacks_is_known(
    sweep: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """The files alone hold the progress: the stopping rule decides again."""
    rule: dict[str, Any] = {"metric": "rmse", "half_width": 1e-9, "at_least": 2, "at_most": 6}
    ruled = write_sweep(Path("ruled.yaml"), sweep_of(CALM, until=rule, block=1))
    assert main(["sweep", ruled, "-q", "-o", "c"]) == 0
    last = max(Path("c").glob("*/r*.h5"))
    last.unlink()
    assert len(wsnsim.read("c", "runs")) == 11
    capsys.readouterr()
    assert main(["collect", "c", "-o", "all"]) == 3
    assert "replicates 5" in capsys.readouterr().err
    assert main(["info", "c"]) == 0
    assert "11 of 12 done" in capsys.readouterr().out
