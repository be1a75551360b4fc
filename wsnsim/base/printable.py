r"""Texts of files, plug-ins and names as they are printed: characters that steer a terminal become escapes.

printable(text) -> text        printable_json(text) -> text        shortened(text) -> text

A name such as 'x\x1b[2J' would clear the terminal, and bidirectional characters reorder a line. Both are shown as in a
Python literal (\x1b, \u202e), in JSON as in a JSON string (\u001b).
"""

from __future__ import annotations

import unicodedata


def printable(text: str) -> str:
    """The text with every character escaped that is neither visible nor a space, a tab or the end of a line."""
    return text if _is_plain(text) else "".join(c if _is_shown(c) else _escaped(c) for c in text)


def shortened(text: str, most: int = 60) -> str:
    """The text, or its beginning and its end with '…' between them if it has more than `most` characters."""
    return text if len(text) <= most else f"{text[: most - 10]}…{text[-9:]}"


def printable_json(text: str) -> str:
    """The JSON text with the same characters escaped as JSON escapes them; it holds the same values."""
    return text if _is_plain(text) else "".join(c if _is_shown(c) else _escaped_json(c) for c in text)


def _is_plain(text: str) -> bool:
    """Whether nothing is escaped: a quick answer for most texts."""
    return text.replace("\n", "").replace("\t", "").isprintable()


def _is_shown(c: str) -> bool:
    return c.isprintable() or c in "\n\t" or unicodedata.category(c) == "Zs"


def _escaped(c: str) -> str:
    return c.encode("unicode_escape").decode("ascii")


def _escaped_json(c: str) -> str:
    units = c.encode("utf-16-be", "surrogatepass")
    return "".join(f"\\u{units[i]:02x}{units[i + 1]:02x}" for i in range(0, len(units), 2))
