"""The template of a page: its static files, its slots, and the policy that lets only its own script run."""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import Mapping, Sequence
from importlib.resources import files
from typing import Final

SLOT: Final = re.compile(r"\{\{(\w+)\}\}")


def static_text(name: str, package: str = "wsnsim.report") -> str:
    """A file of a package's folder `static`."""
    return (files(package) / "static" / name).read_text(encoding="utf-8")


def script_of(sources: Sequence[str]) -> str:
    """One script of several, whose names are not visible outside."""
    return '"use strict";\n{\n' + "".join(sources) + "}\n"


def source_of(script: str) -> str:
    """The source expression of a Content-Security-Policy that allows this script."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()}'"


def filled(template: str, slots: Mapping[str, str]) -> str:
    """The template with all slots filled in one pass, because an inserted text may contain a slot."""
    return SLOT.sub(lambda slot: slots[slot[1]], template)
