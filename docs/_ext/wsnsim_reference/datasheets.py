"""The page of the datasheets: the fields of each sort, and the values of the shipped ones with their sources."""

from __future__ import annotations

from collections.abc import Iterator

from wsnsim.models.datasheets import ProcessorSheet, RadioSheet
from wsnsim.scenario.datasheets import Datasheet, datasheet
from wsnsim.scenario.parameter_info import as_written, parameters_of
from wsnsim.scenario.texts import shipped_parts
from wsnsim_reference.markdown import code, escaped, generated, table

SORTS = {"radio": RadioSheet, "processor": ProcessorSheet}


def page() -> str:
    """Return the text of the page."""
    shipped = {name: datasheet(path) for name, path in shipped_parts().items()}
    return generated(
        "Datasheets",
        "`energy: {kind: states, radio: cc2420, processor: msp430f1611}` names two datasheets: YAML files with the "
        "power of a radio and of a processor in each state. `wsnsim list datasheets` lists those that are shipped, "
        "and `wsnsim info datasheet cc2420` shows one. A file `mine.yaml` beside the scenario, with `sheet: radio` (or "
        "`processor`) and the fields below, is used by `radio: mine`; its key `sources` says where each value is from. "
        "A scenario may change a value: `energy.radio.receive`.",
        *(block for sort in SORTS for block in _fields(sort)),
        *(block for name, sheet in shipped.items() for block in _sheet(name, sheet)),
    )


def _fields(sort: str) -> Iterator[str]:
    yield f"## Fields of a {sort}"
    rows = [
        [code(one.name), "required" if one.default is None else code(one.default), f"{escaped(one.meaning)}. "
         f"*{escaped(one.takes)}*"]
        for one in parameters_of(SORTS[sort])
    ]  # fmt: skip
    yield table(("field", "default", "meaning, and *what it takes*"), rows)


def _sheet(name: str, sheet: Datasheet) -> Iterator[str]:
    given = {value.field: value for value in sheet.values}
    yield f"## {name}"
    yield f"{escaped(str(given['name'].value))}, a {sheet.sheet}, from {escaped(str(given['source'].value))}."
    rows = [
        [code(value.field), escaped(_written(value.written)), escaped(value.source)]
        for value in sheet.values
        if value.field not in ("name", "source") and value.written is not None
    ]
    yield table(("field", "value", "source"), rows)


def _written(value: object) -> str:
    if isinstance(value, list | tuple):
        return ", ".join(_written(item) for item in value)
    return as_written(value)
