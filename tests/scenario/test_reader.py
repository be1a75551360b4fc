"""The YAML that a scenario is written in: scalars of the core schema, places, duplicates, aliases."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wsnsim.scenario.python_values import of_dict
from wsnsim.scenario.reader import LARGEST, read
from wsnsim.scenario.texts import BROKEN, Origin


def text(content: str) -> Origin:
    return Origin("x.yaml", Path(), tuple(content.splitlines()) or ("",))


def value_of(content: str) -> Any:
    node, faults = read(content, text(content))
    assert node is not None, faults
    assert not faults
    return node.plain()


def faults_of(content: str) -> list[str]:
    return [str(fault).partition("\n")[0] for fault in read(content, text(content))[1]]


@pytest.mark.parametrize(
    ("written", "value"),
    [
        ("1e3", 1000.0),
        ("1e-4", 1e-4),
        (".5", 0.5),
        ("5.", 5.0),
        ("010", 10),
        ("0x1F", 31),
        ("0o17", 15),
        ("+3", 3),
        ("no", "no"),
        ("on", "on"),
        ("yes", "yes"),
        ("12:30:00", "12:30:00"),
        ("2001-01-01", "2001-01-01"),
        ("1_000", "1_000"),
        ("true", True),
        ("False", False),
        ("tRue", "tRue"),
        ("null", None),
        ("~", None),
        ("nothing", "nothing"),
        (".inf", math.inf),
        ("-.Inf", -math.inf),
        ("'60'", "60"),
        ("!!str 60", "60"),
        ("!!float 60", 60.0),
        ("60 m", "60 m"),
        ("=", "="),
    ],
)
def test_a_scalar_is_what_the_core_schema_says(written: str, value: Any) -> None:
    read_back = value_of(f"key: {written}")["key"]
    assert read_back == value
    assert type(read_back) is type(value)


def test_nan_is_a_number_that_the_reader_knows() -> None:
    assert math.isnan(value_of("key: .nan")["key"])


def test_a_value_and_its_key_know_where_they_stand() -> None:
    content = "a: 1\nb:\n  deep: [1, {x: 2}]\n"
    node, _ = read(content, text(content))
    assert node is not None
    value, key = node.spot_of(("b", "deep", 1, "x")), node.spot_of(("b", "deep", 1, "x"), of_key=True)
    assert (value.line, value.column) == (2, 16)
    assert (key.line, key.column) == (2, 13)


def test_a_place_that_is_not_written_is_that_of_what_stands_around_it() -> None:
    content = "a: 1\nb:\n  deep: 3\n"
    node, _ = read(content, text(content))
    assert node is not None
    spot = node.spot_of(("b", "missing", "inside"))
    assert (spot.line, spot.column) == (2, 2)


def test_every_duplicate_key_is_a_fault() -> None:
    assert faults_of("name: a\nseed: 1\nname: b\nlink: {reach: 1, reach: 2}\nseed: 3\n") == [
        "x.yaml:3:1: error: duplicate key 'name' (first at line 1)",
        "x.yaml:4:18: error: link: duplicate key 'reach' (first at line 4)",
        "x.yaml:5:1: error: duplicate key 'seed' (first at line 2)",
    ]


def test_a_merge_key_may_repeat_a_key_and_the_written_one_wins() -> None:
    content = "base: &base {a: 1, b: 2}\nother: &other {b: 3, c: 4}\nown: {<<: [*base, *other], a: 9}\n"
    assert value_of(content)["own"] == {"a": 9, "b": 2, "c": 4}


@pytest.mark.parametrize(
    ("content", "fault"),
    [
        ("", "x.yaml:1:1: error: is empty"),
        ("# only words\n", "x.yaml:1:1: error: is empty"),
        (
            "a: b: c",
            "x.yaml:1:5: error: not valid YAML: mapping values are not allowed in this context "
            "(are the keys of a mapping indented alike?)",
        ),
        (
            "a: 1\nb 2\nc: 3",
            "x.yaml:2:1: error: not valid YAML: while scanning a simple key, could not find expected ':'",
        ),
        ("a: *b", "x.yaml:1:4: error: not valid YAML: found undefined alias"),
        ("ok: 1\na: \x07", "x.yaml:2:4: error: not valid YAML: the character U+0007 is not allowed"),
        (
            "a: 1\n---\nb: 2",
            "x.yaml:2:1: error: not valid YAML: expected a single document in the stream, but found another document",
        ),
        ("a: !!python/name:os.system x", "x.yaml:1:4: error: a: unknown tag 'python/name:os.system'"),
        ("a: !mine {b: 1}", "x.yaml:1:4: error: a: unknown tag '!mine'"),
        ("a: !!int three", "x.yaml:1:4: error: a: 'three' is not a valid int"),
        ("a: 1e400", "x.yaml:1:4: error: a: '1e400' is too large for a number"),
        ("? [a]\n: b", "x.yaml:1:3: error: a key must be a scalar"),
        ("a: &a [1, *a]", "x.yaml:1:4: error: a.1: an anchor cannot contain itself"),
        ("a: {<<: 3}", "x.yaml:1:9: error: a: '<<' merges mappings only"),
    ],
)
def test_what_is_no_scenario_says_why(content: str, fault: str) -> None:
    assert faults_of(content) == [fault]


def test_deep_nesting_is_refused_and_does_not_hang() -> None:
    assert "nested deeper than 40 levels" in faults_of("[" * 100_000)[0]


def test_a_bomb_of_aliases_is_refused_and_does_not_hang() -> None:
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 30)]
    assert f"contains more than {LARGEST} values" in faults_of("\n".join(lines))[0]


def test_the_excerpt_has_its_caret_under_the_fault() -> None:
    content = "name: a\nlink: {reach: 1, reach: 2}\n"
    _, (fault,) = read(content, text(content))
    line, caret = fault.excerpt.splitlines()
    assert line[caret.index("^") :].startswith("reach: 2}")


def test_a_fault_on_an_empty_line_has_no_excerpt() -> None:
    _, (fault,) = read("link: {reach: 1\n", text("link: {reach: 1\n"))
    assert (fault.place, fault.excerpt) == ("x.yaml:2:1", "")


def test_a_long_line_is_cut_around_the_fault() -> None:
    content = "key: {" + ", ".join(f"k{i}: {i}" for i in range(500)) + ", k7: 1}"
    _, (fault,) = read(content, text(content))
    line, caret = fault.excerpt.splitlines()
    assert len(line) < 130
    assert line[caret.index("^") :].startswith("k7: 1}")


@given(st.text())
def test_any_text_is_read_or_refused(content: str) -> None:
    node, faults = read(content, text(content))
    assert faults or (node is not None and node.value is not BROKEN)


def test_a_dict_may_hold_tuples_paths_and_numpy_values() -> None:
    np = pytest.importorskip("numpy")
    values = {"a": (1, 2), "b": np.float64(3), "c": np.arange(3), "d": Path("x"), 5: True}
    node, faults = of_dict(values, Origin("", Path()))
    assert not faults
    assert node.plain() == {"a": [1, 2], "b": 3.0, "c": [0, 1, 2], "d": "x", "5": True}


def test_a_dict_within_itself_or_with_strange_values_is_refused() -> None:
    loop: dict[str, Any] = {"x": object()}
    loop["a"] = loop["b"] = loop
    _, faults = of_dict(loop, Origin("", Path()))
    assert [str(fault) for fault in faults] == [
        "x: error: a object is not allowed in a scenario",
        "a: error: nested deeper than 40 levels, or contains itself",
        "b: error: nested deeper than 40 levels, or contains itself",
    ]
