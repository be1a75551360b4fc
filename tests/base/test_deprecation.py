import importlib
from pathlib import Path

import pytest

import wsnsim
from wsnsim.base.deprecation import MOVED

ROOT = Path(wsnsim.__file__).parents[1]
USED = {
    "wsnsim.base.asks": ("Ask", "Gather", "Member", "Parcel", "PACKET_BITS", "all_arrived"),
    "wsnsim.base.bench": ("sensed",),
    "wsnsim.base.loopback": ("perform", "perfect", "silent", "Lose"),
    "wsnsim.base.problem": ("Common", "Problem", "Radio", "Parts", "Beacons"),
}


@pytest.mark.parametrize("module", MOVED)
def test_a_former_module_gives_the_new_objects_with_a_warning(module):
    old, new = importlib.import_module(module), MOVED[module]
    for name in USED[module]:
        now = new.renamed.get(name, name)
        with pytest.warns(DeprecationWarning, match=f"{module}.{name} is now {new.module}.{now}"):
            value = getattr(old, name)
        assert value is getattr(importlib.import_module(new.module), now)
    with pytest.raises(AttributeError):
        _ = old.nothing_of_the_kind


def test_the_list_names_every_module_that_only_forwards_and_nothing_imports_one():
    forwards, imported = set(), []
    for path in sorted((ROOT / "wsnsim").rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        if "return moved(__name__, name)" in text:
            forwards.add(".".join(path.relative_to(ROOT).with_suffix("").parts))
        imported += [(path, module) for module in MOVED if f"from {module} import" in text]
    assert forwards == set(MOVED) and not imported
