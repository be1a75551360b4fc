"""Result files: HDF5 with one group per table and one dataset per column. Only this package imports h5py.

with ResultFile(path, states, wanted) as file:      # a base.ports.Recorder; a file with its final name is complete
    file.write("truth", {"replicate": 0, "target": 0, "step": steps, ...})
with MemoryResult(states, wanted) as result:        # the same in memory; result.save(path) writes the file
read_table(path, "truth")                           # {column: array}; see also tables, read_text, attributes
recover(tmp)                                        # the rows of a killed run
Folder(path)                                        # a campaign on disk: a manifest, and a folder per point
provenance.provenance(command_line, seed, plugins)  # versions, command and machine

The modules are imported at first use: a run reads no result, and nothing reads a campaign but campaigns.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from wsnsim.base.facades import facade

if TYPE_CHECKING:
    # fmt: off
    # isort: off
    from wsnsim.recording.folder import Folder as Folder, Manifest as Manifest, PointOnDisk as PointOnDisk
    from wsnsim.recording.reader import (
        TableSize as TableSize, all_meanings as all_meanings, attributes as attributes, meanings as meanings,
        read_json as read_json, read_table as read_table, read_text as read_text,
        read_with_meanings as read_with_meanings, row_count as row_count, table_names as table_names, tables as tables,
    )
    from wsnsim.recording.recovery import recover as recover
    from wsnsim.recording.writer import MemoryResult as MemoryResult, ResultFile as ResultFile

__getattr__, __dir__ = facade(__name__)
