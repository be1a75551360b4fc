"""Markdown as MyST reads it: plain text escaped, tables, fences."""

from __future__ import annotations

import re
from collections.abc import Sequence

SPECIAL = re.compile(r"([\\*_<>\[\]$#|~{}])")


PIPE = re.compile(r"(?<!\\)[|]")
"""A pipe that would end a cell."""


def escaped(text: str) -> str:
    """Return plain text as Markdown; what stands between backticks stays code."""
    pieces = re.split(r"(`[^`]+`)", text)
    return "".join(piece if i % 2 else SPECIAL.sub(r"\\\1", piece) for i, piece in enumerate(pieces))


def code(text: str) -> str:
    """Return a text as code in a line."""
    return f"`{text}`" if text else ""


def table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table of cells that are Markdown."""
    lines = [headings, ["---"] * len(headings), *rows]
    return "\n".join("| " + " | ".join(PIPE.sub(r"\\|", cell) for cell in line) + " |" for line in lines)


def fence(language: str, text: str) -> str:
    """Return a block of code."""
    return f"```{language}\n{text.rstrip()}\n```"


def generated(title: str, *blocks: str) -> str:
    """Return a page with a title and blocks."""
    return "\n\n".join([f"# {title}", *(block for block in blocks if block)]) + "\n"
