"""`wsnsim reproduce`: the rule of the verdicts, the rows of a real campaign, interruption and resumption."""

from __future__ import annotations

import json
import math
import re
import shutil
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import wsnsim
from tests.campaign.inline_engine import InlineEngine
from tests.campaign.moody_tracker import write_moody_tracker
from tests.campaign.processes import wait_for
from tests.helpers.full_disk import FullDisk
from wsnsim import bounds
from wsnsim.analysis import statistics
from wsnsim.base import metrics
from wsnsim.base.errors import UsageError
from wsnsim.cli import main
from wsnsim.papers import measures, reproduce, reproduction, table
from wsnsim.papers.counts import outcome_line
from wsnsim.papers.reproduction import Claim, ClaimRow, Experiment, Losses, Variant
from wsnsim.papers.study import study
from wsnsim.papers.verdicts import AstrayShare, Judgement

NAN = float("nan")
KEYS = {"paper", "experiment", "quantity", "variant", "published", "measured", "low", "high", "replicates",
        "lost_fraction", "bound", "bound_kind", "verdict", "reason", "caution", "read", "literal", "statistic", "basis",
         "published_runs", "published_runs_assumed", "ratio_low", "ratio_high", "within", "undecidable", "counted",
         "paired", "reading", "where", "astray", "astray_low", "astray_high", "median", "median_low", "median_high",
         "reacquired", "losses", "time_lost",
        "lost_rule", "kind"}  # fmt: skip
SHORT = ("duration=16 s",)
SMALL = Experiment(
    name="small",
    title="two filters along a line, for tests",
    variants={
        "rkf": Variant("rkf"),
        "imsf": Variant("imsf"),
        "ekf": Variant("rkf", ("tracker={kind: ekf}", "sensor.beyond=silent")),
    },
    quick=6,
    full=8,
    claims=(
        Claim("RMSE, m", "rkf", "rmse", 0.4, "figure 1", "per_trajectory", "because"),
        Claim("RMSE of a run, median, m", "imsf", "median:rmse", None, "", "variant:ekf"),
        Claim("tracks lost, share", "imsf", "share:lost", 0.0),
        Claim("RMSE of a run", "ekf", "rmse", where="figure 1", reason="it knows who is in range", other="rkf"),
        Claim("share less", "ekf", "less_than:rkf", 0.5, literal=False),
        Claim("over", "ekf", "over:rkf", 0.6, read=True),
        Claim("seconds", "rkf", "mean:cpu_seconds", 50.0, judged=False),
        Claim("RMSE of the tracks kept", "imsf", "rmse_of_kept"),
        Claim("operations", "rkf", "mean:cycles"),
        Claim("RMSE of vx", "rkf", "column:vx", 1e-9, "", "unconditional"),
    ),
    record=("truth", "estimates"),
    sets=SHORT,
    block=2,
)  # fmt: skip


@pytest.fixture
def papers(monkeypatch, tmp_path):
    """The small experiment in place of those of every paper, in a folder of its own."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(reproduce, "experiments", lambda paper: (SMALL,))
    monkeypatch.setattr(reproduce, "LocalEngine", InlineEngine)


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """The folder of the small experiment's finished campaign."""
    where = tmp_path_factory.mktemp("done")
    ended = reproduce.resume(
        reproduce.begin("liu2012", SMALL, where), 1
    )  # in a process of its own: the others are in this one
    assert ended.complete and ended.done == 18
    return where


