"""Progress bars of Python: a widget in Jupyter, a line on a terminal.

with shown(True, "run") as step: step(done, total)
"""

from __future__ import annotations

import contextlib
import importlib.util
import sys
from collections.abc import Callable, Iterator
from typing import Any, Final

WAIT: Final = 1.0
"""Seconds before a bar appears: shorter work needs none."""
BAR: Final = "{desc}: {percentage:3.0f}%|{bar}| {n:.3g}/{total:g} {unit} [{elapsed}<{remaining}]"

Step = Callable[[float, float], None]
"""Called with how much is done, and how much there is."""


def in_notebook() -> bool:
    """Return whether this is the kernel of a notebook."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return type(shell).__name__ == "ZMQInteractiveShell"


@contextlib.contextmanager
def shown(wanted: object, what: str, unit: str) -> Iterator[Step | None]:
    """A function that moves a bar, or None if none is wanted.

    Args:
        wanted: True or False; None: in a notebook; anything else, such as a function of the caller: no bar.
        what: the text in front of it.
        unit: what is counted.
    """
    if not (in_notebook() if wanted is None else wanted is True):
        yield None
        return
    bar: Any = _bar_class()(total=1.0, desc=what, unit=unit, delay=WAIT, leave=False, bar_format=BAR)

    def step(done: float, total: float) -> None:
        bar.total = total
        bar.update(min(done, total) - bar.n)

    try:
        yield step
    finally:
        bar.close()


def _bar_class() -> Any:
    """The widget where Jupyter can show it, else a line of text."""
    if in_notebook() and importlib.util.find_spec("ipywidgets"):
        from tqdm.notebook import tqdm as widget

        return widget
    from tqdm import tqdm

    return tqdm
