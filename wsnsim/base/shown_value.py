"""Values of arguments as error messages show them.

shown_value(5) -> '5'      shown_value(DataFrame) -> 'a DataFrame'
"""

from __future__ import annotations

from typing import Any, Final

LONGEST: Final = 80
"""Characters of a value in a message."""


def shown_value(value: Any) -> str:
    """Return a value as a message shows it: cut where it is long, and its type where it takes several lines."""
    text = repr(value)
    if "\n" in text:
        return f"a {type(value).__name__}"
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 3]}..."