@pytest.mark.thorough
def test_rows_are_what_the_tables_of_the_campaign_hold(done):
    folder = reproduce.folder_of(done, "liu2012", SMALL)
    runs = wsnsim.read(folder, "runs").set_index(["variant", "replicate"])
    errors = {
        name: frame.sort_values(["replicate", "step"])["error"].to_numpy().reshape(6, 15)
        for name, frame in wsnsim.read(folder, "estimates").groupby("variant")
    }
    found = reproduce.rows("liu2012", SMALL, folder)
    rows = {row.quantity: row for row in found if not row.paired}
    assert rows["RMSE, m (figure 1)"].measured == pytest.approx(metrics.time_mean_rmse(errors["rkf"]), rel=1e-12)
    assert rows["RMSE of a run, median, m"].measured == np.median(runs.loc["imsf", "rmse"])
    less = 1 - metrics.time_mean_rmse(errors["ekf"]) / metrics.time_mean_rmse(errors["rkf"])
    assert rows["share less"].measured == pytest.approx(less, rel=1e-12)
    assert rows["over"].measured == pytest.approx(1.0 - less, rel=1e-12) and rows["over"].read
    assert rows["seconds"].verdict == "not judged" and not rows["share less"].literal
    kept = rows["RMSE of the tracks kept"]
    whole = (runs.loc["imsf", "losses"] == 0).to_numpy()
    assert kept.replicates == whole.sum()
    assert kept.measured == pytest.approx(metrics.time_mean_rmse(errors["imsf"][whole]), rel=1e-12)
    order, beside = (row for row in found if row.quantity == "RMSE of a run minus that of rkf (figure 1)")
    between = metrics.time_mean_rmse(errors["ekf"]) - metrics.time_mean_rmse(errors["rkf"])
    assert order.measured == pytest.approx(between, rel=1e-12) and not order.paired
    pairs = runs.loc["ekf", "rmse"] - runs.loc["rkf", "rmse"]
    assert beside.measured == pytest.approx(np.median(pairs), rel=1e-9) and beside.paired and not beside.counted
    assert rows["operations"].measured == runs.loc["rkf", "cycles"].mean()
    lost = rows["tracks lost, share"]
    assert (lost.measured, lost.low, lost.high) == tuple(statistics.share(runs.loc["imsf", "lost"].to_numpy() > 0))[:3]
    both = wsnsim.read(folder, "truth").merge(wsnsim.read(folder, "estimates"), on=["variant", "replicate", "step"])
    off = both[both["variant"] == "rkf"]
    assert rows["RMSE of vx"].measured == pytest.approx(metrics.rmse((off.vx_x - off.vx_y).to_numpy()), rel=1e-12)


@pytest.mark.thorough
def test_the_bound_beside_a_row_is_that_of_its_scenario_and_says_whether_it_is_strict(done):
    folder = reproduce.folder_of(done, "liu2012", SMALL)
    rows = {row.quantity: row for row in reproduce.rows("liu2012", SMALL, folder)}
    along = bounds.bound({"extends": "scenarios/rkf.yaml", "duration": 16}, range(6), "per_trajectory")
    assert rows["RMSE, m (figure 1)"].bound == along.time_mean
    assert rows["RMSE, m (figure 1)"].bound_kind == "per_trajectory, not strict"
    assert rows["operations"].bound_kind == "" and math.isnan(rows["operations"].bound)
    best = measures.measured(measures.Data(measures.Folder(folder)), "ekf", "median:rmse")
    assert rows["RMSE of a run, median, m"].bound == best.low
    assert "lower end of the measured 95 % interval of 'ekf'" in rows["RMSE of a run, median, m"].caution
    speed = rows["RMSE of vx"]
    over = bounds.bound({"extends": "scenarios/rkf.yaml", "duration": 16}, range(measures.TRUTHS))
    strict = not over.cautions
    assert speed.bound == np.sqrt(np.mean(over.columns[:, 1] ** 2))
    assert speed.verdict == ("cannot: beyond the bound" if strict else "too few runs")
    assert bool(speed.caution) != strict and speed.bound > 1e-9


@pytest.mark.thorough
def test_a_measure_that_is_none_is_named(done):
    data = measures.Data(measures.Folder(reproduce.folder_of(done, "liu2012", SMALL)))
    with pytest.raises(KeyError, match="no measure is called 'rmsee'"):
        measures.measured(data, "rkf", "rmsee")


