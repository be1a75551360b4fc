"""What counts as a code line."""

from __future__ import annotations

from tests.size import code_lines

TEXT = '''"""A module
of two lines."""

import math  # a comment behind code


# a comment
class One:
    """A class."""

    text = """no
docstring"""

    def of(self) -> float:
        """A method."""
        return math.pi
'''


def test_blank_lines_comments_and_docstrings_are_not_counted() -> None:
    assert code_lines(TEXT) == len(["import", "class", "text", "docstring", "def", "return"])
