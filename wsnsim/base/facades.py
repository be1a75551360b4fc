"""Façades: modules that hand on the names of others, which are imported at first use.

if TYPE_CHECKING:
    from wsnsim.models.links import Disk as Disk, Disk as DiskLink

__getattr__, __dir__ = facade(__name__)        the imports above are the only list of the names
"""

from __future__ import annotations

import functools
import importlib
import re
import sys
from collections.abc import Callable, Collection
from typing import Any, Final

_ALIAS: Final = re.compile(r"^    (\w+) = (\w+)$", re.MULTILINE)
_IMPORT: Final = re.compile(r"^    from (wsnsim\.[\w.]+) import (\([^()]+\)|[^()\n]+)$", re.MULTILINE)


def facade(module: str, modules: Collection[str] = ()) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Return `__getattr__` and `__dir__` of a module whose names its imports for type checkers list.

    Args:
        module: Name of the module, which is being imported.
        modules: Modules inside it that are imported when they are named, too.
    """

    def get(name: str) -> Any:
        if name in modules:
            return importlib.import_module(f"{module}.{name}")
        if name == "__all__":
            return sorted(homes(module))
        if name.startswith("__") or name not in homes(module):
            from wsnsim.base.errors import did_you_mean

            hint = did_you_mean(name, homes(module))
            raise AttributeError(f"module {module!r} has no attribute {name!r} ({hint})")
        home, own = homes(module)[name]
        return getattr(importlib.import_module(home), own)

    return get, lambda: sorted(homes(module))


@functools.cache
def homes(module: str) -> dict[str, tuple[str, str]]:
    """Return {name: (module, name there)} of what a façade hands on, read from its source."""
    text = sys.modules[module].__spec__.loader.get_source(module)  # type: ignore[union-attr]
    source = text.partition("if TYPE_CHECKING:")[2]
    imports = ((home, names.strip("()").split(",")) for home, names in _IMPORT.findall(source))
    found = {name.split()[0]: home for home, names in imports for name in names if name.strip()}
    return {name: (home, name) for name, home in found.items()} | {
        alias: (found[name], name) for alias, name in _ALIAS.findall(source)
    }
