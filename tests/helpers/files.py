"""Files that tests write."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml


def write_yaml(name: str, content: str | dict[str, Any]) -> str:
    """Write a text, or a dict as YAML, to a file below the working directory, and return the file's name."""
    text = content if isinstance(content, str) else yaml.safe_dump(content, sort_keys=False)
    Path(name).parent.mkdir(parents=True, exist_ok=True)
    Path(name).write_text(text, encoding="utf-8")
    return name
