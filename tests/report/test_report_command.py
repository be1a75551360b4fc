"""`wsnsim report`: its files, output and errors."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.helpers.full_disk import FullDisk
from wsnsim.report import html_page

from .page_reader import no_figures
from .synthetic_results import write_result


@pytest.fixture
def wsnsim(tmp_path, monkeypatch, capsys):
    """wsnsim('report', ...) -> (exit code, stdout, stderr), in a folder of its own."""
    import wsnsim.cli.exporting  # noqa: F401
    from wsnsim.cli import main

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(html_page, "svg_figures", no_figures)

    def run(*words):
        code = main(["report", *map(str, words)])
        said = capsys.readouterr()
        return code, said.out, said.err

    return run


@pytest.mark.thorough
def test_the_command_writes_beside_the_result_or_where_it_is_told(wsnsim, real):
    write_result(Path("x.h5"))
    code, out, err = wsnsim("x.h5")
    assert code == 0 and out.startswith("x.html: 0.0") and err == ""
    assert wsnsim("x.h5", real)[1].startswith("report.html: ")
    assert wsnsim(real, "-o", "y.html", "--replicate", "1", "--megabytes", "0.5")[0] == 0
    assert Path("y.html").stat().st_size <= 500_000


@pytest.mark.thorough
def test_the_command_refuses_what_it_cannot_do_in_one_line(wsnsim):
    write_result(Path("x.h5"))
    Path("text.h5").write_text("no result")
    for words, code, message in (
        (["xx.h5"], 1, "xx.h5: no such file, did you mean 'x.h5'?"),
        (["text.h5"], 1, "text.h5: is not a wsnsim result"),
        (["x.h5", "--out", "x.h5"], 2, "expected a file with the suffix .html"),
        (["x.h5", "--out", "none/x.html"], 2, "folder does not exist: none"),
        (["x.h5", "--replicate", "3"], 2, "no replicate 3; it has 0"),
        (["x.h5", "--megabytes", "0"], 2, "'--megabytes'"),
        ([], 2, "Missing argument"),
    ):
        said = wsnsim(*words)
        assert said[0] == code and message in said[2] and said[2].count("\n") == 1, words
    assert sorted(file.name for file in Path().iterdir()) == ["text.h5", "x.h5"]


@pytest.mark.thorough
def test_a_page_is_written_although_nothing_can_be_printed_on_stderr(wsnsim, real, monkeypatch):
    monkeypatch.setattr("wsnsim.cli.end_stderr", lambda: None)  # it would close the stderr of these tests
    monkeypatch.setattr("sys.stderr", FullDisk())
    assert wsnsim(real, "--out", "page.html")[0] == 0
    assert Path("page.html").stat().st_size
