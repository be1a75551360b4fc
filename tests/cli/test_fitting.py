"""The command that fits a law: files are written, and wrong use is said."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.helpers.recorded_walks import Walks
from wsnsim.cli import main
from wsnsim.scenario import load
from wsnsim.scenario.texts import shipped


@pytest.fixture(scope="module")
def walks(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[str], str]:
    return Walks(tracks=3).write(tmp_path_factory.mktemp("walks"), 4)


def test_the_block_that_is_written_loads_in_a_scenario_that_extends_it(
    walks: tuple[list[str], str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files, nodes = walks
    sensor, figure = tmp_path / "sensor.yaml", tmp_path / "residuals.svg"
    arguments = ["fit", *files[:2], "--nodes", nodes, "--test", files[2], "--noise", "normal"]
    assert main([*arguments, "--out", str(sensor), "--plot", str(figure)]) == 0
    assert "z0" in capsys.readouterr().out
    assert figure.stat().st_size > 10_000
    scenario = tmp_path / "mine.yaml"
    scenario.write_text(
        "extends: sensor.yaml\nname: mine\nnetwork: none\nduration: 4 s\nstep: 1 s\n"
        "deploy: {kind: file, path: " + nodes + ", width: 40 m, height: 40 m, centre: [10 m, 10 m], cover: false}\n"
        "motion: {kind: waypoints, points: [[0, 1, 1], [9, 5, 5]]}\ntracker: {kind: pf}\n"
    )
    assert load(str(scenario)).sensor.kind == "rssi"


def test_the_block_for_recorded_readings_runs_on_them_and_not_on_those_that_were_fitted(
    walks: tuple[list[str], str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files, nodes = walks
    sensor = tmp_path / "sensor.yaml"
    arguments = ["fit", *files[:2], "--nodes", nodes, "--noise", "normal", "--out", str(sensor), "--readings"]
    assert main([*arguments, files[0]]) == 2
    assert "the law was fitted to these readings; give others" in capsys.readouterr().err
    assert not sensor.exists()
    assert main([*arguments, files[2]]) == 0
    scenario = tmp_path / "mine.yaml"
    scenario.write_text(
        "extends: sensor.yaml\nname: mine\nnetwork: none\nduration: 4 s\nstep: 1 s\n"
        "deploy: {kind: file, path: " + nodes + ", width: 40 m, height: 40 m, centre: [10 m, 10 m], cover: false}\n"
        "motion: {kind: recorded_track, path: " + files[2] + "}\ntracker: {kind: pf}\n"
    )
    assert main(["run", str(scenario), "--out", str(tmp_path / "x.h5"), "--quiet"]) == 0


def test_json_is_one_object_with_train_and_test(
    walks: tuple[list[str], str], capsys: pytest.CaptureFixture[str]
) -> None:
    files, nodes = walks
    assert main(["fit", *files[:2], "--nodes", nodes, "--test", files[2], "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert [file["path"] for file in answer["train"]["files"]] == files[:2]
    assert [file["path"] for file in answer["test"]] == files[2:]
    assert answer["values"]["eta"]["low"] < answer["sensor"]["eta"] < answer["values"]["eta"]["high"]


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["--test", "{0}"], "must not be judged on what it was fitted to"),
        (["--column", "reading"], "--column reading: must be OURS=THEIRS"),
        (["--column", "redding=x"], "unknown column 'redding' (did you mean 'reading'?)"),
        (["--out", "{0}"], "is one of the files that are read"),
        (["--plot", "x.bmp"], "a figure cannot have the suffix '.bmp'"),
        (["--readings", "{2}"], "--readings goes with --out"),
        (["--block", "-1"], "block: must be a positive number of seconds"),
        (["--law", "bearing"], "law bearing cannot be fitted: a bearing is an angle"),
        (["--law", "rsi"], "unknown law 'rsi' (did you mean 'rssi'?)"),
        (["--noise", "norml"], "did you mean 'normal'?"),
        (["--seed", "ten"], "'ten' is not a whole number of at least 0"),
        (["--frame", "ten"], "'ten' is not a whole number of 1 to 127"),
    ],
)
def test_wrong_use_is_said_in_one_message(
    walks: tuple[list[str], str], more: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    files, nodes = walks
    assert main(["fit", *files, "--nodes", nodes, *(word.format(*files) for word in more)]) in (1, 2)
    assert said in capsys.readouterr().err


@pytest.mark.thorough
def test_fitted_links_are_written_as_a_block_that_loads(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    links = next(iter(shipped().values())).parent / "recorded" / "links" / "grenoble_first_half.k7.gz"
    block = tmp_path / "link.yaml"
    assert main(["fit", str(links), "--law", "log_normal", "--out", str(block), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["written"] == [str(block)]
    scenario = tmp_path / "mine.yaml"
    scenario.write_text("extends: ekf_real\nname: mine\n" + block.read_text())
    link = load(str(scenario)).link
    assert (link.kind, link.sensitivity) == ("log_normal", answer["link"]["sensitivity"])
    assert main(["fit", str(links), "--law", "log_normal", "--gains"]) == 2
    assert "unknown option 'gains'" in capsys.readouterr().err
