"""`wsnsim info KIND`: every kind is described in full, and its example loads."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from tests.helpers.recordings import recording
from wsnsim import scenario
from wsnsim.analysis.citing import _entry
from wsnsim.base.version import __version__
from wsnsim.cli import main
from wsnsim.cli.describe import kinds_text, word_text
from wsnsim.scenario.kind_info import OTHER_FORMS, KindInfo, citations, cited_in, kind_info, kinds_named
from wsnsim.scenario.parameter_info import DIMENSIONLESS
from wsnsim.scenario.registry import ROLES, load_class

CITED = r"(?:[A-ZÀ-Ž][\w-]+|van der \w+|Le \w+)(?:, (?:[A-ZÀ-Ž][\w-]+|van der \w+))* \((?:19|20)\d\d\)|RFC \d+"
"""How the code cites a publication."""

pytestmark = pytest.mark.usefixtures("fresh_folder")
ROWS = [(role.name, row.kind) for role in ROLES.values() for row in role.kinds]
NAMES = [f"{role}.{kind}" for role, kind in ROWS]

PLUGIN = '''
"""A sensor of another package."""

from typing import Annotated

from wsnsim import Quantity, part


@part
class Late:
    """A packing of its own.

    Source: Heinzelman (2002), section 3.
    """

    most: Annotated[int, Quantity("", ge=1), "largest number of packets in a frame"]
    wait: Annotated[float, Quantity("s", gt=0), "time to wait"] = 0.5

    def packets(self, mac): ...
'''


def said(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    assert main(list(arguments)) == 0
    return capsys.readouterr().out


@pytest.mark.thorough
@pytest.mark.parametrize(("role", "kind"), ROWS, ids=NAMES)
def test_every_kind_and_parameter_is_described_with_units_and_sources(role: str, kind: str) -> None:
    found = kind_info(role, kind)
    assert len(found.method[0]) > 10
    assert max(map(len, kinds_text([found]).splitlines())) <= 100
    for one in found.parameters:
        assert len(one.meaning) > 5 and one.meaning[0] != " ", one
        assert bool(one.unit) == ("number" in one.type), one
        assert " of unknown" not in one.type and "<" not in one.type, one
    names = [one.name for one in found.parameters]
    assert len(names) == len(set(names))
    text = " ".join([found.paper, *found.method, *found.notes])
    for form, key in OTHER_FORMS.items():
        text = text.replace(form, key)
    keys = [one.key for one in found.citations]
    for cited in re.findall(CITED, text):
        assert any(cited.endswith(key) for key in keys), cited


@pytest.mark.parametrize(("role", "kind"), ROWS, ids=NAMES)
def test_the_example_of_every_kind_is_a_good_scenario(role: str, kind: str) -> None:
    found = kind_info(role, kind)
    for name, content in found.example.files.items():
        Path(name).write_text(content)
    Path("example.yaml").write_text(found.example.text())
    loaded = scenario.load("example.yaml")
    scenario.build(loaded)
    if ROLES[role].inner:
        assert f"{role}: {{kind: {kind}}}" in found.example.lines[0]
        return
    assert kind in [model.kind for _, model in loaded.written(ROLES[role])]
    assert f"kind: {kind}" in found.example.lines[0] and found.example.lines[0].split(":")[0] in ROLES[role].keys


def test_bounds_defaults_and_units_are_those_of_the_class() -> None:
    (turn,) = [kind_info(*pair) for pair in kinds_named("coordinated_turn")]
    rows = {one.name: one for one in turn.parameters}
    assert (rows["q"].unit, rows["q"].allowed, rows["q"].default) == ("m2/s3", "0 to 1e9", "0.01")
    assert rows["start"].unit == "m, m/s, m, m/s, rad/s"
    assert rows["start"].default == "[0, 5, 0, 0, 0.05]"
    disk = {one.name: one for one in kind_info("link", "disk").parameters}
    assert disk["loss"].takes == f"number ({DIMENSIONLESS}), ≥ 0, < 1"
    states = {one.name: one for one in kind_info("energy", "states").parameters}
    assert (states["radio"].type, states["radio"].default, states["sleep_state"].default) == ("datasheet", None, "null")
    columns = {one.name: one.default for one in kind_info("deploy", "file").parameters}
    assert columns["columns.id"] == "id" and columns["path"] is None


def test_a_word_finds_a_kind_by_its_name_its_role_and_its_class() -> None:
    assert kinds_named("ris") == [("sleep", "ris"), ("tracker", "ris")]
    assert kinds_named("sleep.ris") == [("sleep", "ris")] == kinds_named("sleeps.ris")
    assert kinds_named("PsoMhpf") == [("tracker", "pso_mhpf")] == kinds_named("tracker.PsoMhpf")
    assert kinds_named("nothing") == kinds_named("tracker.nothing") == kinds_named("tracker.") == []


def test_the_text_has_everything_and_fits_a_hundred_columns(capsys: pytest.CaptureFixture[str]) -> None:
    for word in ("coordinated_turn", "pso_mhpf", "tsch", "log_normal", "states"):
        text = said(capsys, "info", word)
        assert max(map(len, text.splitlines())) <= 100
        (found,) = [kind_info(*pair) for pair in kinds_named(word)]
        flat = " ".join(text.split())
        for one in found.parameters:
            assert one.name in flat and " ".join(one.meaning.split()) in flat and one.takes in flat
        for one in found.citations:
            assert one.text() in flat
        assert found.import_line in flat
    assert "There is also a scenario of this name: wsnsim info scenario pso_mhpf" in said(capsys, "info", "pso_mhpf")
    assert said(capsys, "info", "scenario", "pso_mhpf").startswith("pso_mhpf, in SI units")


def test_the_import_line_imports_the_class_of_the_kind() -> None:
    for role, kind in ROWS:
        line = kind_info(role, kind).import_line
        names: dict[str, type] = {}
        exec(line, names)
        assert names[line.rpartition(" ")[2]] is load_class(next(row for row in ROLES[role].kinds if row.kind == kind))


def test_a_kind_of_several_roles_is_shown_for_each_and_two_words_choose(capsys: pytest.CaptureFixture[str]) -> None:
    both = said(capsys, "info", "ris")
    assert "role sleep" in both and "role tracker" in both
    assert said(capsys, "info", "sleep", "ris").count("A kind of the role") == 1
    assert json.loads(said(capsys, "info", "trackers", "ris", "--json"))["kinds"][0]["role"] == "tracker"


def test_json_has_the_parameters_in_fields_of_their_own(capsys: pytest.CaptureFixture[str]) -> None:
    (found,) = json.loads(said(capsys, "info", "bearing", "--json"))["kinds"]
    assert next(each for each in found["parameters"] if each["name"] == "sd") == {
        "name": "sd", "type": "number", "unit": "rad", "allowed": "1e-6 to 0.5", "default": "0.035",
        "meaning": "standard deviation of a bearing",
    }  # fmt: skip
    assert found["citations"][0]["doi"] == "10.1002/0471221279"
    assert found["example"]["base"] in scenario.shipped()


def test_the_name_of_a_role_lists_its_kinds(capsys: pytest.CaptureFixture[str]) -> None:
    assert said(capsys, "info", "motion") == said(capsys, "list", "motions")
    assert "disk" in json.loads(said(capsys, "info", "link", "--json"))["roles"]["link"]["kinds"][0]["kind"]


@pytest.mark.thorough
def test_a_table_a_column_a_parameter_and_a_command_are_described(capsys: pytest.CaptureFixture[str]) -> None:
    assert "estimates: a table of results, one row per run, target and step" in said(capsys, "info", "estimates")
    rmse = said(capsys, "info", "rmse")
    assert "rmse: a column of results" in rmse and "  runs " in rmse and "  tracks " in rmse
    assert said(capsys, "info", "runs.delivered").count("\n") < 6
    reach = said(capsys, "info", "reach")
    assert "reach: a parameter" in reach and "link disk" in reach and "sensor range" in reach
    assert max(map(len, reach.splitlines())) <= 100
    assert "sweep: a command" in said(capsys, "info", "sweep")
    assert "rmse" in json.loads(said(capsys, "info", "rmse", "--json"))["text"]


def test_a_plug_in_is_described_for_the_role_that_it_can_play(capsys: pytest.CaptureFixture[str]) -> None:
    Path("late_packing.py").write_text(PLUGIN)
    text = said(capsys, "info", "late_packing:Late")
    assert "A kind of the role packing" in text
    assert "required; whole number (dimensionless), ≥ 1" in text and "default 0.5; number in s, > 0" in text
    assert 'packing: {kind: "late_packing:Late", most: ...}' in text
    assert "from late_packing import Late" in text and "doi:10.1109/TWC.2002.804190" in text
    assert said(capsys, "info", "packing", "late_packing:Late") == text


@pytest.mark.thorough(
    fast=[
        "words1-unknown sensor 'camera' (did you mean 'bearing' or 'range_bearing'?)",
        "words3-unknown kind, scenario, datasheet or result 'lifetime_of_network' (did you mean",
        "words6-the name is empty",
        "words8-nowhere:Mine cannot be imported",
        "words9-json:JSONDecoder is a component of no role",
        "words10-expected KIND, ROLE KIND, FILE or NAME (such as: wsnsim info ekf), got 3 words",
    ]
)
@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["unscented"], "unknown kind, scenario, datasheet or result 'unscented' (did you mean 'ukf' or 'ckf'?)"),
        (["sensor", "camera"], "unknown sensor 'camera' (did you mean 'bearing' or 'range_bearing'?)"),
        (["sensr", "range"], "unknown role 'sensr' (did you mean 'sensors'?)"),
        (["lifetime_of_network"], "unknown kind, scenario, datasheet or result 'lifetime_of_network' (did you mean"),
        (
            ["latency"],
            "unknown kind, scenario, datasheet or result 'latency' (did you mean 'delay' or 'report_delay'?)",
        ),
        ([""], "the name is empty: expected KIND, ROLE KIND, FILE or NAME (such as: wsnsim info ekf)"),
        (["tracker", " "], "the name is empty"),
        (["qqqq"], "unknown kind, scenario, datasheet or result 'qqqq' (see `wsnsim list`)"),
        (["nowhere:Mine"], "nowhere:Mine cannot be imported"),
        (["json:JSONDecoder"], "json:JSONDecoder is a component of no role"),
        (
            ["a", "b", "c"],
            "expected KIND, ROLE KIND, FILE or NAME (such as: wsnsim info ekf), got 3 words",
        ),
    ],
)
def test_what_is_unknown_says_so_in_one_line(
    words: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["info", *words]) == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert error.startswith(f"wsnsim: error: {message}")


@pytest.mark.thorough(fast=["words3-exact3"])
@pytest.mark.parametrize(
    ("words", "exact"),
    [
        (["UKF"], ["ukf"]), (["Ekf"], ["ekf"]), (["Tracker.EKF"], ["tracker.ekf"]),
        (["Tracker", "EKF"], ["tracker", "ekf"]),
        (["PSO_MHPF"], ["pso_mhpf"]), (["CC2420"], ["cc2420"]), (["Trackers"], ["trackers"]),
    ],
)  # fmt: skip
def test_a_name_is_found_in_any_case(words: list[str], exact: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", *words]) == 0
    found = capsys.readouterr().out
    assert main(["info", *exact]) == 0
    assert capsys.readouterr().out == found


def test_citations_are_found_in_every_form_in_which_the_code_cites() -> None:
    assert [one.key for one in cited_in("Heinzelman and others (2000); Li, Jiang, Zhang,\n Zhang (2012)")] == [
        "Heinzelman (2000)", "Li, Jiang, Zhang, Zhang (2012)",
    ]  # fmt: skip
    keys = [one.key for one in citations()]
    assert len(keys) == len(set(keys))
    assert all(re.fullmatch(r"10\.\d{4,}/\S+|", one.doi) for one in citations())
    assert isinstance(kind_info("tracker", "ekf"), KindInfo)


@pytest.mark.thorough
@pytest.mark.parametrize(("word", "shown"), [
    ("seed", "seed of every random stream"),
    ("tracker.particles", "tracker pso_mhpf"),
    ("range.sd", "standard deviation of a reading"),
    ("sensor.reach", "sensor rssi"),
])  # fmt: skip
def test_keys_at_the_top_and_dotted_keys_are_described(word, shown):
    assert shown in word_text(word)


def test_a_path_after_a_role_is_an_unknown_kind(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", "tracker", "x.yaml"]) == 2
    assert "unknown tracker 'x.yaml'" in capsys.readouterr().err


# what a result has to cite

ENTRY = re.compile(r"^@(software|article|misc)\{([A-Za-z0-9-]+),\n((?:  [a-z]+ = \{.+\},?\n)+)\}$", re.MULTILINE)


def _entries(text: str) -> dict[str, dict[str, str]]:
    """{key of a BibTeX entry: its values}; asserts that all lines belong to entries and comments."""
    assert not re.sub("^%.*$", "", ENTRY.sub("", text), flags=re.MULTILINE).strip()
    return {
        found[2]: dict(re.findall(r"^  ([a-z]+) = \{(.+?)\},?$", found[3], re.MULTILINE))
        for found in ENTRY.finditer(text)
    }


def test_a_result_names_the_software_and_the_papers_of_its_methods_as_bibtex(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["info", "--cite", str(recording("pso_mhpf"))]) == 0
    found = _entries(capsys.readouterr().out)
    assert found["wsnsim"]["version"] == __version__
    assert found["Jiang2013"]["author"] == "Jiang and Song and Lin"
    assert found["Jiang2013"]["journal"] == "Journal on Communications"
    assert [found["Jiang2013"][name] for name in ("volume", "number", "pages")] == ["34", "11", "8--17"]
    assert "Buettner2006" not in found, "which is X-MAC"
    assert main(["info", "--cite", "li_xmac"]) == 0
    scenario_alone = _entries(capsys.readouterr().out)
    assert scenario_alone["Buettner2006"]["doi"] == "10.1145/1182807.1182838" and "Jiang2013" in scenario_alone


def test_every_publication_has_an_entry_of_its_own() -> None:
    found = _entries("\n\n".join(_entry(one, "a test") for one in citations()))
    assert len(found) == len(citations())
    for values, one in zip(found.values(), citations(), strict=True):
        assert values.get("doi", "") == one.doi and one.title.replace("&", r"\&") in values["title"]
    assert found["Rodrigues2017"]["author"] == "Rodrigues and Montez and Moraes and Portugal and Vasques"
    assert (
        found["Wei2022"]["journal"] == r"Computer Measurement \& Control"
        and found["Wei2022"]["pages"] == "273--279, 291"
    )


def test_a_kind_has_no_entries_and_json_no_bibtex(capsys: pytest.CaptureFixture[str]) -> None:
    for words in (["r", "x"], ["small.h5", "--json"]):
        assert main(["info", "--cite", *words]) == 2
        assert "--cite takes one result, campaign or scenario" in capsys.readouterr().err
