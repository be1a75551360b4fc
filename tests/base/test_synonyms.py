"""Suggestions by meaning: the words that users bring from the field lead to the names of wsnsim."""

from __future__ import annotations

from pathlib import Path

import pytest

from wsnsim.base.errors import did_you_mean, meant_by, nearest, synonyms
from wsnsim.base.tables import TABLES
from wsnsim.cli import main
from wsnsim.cli.shared import every_command
from wsnsim.scenario.fields import names_of
from wsnsim.scenario.registry import ROLES, kinds, load_class


@pytest.mark.parametrize(
    ("word", "known", "meant"),
    [
        ("turn_rate", ["px", "vx", "py", "vy", "turn"], ["turn"]),
        ("turn_rate", ["kind", "q", "start", "turn_q"], ["turn_q", "start"]),
        ("unscented", kinds("tracker"), ["ukf", "ckf"]),
        ("UnscentedKalmanFilter", kinds("tracker"), ["ukf", "ckf"]),
        ("kalman", kinds("tracker"), ["ekf", "ukf", "ckf"]),
        ("particle filter", kinds("tracker"), ["pf", "central_pf"]),
        ("camera", kinds("sensor"), ["bearing", "range_bearing"]),
        ("AoA", kinds("sensor"), ["bearing", "range_bearing"]),
        ("gps", kinds("sensor"), ["coordinate"]),
        ("gps", kinds("deploy"), ["file"]),
        ("TOA sensor", kinds("sensor"), ["range"]),
        ("time difference of arrival", kinds("sensor"), ["tdoa"]),
        ("noise", ["kind", "sd", "reach"], ["sd"]),
        ("noise", ["kind", "q", "start"], ["q"]),
        ("battery", ["energy", "energy_left", "node"], ["energy", "energy_left"]),
        ("duty-cycle", kinds("sleep"), ["duty_cycle"]),
        ("duty cycling", kinds("sleep"), ["duty_cycle"]),
        ("CT", kinds("motion"), ["coordinated_turn"]),
        ("constant velocity", kinds("motion"), ["constant_velocity"]),
        ("X-MAC", kinds("mac"), ["xmac"]),
        ("802.15.4", kinds("mac"), ["csma"]),
        ("lognormal", kinds("link"), ["log_normal"]),
        ("range", ["kind", "reach", "sd"], ["reach"]),
        ("mobility", list(ROLES), ["motion"]),
        ("simulate", ["run", "check", "list"], ["run"]),
        ("pdr", ["delivered", "rmse"], ["delivered"]),
        ("latency", ["delay", "report_delay", "rmse"], ["delay", "report_delay"]),
        ("pso_mhfp", kinds("tracker"), ["pso_mhpf"]),
        ("gird", kinds("deploy"), ["grid"]),
        ("zzz", kinds("deploy"), []),
    ],
)
def test_a_word_of_the_field_leads_to_what_it_means(word: str, known: list[str], meant: list[str]) -> None:
    assert nearest(word, sorted(known)) == meant


def test_the_message_names_what_is_meant_or_else_what_is_known() -> None:
    assert did_you_mean("kalman", ["ekf", "ukf"]) == "did you mean 'ekf' or 'ukf'?"
    assert did_you_mean("zzz", ["ekf", "ukf"]) == "known: ekf, ukf"
    assert did_you_mean("zzz", ["ekf"], "see the list") == "see the list"


def test_every_name_in_the_tables_is_a_kind_a_key_a_command_or_a_column() -> None:
    names = {"motion", "extends", "targets", "faults", "assumes", "noise_scale", *ROLES, *every_command(), "watch"}
    names |= {"seed", "replicates", "step", "duration", "record", "name", "out", "overrides", "workers"}
    for role in ROLES.values():
        for row in role.kinds:
            part = load_class(row)
            columns = getattr(part, "columns", ())
            names |= {row.kind, *names_of(part), *(columns if isinstance(columns, tuple) else ())}
    names |= {column.name for columns in TABLES.values() for column in columns}
    meant = {name for candidates in synonyms().values() for name in candidates}
    assert meant <= names, sorted(meant - names)


def test_a_known_word_is_not_replaced_and_an_unknown_one_gets_nothing() -> None:
    assert meant_by("range", ["range", "reach"]) == []
    assert meant_by("", ["range"]) == []


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ("sensor: {kind: camera}", "unknown sensor 'camera' (did you mean 'bearing' or 'range_bearing'?)"),
        ("sensor: {kind: range, noise: 2}", "sensor.noise: unknown key, did you mean 'sd'?"),
        ("link: {kind: disk, range: 60 m}", "link.range: unknown key, did you mean 'reach'?"),
        ("motion: {kind: coordinated_turn, turn_rate: 1}", "unknown key, did you mean 'turn_q' or 'start'?"),
        ("mobility: {kind: waypoints}", "mobility: unknown key, did you mean 'motion'"),
        ("motion: {kind: ct}", "unknown motion 'ct' (did you mean 'coordinated_turn'?)"),
    ],
)
@pytest.mark.usefixtures("fresh_folder")
def test_the_messages_of_check_suggest_by_meaning(lines: str, message: str, capsys: pytest.CaptureFixture[str]) -> None:
    Path("x.yaml").write_text(f"extends: jiang_field\nname: x\n{lines}\n")
    assert main(["check", "x.yaml"]) == 2
    assert message in capsys.readouterr().err


def test_an_unknown_command_suggests_by_meaning(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate"]) == 2
    assert "unknown command 'simulate' (did you mean 'run'?)" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("word", "role"),
    [("filters", "trackers"), ("mobility", "motions"), ("channel", "links")],
)
def test_an_unknown_role_suggests_by_meaning(word: str, role: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list", word]) == 2
    assert f"unknown role '{word}' (did you mean '{role}'?)" in capsys.readouterr().err
