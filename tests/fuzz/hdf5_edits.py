"""What a stranger with h5py could change in a result file: links, layouts, types, sizes, texts and values.

EDITS[name](file)        changes an open h5py.File
"""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import h5py
import numpy as np

Edit = Callable[[h5py.File], Any]


def _replace(name: str, /, **how: Any) -> Edit:
    """An edit that writes another dataset in place of a column; its attributes stay."""

    def edit(file: h5py.File) -> None:
        kept = dict(file[name].attrs)
        values = file[name][...] if file[name].shape else None
        options = {key: value(values) if callable(value) else value for key, value in how.items()}
        del file[name]
        file.create_dataset(name, **options).attrs.update(kept)

    return edit


def _link(name: str, link: Any) -> Edit:
    def edit(file: h5py.File) -> None:
        del file[name]
        file[name] = link

    return edit


def _set(holder: str, name: str, value: Any) -> Edit:
    def edit(file: h5py.File) -> None:
        file[holder].attrs[name] = value

    return edit


def _unset(holder: str, name: str) -> Edit:
    def edit(file: h5py.File) -> None:
        del file[holder].attrs[name]

    return edit


def _remove(name: str) -> Edit:
    def edit(file: h5py.File) -> None:
        del file[name]

    return edit


def _text(name: str, text: Any) -> Edit:
    def edit(file: h5py.File) -> None:
        del file[name]
        file[name] = text

    return edit


def _json(name: str, /, **changes: Any) -> Edit:
    """An edit of keys of a JSON text; None removes one."""

    def edit(file: h5py.File) -> None:
        values = json.loads(file[name][()]) | changes
        del file[name]
        file[name] = json.dumps({key: value for key, value in values.items() if value is not None})

    return edit


def _values(name: str, value: Any, at: Any = slice(None)) -> Edit:
    def edit(file: h5py.File) -> None:
        file[name][at] = value

    return edit


def _swap(one: str, other: str) -> Edit:
    def edit(file: h5py.File) -> None:
        file.move(one, "aside")
        file.move(other, one)
        file.move("aside", other)

    return edit


def _virtual(file: h5py.File) -> None:
    rows = len(file["truth/time"])
    layout = h5py.VirtualLayout((rows,), "f8")
    layout[:] = h5py.VirtualSource("/etc/passwd", "x", (rows,))
    del file["truth/time"]
    file.create_virtual_dataset("truth/time", layout)


def _chunk(raw: bytes, mask: int = 0, **how: Any) -> Edit:
    """An edit that stores these bytes as the only chunk of a column."""

    def edit(file: h5py.File) -> None:
        rows = len(file["truth/time"])
        del file["truth/time"]
        made = file.create_dataset("truth/time", (rows,), "f8", chunks=(rows,), **how)
        made.id.write_direct_chunk((0,), raw, filter_mask=mask)

    return edit


def _state_count(file: h5py.File) -> None:
    file.attrs["states"] = [f"s{i}" for i in range(50_000)]


def _cycle(file: h5py.File) -> None:
    file["scenario/loop"] = file["/"]
    file["loop"] = file["/"]


def _crowd(file: h5py.File) -> None:
    for number in range(1_100):
        file[f"runs/more{number}"] = file["runs/rmse"]


def _nested(file: h5py.File) -> None:
    file["runs"].create_group("inner")["x"] = h5py.SoftLink("/runs/rmse")
    file["runs"].attrs["columns"] = ["inner/x", *file["runs"].attrs["columns"]]