@pytest.mark.thorough
def test_a_damaged_file_is_put_aside_and_run_again_and_so_is_a_damaged_scenario(done, papers, capsys):
    shutil.copytree(done, "r/quick")
    same = ["reproduce", "liu2012", "--json", "-q", "-o", "r"]
    assert main(same) == 0
    before = json.loads(capsys.readouterr().out)["rows"]
    cut, flipped = sorted(Path("r").rglob("*.h5"))[:2]
    cut.write_bytes(cut.read_bytes()[:3000])
    content = bytearray(flipped.read_bytes())
    at = len(content) // 2
    content[at : at + 4000] = bytes(255 - byte for byte in content[at : at + 4000])
    flipped.write_bytes(content)
    sorted(Path("r").rglob("scenario.json"))[0].write_text("{")
    assert main(same) == 0
    said = capsys.readouterr()
    drop = "seconds"
    assert [row for row in json.loads(said.out)["rows"] if row["quantity"] != drop] == [
        row for row in before if row["quantity"] != drop
    ]
    assert f"{cut}.damaged: is damaged and was set aside" in said.err
    assert len(list(Path("r").rglob("*.damaged"))) == 2


@pytest.mark.thorough
def test_what_has_been_run_is_not_run_again_and_the_same_is_found_elsewhere(done, papers, capsys):
    shutil.copytree(done, "r/quick")
    files = {path: path.stat().st_mtime_ns for path in Path("r").rglob("*.h5")}
    again = ["reproduce", "liu2012", "-q", "--json", "-j", "1"]
    assert main([*again, "-o", "r"]) == 0
    first = json.loads(capsys.readouterr().out)
    assert {path: path.stat().st_mtime_ns for path in Path("r").rglob("*.h5")} == files
    assert main([*again, "-o", "elsewhere"]) == 0
    second = json.loads(capsys.readouterr().out)
    for answer in (first, second):
        answer["rows"] = [row for row in answer["rows"] if row["quantity"] != "seconds"]
    assert second == first
    assert [set(row) for row in first["rows"]] == [KEYS] * len(SMALL.claims)  # one is not there, one has two rows
    assert {row["replicates"] for row in first["rows"]} == {6}


@pytest.mark.thorough
def test_a_full_run_is_another_campaign_of_as_many_replicates_as_it_says(papers, capsys):
    assert main(["reproduce", "liu2012", "--full", "-q", "--json"]) == 0
    assert {row["replicates"] for row in json.loads(capsys.readouterr().out)["rows"]} == {8}
    assert Path("results/reproduce/full/liu2012/small").is_dir()


def test_in_words_there_are_reasons_verdicts_and_the_rule(done, papers, capsys):
    shutil.copytree(done, "results/reproduce/quick")
    assert main(["reproduce", "liu2012", "--progress", "none"]) == 0
    said = capsys.readouterr()
    what, where = "1 experiment of liu2012: 18 runs", "folder results/reproduce/quick"
    assert f"wsnsim: {what}, 18 of them on disk; {where}\n" in said.err
    assert "1 of 1: liu2012, small: two filters along a line, for tests\n" in said.err
    assert "      because\n" in said.out and "  too few runs: however far it is from the published value" in said.out
    assert (
        "liu2012: 3 printed numbers: " in said.out
        and "not counted (a repair or another reading of the paper)" in " ".join(said.out.split())
    )
    assert "(per_trajectory, not strict)" in said.out and "published about 0.6;" in said.out
    last = re.findall("^liu2012, small: .*", said.out, re.MULTILINE)[-1]
    assert re.search(r"undecided, 5 counted; 6 of 8 runs; `--full` makes all( in about \d+ s)?$", last)


