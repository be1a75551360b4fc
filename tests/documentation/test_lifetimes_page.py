"""docs/lifetimes.md holds what was registered."""

from __future__ import annotations

import hashlib

from tests.papers import lifetimes_study as study

TEXT = study.PAGE.read_text(encoding="utf-8")


def test_what_was_registered_stands_word_for_word():
    registered = TEXT[TEXT.index("## What was registered") : TEXT.index("## Answers")]
    found = hashlib.sha256(" ".join(registered.split()).encode()).hexdigest()
    assert found == "b802578ff33bc71ba37f7c7e599bf88539d618a024c5b2551fd329ba2451ff8a"
