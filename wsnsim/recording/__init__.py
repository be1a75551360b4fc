"""Result files: HDF5 with one group per table and one dataset per column. Only this package imports h5py.

with ResultFile(path, states, wanted) as file:      # a base.ports.Recorder; a file with its final name is complete
    file.write("truth", {"replicate": 0, "target": 0, "step": steps, ...})
with MemoryResult(states, wanted) as result:        # the same in memory; result.save(path) writes the file
read_table(path, "truth")                           # {column: array}; see also tables, read_text, attributes
recover(tmp)                                        # the rows of a killed run
Folder(path)                                        # a campaign on disk: a manifest, and a folder per point
provenance(command_line, seed, plugins)             # versions, command and machine
"""

from wsnsim.recording.folder import Folder, Manifest, PointOnDisk
from wsnsim.recording.provenance import provenance
from wsnsim.recording.reader import (
    TableSize,
    all_meanings,
    attributes,
    meanings,
    read_json,
    read_table,
    read_text,
    read_with_meanings,
    row_count,
    table_names,
    tables,
)
from wsnsim.recording.recovery import recover
from wsnsim.recording.writer import MemoryResult, ResultFile

__all__ = [
    "Folder",
    "Manifest",
    "MemoryResult",
    "PointOnDisk",
    "ResultFile",
    "TableSize",
    "all_meanings",
    "attributes",
    "meanings",
    "provenance",
    "read_json",
    "read_table",
    "read_text",
    "read_with_meanings",
    "recover",
    "row_count",
    "table_names",
    "tables",
]
