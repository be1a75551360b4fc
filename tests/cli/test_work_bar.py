"""Work that takes more than a second shows a bar, on a terminal only, and removes it."""

from __future__ import annotations

import click
import pytest

from wsnsim.base.runs import WorkProgress, tracked, watching
from wsnsim.cli import progress as shown
from wsnsim.cli.progress import WorkBar


@pytest.fixture
def terminal(monkeypatch):
    monkeypatch.setattr(shown, "_is_terminal", lambda: True)


def report(done: int, wall: float, what: str = "files read") -> WorkProgress:
    return WorkProgress(what, done, 10, wall)


def drawn(capsys, *reports: WorkProgress) -> str:
    bar = WorkBar()
    for each in reports:
        bar.step(each)
    written = capsys.readouterr()
    assert written.out == ""
    return str(written.err)


def test_a_bar_appears_after_a_second_and_goes_when_the_work_is_done(terminal, capsys):
    assert drawn(capsys, report(1, 0.5), report(9, 0.9), report(10, 0.95)) == ""
    text = drawn(capsys, report(1, 0.5), report(4, 1.1), report(10, 2.0))
    assert "4/10" in text and "files read" in text
    assert text.split("\r")[-1].strip() == ""


def test_work_that_fails_leaves_no_bar(terminal, capsys):
    bar = WorkBar()
    bar.close()
    bar.step(report(4, 1.1))
    bar.close()
    text = str(capsys.readouterr().err)
    assert "4/10" in text and text.split("\r")[-1].strip() == ""


def test_one_bar_at_a_time(terminal, capsys):
    text = drawn(capsys, report(4, 1.1, "claims judged"), report(5, 1.5), report(10, 2.0))
    assert text.index("claims judged") < text.index("files read")


@pytest.mark.parametrize(
    ("options", "seen"),
    [({"quiet": True}, False), ({"quiet": False}, True), ({"progress": "plain"}, False), ({"progress": "auto"}, True)],
)
def test_options_of_the_command_decide(terminal, capsys, options, seen):
    with click.Context(click.Command("x")) as context:
        context.params = options
        assert ("4/10" in drawn(capsys, report(4, 1.1), report(10, 2.0))) == seen


def test_without_a_terminal_there_is_no_bar(capsys):
    assert drawn(capsys, report(4, 1.1), report(10, 2.0)) == ""


def test_tracked_work_tells_who_is_watching_how_much_is_done():
    seen: list[WorkProgress] = []
    assert list(tracked(range(3), "numbers")) == [0, 1, 2]
    with watching(seen.append):
        assert list(tracked(range(3), "numbers")) == [0, 1, 2]
        assert list(tracked((), "nothing")) == []
    assert list(tracked(range(2), "numbers")) == [0, 1]
    assert [(each.what, each.done, each.total) for each in seen][-1] == ("numbers", 3, 3)
