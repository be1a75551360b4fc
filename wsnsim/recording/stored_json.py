"""The JSON texts of a result, read so that a key that is missing or of another type is a fault of the file.

parsed(text, what) -> StoredKeys
"""

from __future__ import annotations

import json
from typing import Any, Final, final

from wsnsim.base.errors import ResultError

NUMBER: Final = (int, float)
TYPES: Final[dict[str, tuple[type, ...]]] = {
    "name": (str,), "seed": (int,), "replicates": (int,), "step": NUMBER, "duration": NUMBER,
    "command_line": (str,), "python": (str,), "packages": (dict,), "git": (dict, type(None)), "commit": (str,),
    "dirty": (bool,), "platform": (str,), "cpu_features": (list,), "plugins": (list,), "start": (str,), "end": (str,),
    "engine": (str,), "overrides": (list,),
}  # fmt: skip
"""Types of keys that are read from the resolved scenario and from the provenance."""


@final
class StoredKeys(dict[str, Any]):
    """A mapping of a stored text, whose missing keys raise ResultError. `of` says of which file and text."""

    of = ""

    def __missing__(self, key: str) -> Any:
        raise ResultError(f"{self.of} has no key '{key}'")


def parsed(text: str, what: str) -> StoredKeys:
    """The mapping in a JSON text.

    Args:
        text: the text.
        what: file and name of the text, as an error begins with it.

    Raises:
        ResultError: the text is no JSON, is no mapping, or a known key is of another type.
    """
    try:
        values = json.loads(text, object_hook=StoredKeys)
    except (ValueError, RecursionError) as error:
        raise ResultError(f"{what} is not JSON: {error}") from error
    if not isinstance(values, StoredKeys):
        raise ResultError(f"{what} is no mapping of keys")
    values.of = what
    for holder in (values, values.get("git")):
        for key, types in TYPES.items():
            if isinstance(holder, StoredKeys) and not isinstance(holder.get(key, types[0]()), types):
                raise ResultError(f"{what} has a key '{key}' of another type than wsnsim writes")
    if not all(
        isinstance(word, str) for key in ("cpu_features", "plugins", "overrides") for word in values.get(key, ())
    ):
        raise ResultError(f"{what} has a list of something else than texts")
    return values
