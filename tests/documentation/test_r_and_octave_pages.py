"""The R, Octave and MATLAB scripts of the guide read what pandas reads.

Each block is a script of its own. It is executed as it stands on the page, in a folder in which the commands of the
page were run, and followed by lines that write its variables to a file. Without R, Octave or a package that a script
uses, its test is skipped. MATLAB scripts are executed by Octave with the package hdf5oct.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.io import loadmat

import wsnsim
from tests.documentation.executed_pages import ROOT, run_page
from tests.documentation.pages_of_docs import fences, text

PAGE = "docs/how-to/results.md"
R_CSV, R_CAMPAIGN, R_RHDF5, R_CATEGORIES, R_HDF5R = fences(PAGE, "r")
OCTAVE_LOAD, OCTAVE_CATEGORIES, OCTAVE_INTEGERS = fences(PAGE, "octave")
(MATLAB_HDF5,) = fences(PAGE, "matlab")
RESULT = "results/pso_mhpf.h5"
SECONDS = 120.0
"""A script that takes longer than this is stopped."""
PRECISION = {"rtol": 1e-14, "atol": 0.0}
"""R's conversion of decimal text may be off by one unit in the last place."""
WRITE_IN_R = """
written <- lapply({frame}, function(x) if (is.double(x)) sprintf("%.17g", x) else x)
write.csv(as.data.frame(written), "back.csv", row.names = FALSE)
"""


def executed(command: list[str], folder: Path) -> str:
    """What a program prints; it may not fail, and R may not warn."""
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=SECONDS, check=False)
    assert done.returncode == 0, f"{command[0]}:\n{done.stdout}{done.stderr}"
    assert "Warning message" not in done.stderr, done.stderr
    return done.stdout


def program(name: str) -> str:
    """The path of a program; skips the test if it is not installed."""
    return shutil.which(name) or pytest.skip(f"{name} is not installed")


@pytest.fixture(scope="module")
def r_in():
    """r_in(folder, code): what R prints."""
    rscript = program("Rscript")
    return lambda folder, code: executed([rscript, "--vanilla", "-e", code], folder)


@pytest.fixture(scope="module")
def r_package(r_in):
    """r_package(name) skips the test if R lacks a package."""

    def demand(name: str) -> None:
        if "TRUE" not in r_in(Path(), f'cat(requireNamespace("{name}", quietly = TRUE))'):
            pytest.skip(f"R has no package {name}")

    return demand


