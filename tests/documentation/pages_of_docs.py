"""Reads pages of docs: their text and their fenced blocks."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]


def text(name: str) -> str:
    """The text of a page, by its path from the root."""
    return (ROOT / name).read_text(encoding="utf-8")


def fences(name: str, language: str) -> list[str]:
    """The fenced blocks of a page in a language, without a line that names a file."""
    found = re.findall(rf"^```{language}\n(.*?)^```", text(name), re.DOTALL | re.MULTILINE)
    return [re.sub(r"\A# file: \S+\n", "", block) for block in found]


def block(page: str, name: str) -> str:
    """What `make readme` wrote between the marks of a block."""
    pattern = rf"<!-- {name}: made by make readme -->\n(.*?)<!-- end of {name} -->"
    (found,) = re.findall(pattern, text(page), re.DOTALL)
    return found.strip()
