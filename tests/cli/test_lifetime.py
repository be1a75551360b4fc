"""`wsnsim lifetime` and `wsnsim.lifetime`: what they answer, keep, refuse and draw."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest

import wsnsim
from wsnsim.analysis import lifetime_plots, lifetime_result, lifetime_text
from wsnsim.api.lifetime import LifetimeResult
from wsnsim.cli import main
from wsnsim.cli.lifetime import lifetime
from wsnsim.scenario.lifetime import AskedLifetime

NETWORK: dict[str, Any] = {
    "extends": "gmtt", "name": "small", "duration": "20 s", "step": "2 s",
    "deploy": {"kind": "uniform", "nodes": 16, "width": "60 m", "height": "60 m", "cover": False},
    "motion": {"kind": "random_waypoint", "width": "60 m", "height": "60 m"},
    "energy": {"battery": "20 kJ"},
    "lifetime": {"lead": "4 s", "tail": "4 s", "episodes": 4, "paths": 40},
}  # fmt: skip
LISTED = ["--set", "motion={kind: visits, of: {kind: random_waypoint}, lasting: 20 s, times: [0, 100]}"]
SCANS = [
    word
    for change in ("detection={kind: unlabelled}", "tracker={kind: gnn, filter: {kind: ekf}}",
                   "clusters={kind: central}", "wakeup={kind: none}")
    for word in ("--set", change)
]  # fmt: skip


@pytest.fixture(scope="module")
def small() -> LifetimeResult:
    return wsnsim.lifetime(NETWORK, "10/h", workers=0)


def test_the_answer_is_never_without_the_tracked_share_and_never_wider_than_100_columns(small: LifetimeResult) -> None:
    text = str(small)
    assert text.startswith("The first node dies after")
    assert "tracked at the start" in lifetime_text.answer(small.outcome)
    assert max(map(len, text.splitlines())) <= 100
    assert "Two terms" in text and "without a target" in text and "dies first in" in text


def test_criteria_are_in_order_and_their_intervals_hold_their_medians(small: LifetimeResult) -> None:
    table = small.table().set_index("criterion")
    assert table.loc["first_death", "median"] <= table.loc["dead_10", "median"] <= table.loc["half_dead", "median"]
    for name in ("first_death", "half_dead"):
        assert table.loc[name, "low"] <= table.loc[name, "median"] <= table.loc[name, "high"]
        assert table.loc[name, "mean_low"] <= table.loc[name, "mean"] <= table.loc[name, "mean_high"]


def test_an_interval_that_is_open_ends_with_the_horizon_in_the_answer(small: LifetimeResult) -> None:
    first = {**small.outcome["criteria"][0], "high": math.inf, "mean": math.nan}
    told = lifetime_text.answer({**small.outcome, "criteria": [first]})
    assert "inf" not in told and " to > " in told


def test_the_help_says_the_horizon_that_is_the_default() -> None:
    (option,) = [each for each in lifetime.params if each.name == "horizon"]
    assert f"({AskedLifetime().horizon / 86_400:g} d)" in option.help  # type: ignore[attr-defined]


def test_the_table_of_deaths_gives_the_first_death_of_each_path(small: LifetimeResult) -> None:
    deaths, lives = small.table("deaths"), small.table("lifetimes")
    first = deaths.groupby("path")["time"].min()
    told = lives[lives["criterion"] == "first_death"].set_index("path")["time"]
    assert (first == told.loc[first.index]).all()


def test_a_file_shows_the_same_as_what_was_estimated(small: LifetimeResult, tmp_path: Path, capsys: Any) -> None:
    path = small.save(tmp_path / "small.json")
    assert main(["info", str(path)]) == 0
    assert capsys.readouterr().out.strip() == str(small).strip()
    assert lifetime_result.read(path)[0]["baseline"] == small.outcome["baseline"]
    assert main(["lifetime", str(path), "--json", "--plot", str(tmp_path / "a.png")]) == 0
    assert json.loads(capsys.readouterr().out)["answers"] == [lifetime_text.answer(small.outcome)]
    assert (tmp_path / "a.png").stat().st_size > 10_000


def test_the_page_and_the_notebook_hold_three_figures_and_load_nothing(small: LifetimeResult, tmp_path: Path) -> None:
    file = small.save(tmp_path / "small.json")
    assert main(["lifetime", str(file), "-q", "--page", str(tmp_path / "page.html")]) == 0
    page = (tmp_path / "page.html").read_text()
    assert "<title>Lifetime of small</title>" in page and "<pre" not in page and page.count("<table>") == 1
    assert page.count("<svg") == small._repr_html_().count("<svg") == len(lifetime_plots.PANELS) == 3
    assert "http:" not in page.replace("http://www.w3.org", "").replace("http://purl.org", "").replace(
        "http://creativecommons.org", ""
    )
    assert "<script" not in page


def variant(small: LifetimeResult, name: str, years: float, tracked: float, **other: Any) -> dict[str, Any]:
    """An outcome with another label, first death and share of tracked steps."""
    spread = {"low": 0.9, "median": 1.0, "high": 1.1, "mean": 1.0, "mean_low": 0.95, "mean_high": 1.05}
    first = {key: factor * years * 365.25 * 86_400 for key, factor in spread.items()}
    return {
        **small.outcome,
        "label": name,
        "criteria": [{"criterion": "first_death", "met": 1.0, "tracked": tracked, **first}],
    } | other


def words_of(*points: dict[str, Any]) -> str:
    return " ".join(lifetime_text.text(points).split())


def test_the_longest_life_of_those_that_track_is_said_before_that_of_all(small: LifetimeResult) -> None:
    long, tracks, short = (
        variant(small, "long", 8, 0.43),
        variant(small, "tracks", 4, 0.91),
        variant(small, "short", 1, 1),
    )
    said = words_of(long, tracks, short)
    enough = "track at least 90 % of the steps (our choice), with an error below that of a lost track"
    best = said.index(f"Of those that {enough}, 2 of 3, 'tracks' lives longest")
    assert best < said.index("Of all, 'long' lives longest until the first death, 2,922 days (43 % tracked then)")
    assert "Of all" not in words_of(tracks, short)
    assert f"None is known to {enough}. Of all, 'long' lives" in words_of(long, long)
    endless = {
        **tracks,
        "label": "endless",
        "criteria": [{**tracks["criteria"][0], "median": math.inf, "mean_low": math.nan}],
    }
    assert "'endless' lives longest until the first death, > " in words_of(short, endless)


def test_info_shows_the_same_table_as_the_command_with_names_in_full(
    small: LifetimeResult, tmp_path: Path, capsys: Any
) -> None:
    names = ["information_driven, contikimac", "ekf, mac.shared = 4"]
    lifetime_result.write(tmp_path / "a.json", [variant(small, name, 1, 1) for name in names], "wsnsim")
    shown = []
    for command in (["info"], ["lifetime", "--page", str(tmp_path / "a.html")]):
        assert main([*command, str(tmp_path / "a.json")]) == 0
        shown.append(capsys.readouterr().out)
    assert shown[0] == shown[1] and all(f"\n  {name}  " in shown[0] for name in names)
    assert "half dead" not in shown[0] and f"{small.outcome['libraries'][0]['error']:.3g} m  " in shown[0]
    page = (tmp_path / "a.html").read_text()
    assert "<h1>Lifetime of small: 2 variants</h1>" in page and all(f"<h2>{name}</h2>" in page for name in names)


def test_figures_that_look_wrong_are_explained(small: LifetimeResult) -> None:
    causes = {"cause": ["idle", "rx"], "quiet": [1.0, 0.0], "visits": [-2e-7, 1e-7]}
    row = {"node": 3, "share": 0.5, "ratio": 0.87, "quiet": 1.0, "quiet_cause": "idle", "visits_cause": "rx"}
    point = {**small.outcome, "causes": causes, "joules": -1e-4, "first": [row, row | {"node": 4, "ratio": 1.3}]}
    said = words_of(point)
    assert " 0 % by visits (" in said and "-100 uJ each, less than the idle listening in its place)" in said
    assert "Node 3 dies first in 50 % of the paths, because of its battery or of visits unlike the 4 simulated." in said
    assert "Node 4 dies first in 50 % of the paths: it takes 1.30 times the mean power" in said
    assert "without self-discharge and harvesting, give the mean node" in said
    assert "Several nodes die first, at the same time" in words_of({**point, "first": [{**row, "share": 1.0}] * 3})


def test_an_answer_says_where_idle_listening_costs_nothing(small: LifetimeResult) -> None:
    causes = {"cause": ["rx", "idle"], "quiet": [0.0, 1.0], "visits": [1.0, 0.0]}
    free = {**small.outcome, "causes": {name: column[:1] for name, column in causes.items()}}
    assert lifetime_text.answer(free).endswith("; idle listening costs nothing in this model.")
    assert "idle" not in lifetime_text.answer({**small.outcome, "causes": causes})
    assert "Idle listening costs nothing in the model of b." in words_of(
        small.outcome | {"causes": causes}, free | {"label": "b"}
    )


def test_a_damaged_file_is_refused_with_its_name(tmp_path: Path, capsys: Any) -> None:
    path = tmp_path / "x.json"
    path.write_text('{"format": "wsnsim lifetimes", "schema_version": 1, "points": [{}]}')
    assert main(["info", str(path)]) == 1
    assert "x.json: is no file of `wsnsim lifetime`" in capsys.readouterr().err


def test_visits_that_are_kept_are_not_simulated_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ask = {"until": "first_death", "lead": "4 s", "tail": "4 s", "episodes": 4, "paths": 40}
    first = wsnsim.lifetime(NETWORK, "10/h", visits=tmp_path, workers=0, lifetime=ask)
    assert len(list(tmp_path.glob("*/r*.h5"))) >= 4
    assert list(first.table()["criterion"]) == ["first_death"]

    def fails(*_: Any) -> None:
        raise AssertionError("simulated again")

    monkeypatch.setattr("wsnsim.lifetimes.stored_visits.make_visit", fails)
    again = wsnsim.lifetime(NETWORK, "10/h", visits=tmp_path, workers=0, lifetime=ask)
    assert again.table().equals(first.table())


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--intrusions", "5/s"], "--intrusions: error: must be at most 1"),
        (["--intrusions", "4"], "must be at most 1, is 4; 4/h is 4 an hour"),
        (["--horizon", "1year"], "; 365 d is a year"),
        (["--plot", "a.pdf", "--vary", "lifetime.intrusions=1/h,2/h"], "--plot shows one scenario; --page shows"),
        (["--intrusions", "1 m"], "--intrusions: error: 'm' is a unit of length"),
        (["--intrusions", "1000/h"], "would overlap"),
        (["--intrusions", "none.csv"], "none.csv"),
        (["--horizon", "-1 d"], "--horizon: error: must be greater than 0"),
        (["--until", "half"], "did you mean 'half_dead'?"),
        (["--error", "200 %"], "--error: error: must be less than 1"),
        (["--episodes", "1"], "--episodes: error: must be at least 2"),
        (["--tolerance", "soon"], "--tolerance: error: expected time"),
        (["--coverage", "0"], "--coverage: error: must be greater than 0"),
        (["--profile", "1,2"], "expected 24 factors"),
        (["--set", "network=none"], "network: none has no batteries"),
        (SCANS, "a lifetime needs readings that name it"),
        (["--jobs", "2", "--scheduler", "tcp://x:1"], "--jobs cannot be combined with --scheduler"),
        (["--plot", "a.gif"], "only the steps of a run can be a GIF"),
        (["--set", "lifetime.times=[3,2]"], "times: error: must ascend"),
        (["--set", "lifetime.times=[0,10]"], "lifetime.times: visits last up to 20 s, and two begin 10 s apart"),
        (["--intrusions", "close.csv"], "--intrusions close.csv: visits last up to 20 s, and two begin 10 s apart"),
        (["--intrusions", "0", "--profile", ",".join(["1"] * 24)], "--profile: needs visits at a rate"),
        ([*LISTED, "--profile", ",".join(["1"] * 24)], "--profile: needs visits at a rate"),
    ],
)
def test_a_bad_value_is_one_message_before_anything_is_simulated(
    options: list[str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("small.yaml").write_text(json.dumps(NETWORK))
    Path("close.csv").write_text("time\n0\n10\n")
    assert main(["lifetime", "small.yaml", *options]) == 2
    assert said in capsys.readouterr().err
    assert not list(tmp_path.rglob("*.h5"))


def test_trackers_are_compared_in_a_table_with_their_tracked_shares(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("small.yaml").write_text(json.dumps(NETWORK))
    command = [
        "lifetime",
        "small.yaml",
        "--vary",
        "lifetime.intrusions=1/h,60/h",
        "--until",
        "first_death",
        "-j",
        "1",
    ]
    assert main([*command, "-o", "both.json"]) == 0
    out, err = capsys.readouterr()
    assert "wsnsim: 2 of 2: lifetime.intrusions = 60/h\n" in err and " left)" not in err
    points = lifetime_result.read(Path("both.json"))
    assert len(points) == 2 and points[0]["criteria"][0]["median"] > points[1]["criteria"][0]["median"]
    assert (
        "tracked" in out
        and "lives longest until the first death, " in " ".join(out.split())
        and " tracked then)" in " ".join(out.split())
        and max(map(len, out.splitlines())) <= 100
    )
    begins = [json.loads(path.read_text()) for path in Path("both.visits").glob("*/visits.json")]
    assert begins.count({"dead": [], "first": 0}) == 1  # the visits of both rates are the same
    for horizon, said in (("3652.5 d", "written;"), ("900 d", "written in place of the answer of other settings;")):
        assert main([*command, "-o", "both.json", "--horizon", horizon]) == 0
        assert said in capsys.readouterr().err


def test_a_network_without_intrusions_is_quiet(tmp_path: Path) -> None:
    ask = {"until": "first_death", "lead": "4 s", "tail": "4 s", "episodes": 4, "paths": 40}
    found = wsnsim.lifetime(NETWORK, 0, workers=0, lifetime=ask).outcome
    assert found["rate"] == 0.0 and not any(found["causes"]["visits"])
    assert math.isclose(found["baseline"], 20e3 / sum(found["causes"]["quiet"]), rel_tol=1e-9)


def test_a_run_ignores_the_block_lifetime() -> None:
    with_block = wsnsim.simulate(NETWORK)
    without = wsnsim.simulate({key: value for key, value in NETWORK.items() if key != "lifetime"})
    assert with_block.table("estimates").equals(without.table("estimates"))


def test_a_network_whose_error_is_that_of_a_lost_track_does_not_count_as_one_that_tracks() -> None:
    point = {"name": "a", "criteria": [{"tracked": 0.98}], "lost_limit": 20.0}
    for error, tracks in ((3.0, True), (22.2, False), (float("nan"), True)):
        assert lifetime_text._tracks(point | {"libraries": [{"tracked": 0.98, "error": error}]}) == tracks
    assert not lifetime_text._tracks(point | {"criteria": [{"tracked": 0.5}], "libraries": [{"tracked": 1.0}]})
