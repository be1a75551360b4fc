"""A network without a target in words: counts that add up, shares of what is in range."""

import json

import pytest
from click.testing import CliRunner

from tests.helpers.thorough import thorough
from wsnsim import read
from wsnsim.analysis import summary, summary_text
from wsnsim.cli.shared import group
from wsnsim.experiment import run

SMALL = {
    "extends": "scenarios/beacons.yaml",
    "duration": "3 s",
    "deploy": {"nodes": 40, "width": "250 m", "height": "250 m"},
}


def played(tmp_path, replicates=2, **changes):
    return run(SMALL | changes, replicates=replicates, out=tmp_path / "x.h5")


def rows(report):
    return {
        line.strip().partition("  ")[0]: line.split("  ")[-1].strip() for line in summary_text.text(report).splitlines()
    }


@pytest.mark.thorough
@pytest.mark.parametrize("link", [{"kind": "disk", "reach": 75}, *thorough([{"kind": "log_normal", "exponent": 2.1}])])
def test_the_figures_are_those_of_the_event_log(tmp_path, link):
    report = played(tmp_path, link=link)
    figures = summary.as_json(report)
    events, links = read(report.out, "events"), read(report.out, "links")
    kinds = events.kind.value_counts()
    assert figures["frames_sent"] * 2 == kinds["send"]
    assert 2 * 40 * 3 - 4 <= kinds["send"] <= 2 * 40 * 3, "but for what is on its way when the run ends"
    assert (figures["delivered"] + max(figures["over_weak_links"], 0)) * 2 == kinds["receive"] == links.received.sum()
    assert figures["collided"] * 2 == kinds.get("collide", 0)
    strong = links[links.chance >= 0.5]
    assert figures["links"] * 2 == len(strong)
    assert figures["found_share"] == pytest.approx((strong.received > 0).mean())
    assert figures["neighbours"] == pytest.approx(len(strong) / 80)
    assert figures["delivered_share"] == figures["delivered"] / figures["in_range"]


@pytest.mark.thorough
def test_the_chance_of_a_link_is_what_comes_over_it_where_nothing_disturbs(tmp_path):
    quiet = {"kind": "log_normal", "exponent": 2.1, "interference": "sinr"}
    report = played(tmp_path, 1, link=quiet, duration="60 s", deploy={"nodes": 12, "width": 300, "height": 300},
                    workload={"period": "1 s"})  # fmt: skip
    links = read(report.out, "links")
    some = links[(links.chance > 0.05) & (links.chance < 0.95)]
    assert len(some) > 3
    assert (some.received / some.sent - some.chance).abs().mean() < 0.08


@pytest.mark.thorough
def test_the_words_add_up_and_a_perfect_air_has_no_links_to_tell_of(tmp_path):
    said = rows(played(tmp_path))
    assert int(said["beacons sent"]) in (119, 120) and "% of" in said["links with a reception"]
    ideal = rows(played(tmp_path, mac={"kind": "ideal"}))
    assert "links with a reception" not in ideal and ideal["packet delivery ratio"] == "100.00%"
    assert "-0" not in summary_text.text(played(tmp_path, 3)).replace(str(tmp_path), "")


@pytest.mark.thorough
def test_the_command_prints_it_and_gives_json_without_nan(tmp_path):
    command = ["run", "beacons", "--set", "duration=2 s", "--set", "deploy.nodes=30", "-q", "--out"]
    answer = CliRunner().invoke(group, [*command, str(tmp_path / "x.h5"), "--set", "record.links=false", "--json"])
    figures = json.loads(answer.stdout)
    assert answer.exit_code == 0 and figures["found_share"] is None and figures["frames_sent"] in (59, 60)
    assert "intended receptions" in CliRunner().invoke(group, [*command, str(tmp_path / "x.h5")]).stdout


@pytest.mark.thorough
def test_how_far_clocks_are_off_at_the_end_is_shown_where_it_was_recorded(tmp_path):
    changes = {"duration": "30 s", "clock": {"kind": "drift", "offset": "5 ms"}, "record": {"clocks": True}}
    report = played(tmp_path, **changes, sync={"kind": "ftsp", "period": "1 s"})
    table = read(report.out, "clocks").groupby("replicate").last()
    figures = summary.as_json(report)
    assert figures["clock_error"] == pytest.approx(table.error.mean()) and figures["clock_synchronised"] == 1.0
    shown = rows(report)
    assert shown["clocks from true time at the end"].startswith(f"{1e3 * table.error.mean():.3g} ms, at most ")
    assert " µs, at most " in shown["clocks from their mean at the end"]
    assert shown["nodes that take their clock for synchronised"] == "100%"
    alone = rows(played(tmp_path, **changes))
    assert " ms, at most " in alone["clocks from their mean at the end"]
    assert not {name for name in alone if "synchronised" in name}
    assert not {name for name in rows(played(tmp_path)) if name.startswith("clocks")}
