"""What Python says of misspelt arguments, of tables that are no attributes, and of a file without a table."""

from __future__ import annotations

import pytest

import wsnsim
from wsnsim.base.errors import UsageError


@pytest.mark.parametrize(("function", "given", "meant"), [
    ("simulate", {"sed": 1}, "'seed'"),
    ("simulate", {"keeps": ["events"]}, "'keep'"),
    ("run", {"ouput": "x.h5"}, "'out'"),
    ("run", {"replicats": 2}, "'replicates'"),
    ("run", {"override": {}}, "'overrides'"),
    ("run", {"trakcer": "ekf"}, "'tracker'"),
    ("compare", {"jobs": 2, "trackers": ["ekf", "pf"]}, "'workers'"),
])  # fmt: skip
def test_a_misspelt_argument_leads_to_the_one_that_the_function_has(function, given, meant):
    with pytest.raises(UsageError, match=f"has no argument '{next(iter(given))}' .did you mean {meant}"):
        getattr(wsnsim, function)("pso_mhpf", **given)


def test_a_table_that_is_no_attribute_leads_to_table():
    result = wsnsim.simulate("pso_mhpf", duration=0.2)
    with pytest.raises(AttributeError, match=r"the table is result.table\('readings'\), recorded with keep"):
        _ = result.readings


def test_a_file_without_a_table_is_answered_with_the_names_of_its_tables(tmp_path):
    path = wsnsim.run("pso_mhpf", duration=0.2, out=tmp_path / "x.h5").out
    with pytest.raises(UsageError, match=r"name the table: runs, .*estimates"):
        wsnsim.read(path)
