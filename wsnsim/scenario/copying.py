"""The text of a scenario that starts from another one."""

from __future__ import annotations

import yaml

from wsnsim.scenario.build import resolved
from wsnsim.scenario.load import load


def text_like(source: str, name: str) -> str:
    """Return the text of a scenario that extends another one, whose values stand in comments."""
    values = {key: value for key, value in resolved(load(source)).items() if key != "name"}
    whole = (yaml.safe_dump({key: value}, default_flow_style=True, width=10**9, sort_keys=False).strip()
             for key, value in values.items())  # fmt: skip
    lines = [f"# {text[1:-1]}\n" for text in whole]  # without the braces of the mapping
    return (
        f"# As {source}, but for what you change: take the '#' from a line and change its values, in SI units.\n"
        f"{yaml.safe_dump({'extends': source, 'name': name}, sort_keys=False)}\n{''.join(lines)}"
    )
