"""Kept answers: given again for the same question and the same code, and never when the file is damaged."""

from __future__ import annotations

import importlib
import json
import math

import numpy as np
import pytest

from wsnsim.base.errors import StorageError
from wsnsim.recording import kept
from wsnsim.recording.kept import KeptAnswers


@pytest.fixture
def place(tmp_path):
    return tmp_path / "kept" / "answers.json"


def refuse():
    raise AssertionError("it is kept")


def test_an_answer_is_given_again_with_every_bit(place):
    answer = {"values": [0.1 + 0.2, math.inf, math.nan, np.float64(1 / 3), np.int64(2**53 + 1)], "reason": ""}
    first = KeptAnswers(place).answer([1, "x"], lambda: answer)
    again = KeptAnswers(place).answer([1, "x"], refuse)
    assert repr(first) == repr(again)
    assert again["values"][:2] == [0.1 + 0.2, math.inf] and again["values"][3:] == [1 / 3, 2**53 + 1]


def test_another_question_and_other_code_are_answered_anew(place, monkeypatch):
    assert KeptAnswers(place).answer({"runs": 1}, lambda: 1) == 1
    assert KeptAnswers(place).answer({"runs": 2}, lambda: 2) == 2
    assert KeptAnswers(place).answer({"runs": 1}, refuse) == 1
    monkeypatch.setattr(kept, "code_digest", lambda: "of other code")
    assert KeptAnswers(place).answer({"runs": 1}, lambda: 3) == 3
    assert len(json.loads(place.read_text())["answers"]) == 1, "answers of former code are dropped"


@pytest.mark.parametrize("damage", [lambda text: text[:-9], lambda text: text.replace("12.5", "13.5"), lambda _: "[]"])
def test_a_damaged_file_is_not_believed(place, damage):
    KeptAnswers(place).answer("question", lambda: 12.5)
    place.write_text(damage(place.read_text()))
    assert KeptAnswers(place).answer("question", lambda: 14.5) == 14.5
    assert KeptAnswers(place).answer("question", refuse) == 14.5


def test_errors_are_not_kept_and_a_folder_may_be_read_only(place, monkeypatch):
    with pytest.raises(AssertionError):
        KeptAnswers(place).answer("question", refuse)

    def cannot_write(*_):
        raise StorageError("read-only")

    monkeypatch.setattr(kept, "write_text_atomically", cannot_write)
    assert KeptAnswers(place).answer("question", lambda: 1) == 1
    assert not place.exists()


def test_the_digest_is_that_of_every_source_file(tmp_path, monkeypatch):
    provenance = importlib.import_module("wsnsim.recording.provenance")  # the package has a function of this name
    package = tmp_path / "package"
    (package / "inner").mkdir(parents=True)
    monkeypatch.setattr(provenance, "__file__", str(package / "inner" / "x.py"))
    seen = set()
    for name, content in (("a.py", "1"), ("a.py", "2"), ("inner/b.yaml", ""), ("c.txt", "no code")):
        (package / name).write_text(content)
        provenance.code_digest.cache_clear()
        seen.add(provenance.code_digest())
    provenance.code_digest.cache_clear()
    assert len(seen) == 3