@pytest.fixture(scope="module")
def octave_in():
    """octave_in(folder, code): what Octave prints; figures are made and not shown."""
    octave = program("octave-cli")
    quiet = "set(0, 'defaultfigurevisible', 'off'); warning('off', 'all');\n"
    return lambda folder, code: executed([octave, "--norc", "--no-history", "--quiet", "--eval", quiet + code], folder)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with the results and exports of the page."""
    folder = tmp_path_factory.mktemp("guides") / "work"
    folder.mkdir()
    assert run_page(ROOT / PAGE, folder) == 7
    return folder


def read(folder: Path, table: str) -> pd.DataFrame:
    """A table of the result, as pandas has it."""
    return wsnsim.read(folder / RESULT, table)


def rmse(folder: Path) -> float:
    """The root mean square error of the estimates in m."""
    return float(np.sqrt((read(folder, "estimates").error ** 2).mean()))


def counted(folder: Path) -> dict[str, int]:
    """The number of events of each kind that occurs."""
    counts = read(folder, "events").kind.value_counts()
    return {str(kind): int(count) for kind, count in counts.items() if count}


def assert_same_columns(found: pd.DataFrame, wanted: pd.DataFrame) -> None:
    """Assert that all columns of numbers are there and equal."""
    assert sorted(found.columns) == sorted(wanted.columns)
    for name in wanted:
        np.testing.assert_allclose(found[name].astype(float), wanted[name].astype(float), **PRECISION, err_msg=name)


def assert_r_reads(folder: Path, table: str) -> pd.DataFrame:
    """Assert that R has written the columns of a table back as pandas reads them, and return them."""
    back = pd.read_csv(folder / "back.csv")
    assert_same_columns(back, read(folder, table))
    return back


def test_the_csv_file_in_r_is_the_table(r_in, folder):
    printed = r_in(folder, R_CSV + WRITE_IN_R.format(frame="estimates"))
    assert float(re.fullmatch(r"\[1\] (\S+)\s*", printed)[1]) == pytest.approx(rmse(folder), rel=1e-6)
    assert_r_reads(folder, "estimates")
    assert (folder / "Rplots.pdf").stat().st_size > 1000


def test_the_table_of_a_campaign_in_r_has_the_medians_of_pandas(r_in, folder):
    rows = [line.split()[-2:] for line in r_in(folder, R_CAMPAIGN).splitlines()[1:]]
    medians = pd.read_csv(folder / "campaign/runs.csv").groupby("tracker.kind")["rmse"].median()
    assert {kind: float(value) for kind, value in rows} == pytest.approx(medians.to_dict(), rel=1e-6)
    assert len(rows) == 2


def test_rhdf5_reads_the_table(r_in, r_package, folder):
    r_package("rhdf5")
    printed = r_in(folder, R_RHDF5 + WRITE_IN_R.format(frame="estimates"))
    assert int(re.fullmatch(r"\[1\] (\d+)\s*", printed)[1]) == read(folder, "estimates").late.sum()
    assert_r_reads(folder, "estimates")


def test_rhdf5_reads_the_names_of_categories(r_in, r_package, folder):
    r_package("rhdf5")
    rows = [line.split()[-2:] for line in r_in(folder, R_CATEGORIES).splitlines()[1:]]
    assert {kind: int(count) for kind, count in rows if count != "0"} == counted(folder)


def test_hdf5r_reads_the_table_in_its_order_and_its_units(r_in, r_package, folder):
    r_package("hdf5r")
    printed = r_in(folder, R_HDF5R + WRITE_IN_R.format(frame="estimates"))
    assert printed.split() == ["error", '"m"']
    assert list(assert_r_reads(folder, "estimates")) == list(read(folder, "estimates"))


def test_octave_loads_every_table_of_the_matlab_file(octave_in, folder):
    saves = "x = get(get(gca, 'children'), 'ydata');\nsave('-v7', 'back.mat', 'result', 'x');\n"
    if "axes" not in octave_in(folder, "try, axes(); disp('axes'); end_try_catch\n"):
        pytest.skip("Octave cannot plot here: it lacks a graphics toolkit or its fonts")
    printed = octave_in(folder, OCTAVE_LOAD + saves)
    assert f"{rmse(folder):.6f} m" in printed
    back = loadmat(folder / "back.mat", simplify_cells=True)
    np.testing.assert_array_equal(back["x"], read(folder, "estimates").error)
    tables = set(back["result"]) - {"wsnsim"}
    assert len(tables) == 10
    for table in tables:
        wanted = read(folder, table)
        assert list(back["result"][table]) == list(wanted), table
        for name, values in back["result"][table].items():
            column = wanted[name].astype(str) if wanted[name].dtype.kind not in "biuf" else wanted[name]
            np.testing.assert_array_equal(np.atleast_1d(values), column, err_msg=f"{table}.{name}")


def test_octave_counts_the_categories_of_the_matlab_file(octave_in, folder):
    rows = [line.split() for line in octave_in(folder, OCTAVE_CATEGORIES).splitlines()]
    assert {kind: int(count) for kind, count in rows} == counted(folder)


def test_octave_calculates_with_the_integers_of_the_matlab_file(octave_in, folder):
    estimates = read(folder, "estimates")
    share = estimates.readings.sum() / estimates.members.sum()
    assert octave_in(folder, OCTAVE_INTEGERS) == f"readings per member: {share:.6f}\n"


def test_the_functions_of_matlab_read_the_hdf5_file(octave_in, folder):
    load = "try, pkg load hdf5oct; end_try_catch\nif ~exist('h5read'), disp('absent'); exit(0); end\n"
    saves = "save('-v7', 'back.mat', 'tables', 'time', 'errors', 'kind');\n"
    printed = octave_in(folder, load + MATLAB_HDF5 + saves)
    if printed == "absent\n":
        pytest.skip("Octave has no package hdf5oct")
    estimates = read(folder, "estimates")
    assert printed.splitlines()[-1] == f"50 estimates, the last error is {estimates.error.iloc[-1]:.6f} m"
    back = loadmat(folder / "back.mat", simplify_cells=True)
    assert "/estimates" in back["tables"] and "/events" in back["tables"]
    np.testing.assert_array_equal(back["time"], estimates.time)
    np.testing.assert_array_equal(back["errors"], estimates.error)
    np.testing.assert_array_equal(back["kind"], read(folder, "events").kind.astype(str))


def test_octave_without_a_package_reads_a_table_that_is_named(octave_in, folder):
    (call,) = re.findall(r"`(load\('results/[^`]*\))`", text(PAGE))
    octave_in(folder, f"named = {call}; save('-v7', 'back.mat', '-struct', 'named');\n")
    (estimates,) = loadmat(folder / "back.mat")["estimates"][0]
    columns = {name: estimates[name] for name in estimates.dtype.names}
    assert {values.shape for values in columns.values()} == {(1, 50)}
    assert_same_columns(pd.DataFrame({name: values[0] for name, values in columns.items()}), read(folder, "estimates"))


def test_the_packages_for_conda_are_those_that_wsnsim_depends_on():
    project = tomllib.loads(text("pyproject.toml"))["project"]
    (line,) = re.findall(r"^conda create .* python=\S+ (.*)$", text("docs/how-to/install.md"), re.MULTILINE)
    assert sorted(line.split()) == sorted(re.match(r"\w+", need)[0] for need in project["dependencies"])


def test_the_wheel_of_the_installation_page_is_that_of_this_version():
    named = re.findall(r"wsnsim-([\d.]+[\da-z])(?:-py3|\.tar)", text("docs/how-to/install.md") + text("README.md"))
    assert len(named) > 5
    assert set(named) == {wsnsim.__version__}