@pytest.mark.thorough
def test_progress_that_cannot_be_printed_ends_no_reproduction(done, papers, monkeypatch, capsys):
    shutil.copytree(done, "results/reproduce/quick")
    next(Path("results").rglob("*.h5")).unlink()
    monkeypatch.setattr("wsnsim.cli.end_stderr", lambda: None)  # it would close the stderr of these tests
    monkeypatch.setattr(sys, "stderr", FullDisk())
    assert main(["reproduce", "liu2012", "--progress", "plain", "-j", "1"]) == 0
    assert "liu2012: 3 printed numbers: " in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["liu2021"], "there is no paper or study 'liu2021' (did you mean 'liu2012'?)"),
        (["liu2012", "--only", "smal"], "liu2012 has no experiment 'smal' (did you mean 'small'?)"),
        (["liu2012", "--json", "--markdown"], "cannot be combined"),
        (["liu2012", "--quick", "--full"], "--quick cannot be combined with --full"),
        (["liu2012", "--figures", "file"], "--figures file is a file; give a folder"),
        (["liu2012", "--figures", "file/figures"], "--figures file/figures: folder does not exist: file"),
        (["liu2012", "--figures", "no/figures"], "--figures no/figures: folder does not exist: no"),
        (["liu2012", "-o", "file/results"], "file/results"),
        (["liu2012", "-j", "0"], "0 is not in the range"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_runs(arguments, words, monkeypatch, tmp_path, capsys):
    known = reproduce.experiments
    monkeypatch.setattr(reproduce, "experiments", lambda paper: known(paper) and (SMALL,))
    monkeypatch.chdir(tmp_path)
    Path("file").write_text("no folder")
    assert main(["reproduce", "--progress", "none", *arguments]) == 2
    assert words in capsys.readouterr().err
    assert not list(tmp_path.rglob("*.h5")) and {path.name for path in tmp_path.iterdir()} == {"file"}


@pytest.mark.thorough
def test_a_run_that_fails_leaves_its_experiment_out_and_the_exit_code_says_so(papers, tmp_path, capsys, monkeypatch):
    write_moody_tracker(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    wrong = Variant("ungm_pf", ("tracker={kind: moody:Moody, mood: raises, at: 2}",))
    bad = replace(SMALL, name="bad", variants={"bad": wrong}, claims=(), sets=("duration=3 s",))
    monkeypatch.setattr(reproduce, "experiments", lambda paper: (bad, SMALL))
    assert main(["reproduce", "liu2012", "--json", "--progress", "none"]) == 3
    said = capsys.readouterr()
    assert {row["experiment"] for row in json.loads(said.out)["rows"]} == {"small"}
    assert "bad is incomplete" in said.err and "out of sorts" in said.err


@pytest.mark.thorough
def test_when_it_is_stopped_the_same_command_goes_on(tmp_path):
    command = [sys.executable, "-m", "wsnsim", "reproduce", "liu2012", "--only", "readings", "-j", "1", "-q", "--json"]
    process = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    wait_for(lambda: list(tmp_path.rglob("*.h5")), 60.0)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130 and out == "" and "repeat the command" in err
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.h5")}
    assert 0 < len(before) < 6 and not list(tmp_path.rglob("*.tmp"))
    gone_on = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert gone_on.returncode == 0 and gone_on.stderr == ""
    assert {row["replicates"] for row in json.loads(gone_on.stdout)["rows"]} == {10}
    assert before.items() <= {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.h5")}.items()


def row(**more):
    experiment = study("jiang2013").experiments[0]
    claim = experiment.claims[0]
    basis = ClaimRow(
        claim.label, "a_b", 2.0, 1.5, 1.0, 2.0, 10, 0.1, 0.5, "unconditional", Judgement("reproduces", 0.95, 1.05),
        "because", paper="jiang2013", experiment=experiment.name, id=claim.id, key=claim.key,
    )  # fmt: skip
    return replace(basis, **more)


def test_markdown_has_a_row_for_each_claim_with_its_readings_and_nothing_in_them_is_markup():
    again = row(experiment="other", measured=3.0, judgement=Judgement("does not reproduce", 1.4, 1.6))
    silent = [row(paired=True), row(literal=False), row(judgement=Judgement("not published"))]
    derived, ours = row(where="from table 1"), row(id="x", key="a_b", basis="our constant")
    said = table.markdown([row(), again, *silent, derived, ours]).splitlines()
    first, second = (line.partition(" (figure 9) | 2 | ") for line in said[2:4])
    assert first[0] == r"| a\_b: RMSE, m" and second[0] == r"| a\_b: RMSE, m"
    apart = "(reproduced under 1 of 2, contradicted under 1 of 2)"
    assert first[2] == f"1.5 to 3 | dependent on the reading {apart} |"
    assert second[2] == "1.5 [1, 2] | reproduced (our constant) |" and said[4] == ""
    assert said[5].startswith("- jiang2013: 1 printed number: 1 dependent on the reading; 1 derived (not counted)")
    assert said[6].startswith("- (our constant): the value") and len(said) == 7


def test_markdown_of_a_study_that_judges_nothing_has_all_its_rows_and_an_order_is_written_as_one():
    said = table.markdown([row(judgement=Judgement("not published"))], ["registered: yes"])
    assert "| not published |" in said and said.endswith("- registered: yes")
    claim = Claim("RMSE, m", "a", "rmse", where="figure 1", other="b")
    order = row(quantity=claim.label, key=claim.key, variant="a", published=NAN)
    assert "| a: RMSE minus that of b, m (figure 1) | below 0 |" in table.markdown([order])
    assert "a: RMSE minus that of b, m (figure 1): reproduces\n    published below 0;" in table.text([order])


def test_a_bound_that_is_not_strict_is_marked_in_the_table_and_its_caution_stands_beneath():
    careful = row(bound_kind="unconditional, not strict", caution="one; two")
    said = table.text([careful, row(bound=NAN, bound_kind="", published=NAN, judgement=Judgement("not published"))])
    assert "bound 0.5 (unconditional, not strict)" in " ".join(said.split()) and said.count("of the bound: ") == 2
    assert "…" not in said and max(map(len, said.splitlines())) <= 100, "whole cells, in lines of a terminal"
    assert table.text([]) == ""


def test_runs_behind_a_published_value_that_we_assume_are_shown_as_assumed():
    said = [row(published_runs=100, published_runs_assumed=assumed, replicates=200) for assumed in (True, False)]
    expected = ["200 (paper: 100, which we assume)", "200 (paper: 100)"]
    assert [table.cells(each)["runs"] for each in said] == expected
    assert table.cells(row(published_runs_assumed=True))["runs"].isdigit()


def test_a_row_shows_its_statistic_its_runs_the_share_astray_and_what_it_rests_on():
    full = row(
        statistic="mean over runs", published_runs=50, replicates=200, losses=Losses(1.5),
        astray=AstrayShare(0.02, 0.001, 0.07), basis="reconstruction", judgement=Judgement("compatible", 0.6, 1.25),
    )  # fmt: skip
    found = table.cells(full)
    assert found["statistic"] == "mean over runs" and found["runs"] == "200 (paper: 50)"
    assert found["astray (above 5 times the median)"] == "2 % [0.1, 7]"
    assert found["lost at any time"] == "10 % of runs (1.5 re-acquisitions a run)"
    assert ": compatible within x 1.67, not counted (reconstruction)\n" in table.text([full])
    said = "\n".join(table.legend([full]))
    assert all(f"  {word}: " in said for word in ("(reconstruction)", "bound", "compatible"))
    assert "not strict" not in said and "about: " not in said, "what does not occur"


def test_when_a_track_is_lost_stands_below_every_table_with_shares_of_lost_runs():
    rules = ["error above 20 m or no estimate for 4 s", "no estimate for 1 s"]
    rows = [row(losses=Losses(lost_rule=rules[0])), row(losses=Losses(lost_rule=rules[1]), paper="li2012")]
    expected = [f"lost (jiang2013): {rules[0]}, at any time", f"lost (li2012): {rules[1]}, at any time"]
    assert all(words in table.text(rows) for words in expected)
    assert "lost (" not in table.text([row(losses=Losses(lost_rule=rules[0]), lost_fraction=NAN)])


def test_a_value_that_no_run_has_is_said_to_be_unknown_in_its_row_and_in_reasons():
    nowhere = row(measured=NAN, low=NAN, high=NAN, replicates=0, lost_fraction=1.0, judgement=Judgement("too few runs"))
    found = table.cells(nowhere)
    assert found["measured [95 %]"] == "no value in any run" and found["runs"] == "0"
    assert found["lost at any time"] == "100 %"
    words = reproduction.rendered("{x[a].measured:.1f} m against {row.measured:.1f} m", nowhere, {"x": {"a": row()}})
    assert words == "1.5 m against unknown m"


def test_rows_are_counted_by_what_they_rest_on():
    bases = ["evidence", "evidence", "reconstruction", "construction", "our constant"]
    rows = [*(row(basis=basis) for basis in bases), row(literal=False), row(paired=True)]
    said = " ".join(table.text(rows).split())
    assert "jiang2013: 1 printed number: " in said and "2 readings counted at most" in said, "rows of the same number"
    for why in (*bases[2:], "a repair or another reading of the paper", "paired by run, not as published"):
        assert said.count(f"reproduces, not counted ({why})") == 1
    assert [one.counted for one in rows] == [True, True, *[False] * 5]
    assert outcome_line(rows) == "4 reproduced, 1 counted" and outcome_line(rows[2:3]) == "1 reproduced, none counted"
    assert outcome_line(rows[-1:]) == "nothing is judged"


def test_of_a_figure_only_its_claims_and_its_picture_are_left():
    ((_, found),) = reproduce.chosen(["jiang2013"], "figure_9")
    assert (found.name, [figure.name for figure in found.figures]) == ("figures_4_to_9", ["figure_9"])
    shown = [claim for claim in found.claims if claim.shown]
    assert {claim.where for claim in shown} == {"figure 9"} and len(shown) == 6
    whole = study("jiang2013").experiments[0]
    assert len(found.claims) == len(whole.claims) and found.variants == whole.variants, "reasons name other rows"
    assert reproduce.chosen(["jiang2013"], "figures_4_to_9") == [("jiang2013", whole)]
    wheres = {
        name: {claim.where for _, one in reproduce.chosen([paper], name) for claim in one.claims if claim.shown}
        for paper, name in (("jiang2013", "figure_2"), ("wei2022", "figure_2"), ("li2012", "figure_3_every_10_s"))
    }
    assert not wheres["figure_2"] - {"figures 1 to 4"} and "text of figure 3" in wheres["figure_3_every_10_s"]
    ((_, own),) = reproduce.chosen(["late"], "late")
    assert own == study("late").experiments[0], "it has the name of its figure"
    ((_, own),) = reproduce.chosen(["reality"], "residuals")
    assert own.claims == study("reality").experiments[0].claims, "a study's own figure is of all its claims"
    assert [figure.name for figure in own.figures] == ["residuals"]
    ((_, own),) = reproduce.chosen(["reality"], "tracks")
    assert [figure.name for figure in own.figures] == ["tracks", "residuals", "gap"]


def test_no_experiment_is_named_twice_and_each_paper_has_its_pictures():
    numbers = {"jiang2013": range(2, 10), "liu2012": range(1, 5), "wei2022": range(1, 12), "ruan2020": (1, 2, 4, 5)}
    numbers["li2012"] = range(3, 7)
    for name, figures in numbers.items():
        found = reproduce.experiments(name)
        assert len({each.name for each in found}) == len(found)
        names = {figure.name for each in found for figure in each.figures}
        assert {f"figure_{number}" for number in figures} <= names
    with pytest.raises(UsageError, match="did you mean 'frontier'"):
        reproduce.experiments("fronteer")
