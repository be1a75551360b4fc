"""Random changes of texts and bytes: what editors, disks and strangers do to files."""

from __future__ import annotations

import random
from typing import Final

NASTY: Final = (
    "", "~", "null", "true", ".nan", ".inf", "-.inf", "0", "-1", "1e400", "1e-400", "9" * 400, "0x1F", "1_000", "012",
    "60 m", "60 parsec", "-5 s", "1e308 m", "[]", "{}", "[[[[]]]]", "{kind: }", "'", '"', "!!python/object:os.system x",
    "&a [*a]", "*a", "<<: *a", "|", "a: b: c", "- - -", "? x", "\t", "%", "@", "`", "é\u202e", "\\x1b[31m", "\u2028",
    "{kind: pso_mhfp}", "[1, 2, three]", "2026-11-22", "12:30:00", "no", "1 /m", "5 dBm", "\ud7ff", "x" * 5000,
)  # fmt: skip
"""Values that YAML, units or bounds may stumble over."""
CONTROL: Final = ("\x1b[2J", "\x00", "\x07", "\x9b", "\r", "\u202e", "\u2066", "\ufeff", "\x7f")


def mutated_text(text: str, rng: random.Random) -> bytes:
    """A text after one to four random changes of its lines and values, then perhaps of its bytes."""
    lines = text.split("\n")
    for _ in range(rng.randint(1, 4)):
        rng.choice(CHANGES)(lines, rng)
        if not lines:
            break
    content = "\n".join(lines).encode("utf-8", "surrogatepass")
    return mutated_bytes(content, rng) if rng.random() < 0.15 else content


def mutated_bytes(content: bytes, rng: random.Random) -> bytes:
    """Bytes after random changes: bits flipped, a piece cut out, doubled or overwritten, the end cut off."""
    found = bytearray(content)
    for _ in range(rng.randint(1, 3)):
        if not found:
            break
        begin = rng.randrange(len(found))
        end = min(len(found), begin + rng.choice([1, 2, 4, 8, 64, 1024]))
        how = rng.randrange(5)
        if how == 0:
            found[begin] ^= 1 << rng.randrange(8)
        elif how == 1:
            del found[begin:end]
        elif how == 2:
            found[begin:begin] = found[begin:end]
        elif how == 3:
            found[begin:end] = bytes([rng.choice([0, 255, rng.randrange(256)])]) * (end - begin)
        else:
            del found[begin:]
    return bytes(found)


def _delete(lines: list[str], rng: random.Random) -> None:
    del lines[rng.randrange(len(lines))]


def _double(lines: list[str], rng: random.Random) -> None:
    row = rng.randrange(len(lines))
    lines.insert(rng.randrange(len(lines)), lines[row])


def _indent(lines: list[str], rng: random.Random) -> None:
    row = rng.randrange(len(lines))
    lines[row] = rng.choice(["  ", " ", "\t", "- "]) + lines[row]


def _value(lines: list[str], rng: random.Random) -> None:
    """Replace what follows a colon or a comma."""
    row = rng.randrange(len(lines))
    pieces = [place for place, character in enumerate(lines[row]) if character in ":,"]
    if pieces:
        place = rng.choice(pieces) + 1
        ends = [place + offset for offset, character in enumerate(lines[row][place:]) if character in ",}]#"]
        lines[row] = lines[row][:place] + " " + rng.choice(NASTY) + lines[row][min(ends, default=len(lines[row])) :]


def _key(lines: list[str], rng: random.Random) -> None:
    """Change a character of the line."""
    row = rng.randrange(len(lines))
    if lines[row]:
        place = rng.randrange(len(lines[row]))
        lines[row] = lines[row][:place] + rng.choice([*CONTROL, "", "x", ":", "é"]) + lines[row][place + 1 :]


def _swap(lines: list[str], rng: random.Random) -> None:
    one, other = rng.randrange(len(lines)), rng.randrange(len(lines))
    lines[one], lines[other] = lines[other], lines[one]


CHANGES: Final = (_delete, _double, _indent, _value, _value, _value, _key, _swap)
