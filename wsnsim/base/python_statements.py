"""Statements of Python files as tokens, without a parser.

CPython before 3.11.8 and 3.12.2 raises SystemError where two threads call `ast.parse` at the same time
(https://github.com/python/cpython/issues/106905), and threads of users may call it at any time. A parser would also
print the warnings of a file each time.
"""

from __future__ import annotations

import io
import tokenize
from collections.abc import Iterator
from typing import Final

NOT_PYTHON: Final = (SyntaxError, ValueError, tokenize.TokenError)
"""What `statements` raises where it finds that a file is not Python."""


def statements(source: bytes) -> Iterator[list[tokenize.TokenInfo]]:
    """The names and operators of each simple statement, and of each header of a compound statement up to its colon."""
    tokens: list[tokenize.TokenInfo] = []
    depth = 0
    for token in tokenize.tokenize(io.BytesIO(source).readline):
        ends = token.type == tokenize.NEWLINE
        if token.type == tokenize.OP:
            depth += (token.string in {"(", "[", "{"}) - (token.string in {")", "]", "}"})
            ends = not depth and token.string in {";", ":"}
        if ends and tokens:
            yield tokens
            tokens = []
        elif not ends and token.type in {tokenize.NAME, tokenize.OP}:
            tokens.append(token)
