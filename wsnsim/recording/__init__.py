"""Rows become a file: HDF5, one group a table, one dataset a column. h5py lives here.

with ResultFile(path, states, wanted) as file:      a base.ports.Recorder; the final name is always a complete file
    file.write("truth", {"replicate": 0, "target": 0, "step": steps, ...})
read_table(path, "truth") -> {column: array}        plain NumPy; also tables, meanings, read_text, attributes
recover(tmp) -> path                                what a killed run left
Folder(path)                                        a campaign on disk: a manifest, and a folder of files a point
provenance(command_line, seed, plugins) -> dict     what made a result
"""

from wsnsim.recording.folder import Folder, Manifest, PointOnDisk
from wsnsim.recording.provenance import provenance
from wsnsim.recording.reader import (
    TableSize,
    attributes,
    meanings,
    read_table,
    read_text,
    read_with_meanings,
    tables,
)
from wsnsim.recording.recovery import recover
from wsnsim.recording.writer import ResultFile

__all__ = [
    "Folder",
    "Manifest",
    "PointOnDisk",
    "ResultFile",
    "TableSize",
    "attributes",
    "meanings",
    "provenance",
    "read_table",
    "read_text",
    "read_with_meanings",
    "recover",
    "tables",
]