EXTREME = np.iinfo(np.uint32).max
EDITS: dict[str, Edit] = {
    "external link": _link("runs/rmse", h5py.ExternalLink("/etc/passwd", "/x")),
    "external table": _link("truth", h5py.ExternalLink("/etc/passwd", "/")),
    "soft link": _link("runs/rmse", h5py.SoftLink("/runs/energy")),
    "dangling link": _link("runs", h5py.SoftLink("/nothing")),
    "external text": _link("scenario/resolved_json", h5py.ExternalLink("/etc/passwd", "/x")),
    "nested column": _nested,
    "hard cycle": _cycle,
    "thousands of objects": _crowd,
    "virtual": _virtual,
    "external storage": _replace(
        "truth/time", shape=lambda old: old.shape, dtype="u1", external=[("/etc/passwd", 0, 10_000)]
    ),
    "huge, nothing stored": _replace("truth/time", shape=(1 << 40,), dtype="f8"),
    "huge, chunks missing": _replace("truth/time", shape=(1 << 36,), dtype="f8", chunks=(65_536,), compression=1),
    "huge chunk": _replace("truth/time", data=np.zeros(100_000), chunks=(100_000,), compression=1),
    "wide table": _replace("truth/time", data=lambda old: np.zeros((len(old), 3))),
    "scalar column": _replace("truth/time", data=1.0),
    "no dataspace": _replace("truth/time", data=h5py.Empty("f8")),
    "shorter column": _replace("truth/time", data=lambda old: old[:-1]),
    "longer column": _replace("runs/rmse", data=lambda old: np.append(old, 1.0)),
    "texts as values": _replace("truth/time", data=lambda old: ["x"] * len(old)),
    "records as values": _replace("truth/time", data=lambda old: np.zeros(len(old), "f8,i4")),
    "references": _replace("truth/time", shape=lambda old: old.shape, dtype=h5py.ref_dtype),
    "lists as values": _replace("truth/time", shape=lambda old: old.shape, dtype=h5py.vlen_dtype("f8")),
    "complex values": _replace("truth/time", data=lambda old: old.astype("c16")),
    "big-endian": _replace("truth/time", data=lambda old: old.astype(">f8")),
    "negative runs": _replace("runs/replicate", data=lambda old: -1 - old.astype("i8")),
    "real steps": _replace("truth/step", data=lambda old: old + 0.5),
    "booleans": _replace("truth/step", data=lambda old: old > 3),
    "lzf": _replace("truth/time", data=lambda old: old, chunks=True, compression="lzf"),
    "checksummed": _replace("truth/time", data=lambda old: old, chunks=True, fletcher32=True),
    "short chunk": _chunk(b"\1" * 9, compression=1),
    "unfiltered chunk": _chunk(b"\1" * 9, 1, compression=1),
    "short plain chunk": _chunk(b"\1" * 9),
    "group as column": lambda file: (file.__delitem__("runs/rmse"), file.create_group("runs/rmse")),
    "column as table": lambda file: (file.__delitem__("truth"), file.create_dataset("truth", data=[1.0])),
    "type as column": lambda file: (file.__delitem__("runs/rmse"), file.__setitem__("runs/rmse", np.dtype("f8"))),
    "swapped columns": _swap("truth/time", "runs/rmse"),
    "swapped tables": _swap("truth", "runs"),
    "columns unknown": _set("runs", "columns", ["replicate", "nothing"]),
    "columns missing": _unset("runs", "columns"),
    "columns are numbers": _set("runs", "columns", [1, 2]),
    "columns are one text": _set("runs", "columns", "rmse"),
    "columns none": _set("runs", "columns", np.array([], dtype="S1")),
    "columns doubled": _set("runs", "columns", ["rmse", "rmse"]),
    "columns thousands": _set("runs", "columns", [f"c{i}" for i in range(3_000)]),
    "rows of texts": _set("runs", "rows", ["a", "b"]),
    "rows many": _set("runs", "rows", np.zeros(5_000, [("replicate", "u4"), ("rmse", "f8")])),
    "rows negative": _set("runs", "rows", np.full(2, -1, [("replicate", "i4"), ("rmse", "f8")])),
    "rows none": _set("runs", "rows", np.zeros(0, [("replicate", "u4")])),
    "words missing": _unset("runs/status", "flag_meanings"),
    "words a number": _set("runs/status", "flag_meanings", 3),
    "words of reals": _set("truth/time", "flag_meanings", "a b c"),
    "no status": _unset("/", "status"),
    "status a number": _set("/", "status", 3),
    "status hostile": _set("/", "status", "complete\x1b[2J\u202e"),
    "schema a text": _set("/", "schema_version", "one"),
    "schema a list": _set("/", "schema_version", [1, 1]),
    "schema negative": _set("/", "schema_version", -1),
    "states missing": _unset("/", "states"),
    "states thousands": _state_count,
    "states fewer": _set("/", "states", ["px"]),
    "states unknown": _set("/", "states", ["a", "b", "c", "d"]),
    "states hostile": _set("/", "state_units", ["$\\frac", "\x1b[2J", "\u202e", "m"]),
    "position outside": _set("/", "position", [0, 99]),
    "position negative": _set("/", "position", [-1, -2]),
    "position a text": _set("/", "position", "px"),
    "position real": _set("/", "position", [0.5, 1.5]),
    "no runs": _remove("runs"),
    "no truth": _remove("truth"),
    "no scenario": _remove("scenario"),
    "no provenance": _remove("provenance_json"),
    "text not JSON": _text("scenario/resolved_json", "{"),
    "text deep": _text("scenario/resolved_json", "[" * 100_000),
    "text a list": _text("scenario/resolved_json", "[1]"),
    "text empty": _text("scenario/resolved_json", ""),
    "text no UTF-8": _text("scenario/resolved_json", b"\xff\xfe{}"),
    "text an array": _text("scenario/resolved_json", ["a", "b"]),
    "text a number": _text("provenance_json", 3.5),
    "provenance a list": _text("provenance_json", "[]"),
    "provenance of others": _json("provenance_json", packages=[1], git="x", cpu_features=3),
    "git of others": _json("provenance_json", git={"commit": 3}),
    "scenario without step": _json("scenario/resolved_json", step=None),
    "scenario without name": _json("scenario/resolved_json", name=None, seed=None),
    "scenario of lists": _json("scenario/resolved_json", name=["x"], seed=[], step=[1], network=[], tracker=3),
    "scenario hostile": _json("scenario/resolved_json", name="\x1b[2J$\\frac{\u202e</script>"),
    "scenario endless": _json("scenario/resolved_json", step=0.0, duration=1e300),
    "scenario without sensor": _json("scenario/resolved_json", sensor=None, motion=None),
    "run numbers extreme": _values("runs/replicate", EXTREME),
    "steps extreme": _values("truth/step", EXTREME, -1),
    "steps all the same": _values("estimates/step", 3),
    "targets extreme": _values("estimates/target", 65_535, -1),
    "times endless": _values("truth/time", np.inf),
    "times backwards": _values("estimates/time", -1e300, 0),
    "states NaN": _values("truth/px", np.nan),
    "estimates endless": _values("estimates/px", np.inf),
    "errors NaN": _values("estimates/error", np.nan),
    "codes beyond the words": _values("runs/status", 255),
    "not from a run": lambda file: [file.__delitem__(name) for name in list(file)],
}  # fmt: skip
"""What is edited, by its name."""
