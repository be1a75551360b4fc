"""Complete chunks of a killed run are recovered; anything else is refused with a reason."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

from wsnsim.base.errors import ResultError
from wsnsim.base.tables import RECORDED_BY_DEFAULT
from wsnsim.recording import ResultFile, attributes, meanings, read_table, read_text, recover, tables

WRITES_UNTIL_KILLED = """
import sys, time
from pathlib import Path
import numpy as np
from wsnsim.base.tables import RECORDED_BY_DEFAULT
from wsnsim.recording import ResultFile, rows

rows.FLUSH_EVERY = float(sys.argv[2])
with ResultFile(Path(sys.argv[1]), (("px", "m"), ("vx", "m/s")), RECORDED_BY_DEFAULT) as file:
    file.set_text("scenario/source_yaml", "name: killed")
    file.set_text("provenance_json", '{"start": "then"}')
    code = file.words.code("weights")
    for start in range(0, 200_000, 40_000):
        node = np.arange(start, start + 40_000, dtype="i4")
        event = {"replicate": 0, "time": node * 1e-3, "step": 1, "target": 0, "node": node, "kind": 7, "what": code}
        event |= {"frame": 0, "sequence": 0, "peer": -1, "packets": 1, "bits": 96, "joules": 0.5, "cause": 1}
        file.write("events", event)
        file.write("energy", {"replicate": 0, "node": node[:100], "cause": 0, "joules": 1.0})
    print("written", flush=True)
    time.sleep(60)
"""


def killed_run(folder: Path, flush_every: float) -> Path:
    """The temporary file of a run that wrote 200,000 events, three chunks and a rest, and was killed by signal 9."""
    command = [sys.executable, "-c", WRITES_UNTIL_KILLED, str(folder / "run.h5"), str(flush_every)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "written\n"
        process.send_signal(signal.SIGKILL)
    (tmp,) = folder.iterdir()
    return tmp


@pytest.mark.thorough
@pytest.mark.parametrize(("flush_every", "chunks"), [(0.0, 3), (30.0, 1)])
def test_a_killed_run_leaves_no_final_file_and_its_flushed_chunks_can_be_recovered(tmp_path, flush_every, chunks):
    tmp = killed_run(tmp_path, flush_every)
    assert tmp.suffix == ".tmp"
    with pytest.raises(ResultError, match="wsnsim recover"):
        read_table(tmp, "events")
    out = recover(tmp)
    assert out == tmp_path / "run.h5"
    events = read_table(out, "events")
    rows = chunks * 65_536
    np.testing.assert_array_equal(events["node"], np.arange(rows))
    np.testing.assert_array_equal(events["time"], np.arange(rows) * 1e-3)
    assert {len(column) for column in events.values()} == {rows}
    assert meanings(out, "events", "what") == ("none", "weights")
    assert {name: size.rows for name, size in tables(out).items() if size.rows} == {"events": rows}
    assert list(tables(out)) == [name for name, wanted in RECORDED_BY_DEFAULT.items() if wanted]
    assert attributes(out)["status"] == "partial"
    assert attributes(out)["states"] == (("px", "m"), ("vx", "m/s"))
    assert read_text(out, "scenario/source_yaml") == "name: killed"
    assert json.loads(read_text(out, "provenance_json")) == {"start": "then"}
    assert tmp.exists()


@pytest.fixture(scope="module")
def left_behind(tmp_path_factory) -> bytes:
    """The bytes of a killed run's temporary file with three whole chunks of events."""
    return killed_run(tmp_path_factory.mktemp("killed"), 0.0).read_bytes()


@pytest.fixture
def tmp(tmp_path, left_behind) -> Path:
    path = tmp_path / "run.host.17.tmp"
    path.write_bytes(left_behind)
    return path


@pytest.mark.thorough
def test_a_final_file_is_not_overwritten_unless_it_is_named(tmp_path, tmp):
    (tmp_path / "run.h5").write_text("precious")
    with pytest.raises(ResultError, match="exists; give another file"):
        recover(tmp)
    assert (tmp_path / "run.h5").read_text() == "precious"
    assert recover(tmp, tmp_path / "run.h5") == tmp_path / "run.h5"
    assert tables(tmp_path / "run.h5")["events"].rows == 3 * 65_536


@pytest.mark.thorough
def test_a_column_that_fell_behind_shortens_the_others(tmp_path, tmp):
    with h5py.File(tmp, "r+") as file:
        file["events/peer"].resize((2 * 65_536 + 5,))
        file["events/bits"].resize((4 * 65_536,))
    assert tables(recover(tmp))["events"].rows == 2 * 65_536


@pytest.mark.thorough(fast=["5000"])
@pytest.mark.parametrize("cut", [0, 7, 90, 5_000, -3_000])
def test_a_truncated_temporary_file_is_refused_with_a_reason(tmp_path, tmp, cut):
    tmp.write_bytes(tmp.read_bytes()[:cut])
    with pytest.raises(ResultError, match=r"(is not a wsnsim result|cannot be read): \w"):
        recover(tmp)
    assert [path.name for path in tmp_path.iterdir()] == [tmp.name]


@pytest.mark.thorough
@pytest.mark.parametrize(("column", "chunk", "left"), [("node", 2, 2), ("time", 1, 1), ("node", 0, 0)])
def test_damaged_rows_are_never_recovered(tmp_path, tmp, column, chunk, left):
    with h5py.File(tmp) as file:
        place = file["events"][column].id.get_chunk_info(chunk)
    damaged = bytearray(tmp.read_bytes())
    damaged[place.byte_offset + place.size // 2] ^= 0x10
    tmp.write_bytes(damaged)
    if not left:
        with pytest.raises(ResultError, match="no complete chunk"):
            recover(tmp)
        assert [path.name for path in tmp_path.iterdir()] == [tmp.name]
        return
    events = read_table(recover(tmp), "events")
    assert {len(values) for values in events.values()} == {left * 65_536}
    np.testing.assert_array_equal(events["node"], np.arange(left * 65_536))


def test_what_is_not_hdf5_is_refused(tmp_path):
    (tmp_path / "run.host.17.tmp").write_text("name: a scenario, not a result\n")
    with pytest.raises(ResultError, match="is not a wsnsim result"):
        recover(tmp_path / "run.host.17.tmp")
    with pytest.raises(ResultError, match="no such file"):
        recover(tmp_path / "run.host.18.tmp")


def test_a_run_that_filled_no_chunk_left_nothing_to_recover(tmp_path, states, rows_of):
    kept = tmp_path / "run.host.17.tmp"
    with ResultFile(tmp_path / "run.h5", states, {"truth": True}) as file:
        file.write("truth", rows_of("truth", 100))
        (tmp,) = tmp_path.iterdir()
        kept.write_bytes(tmp.read_bytes())
    (tmp_path / "run.h5").unlink()
    with pytest.raises(ResultError, match="no complete chunk"):
        recover(kept)


def test_a_finished_result_needs_no_recovery(tmp_path, states):
    with ResultFile(tmp_path / "x.h5", states, {"truth": True}):
        pass
    with pytest.raises(ResultError, match="complete result"):
        recover(tmp_path / "x.h5", tmp_path / "y.h5")


@pytest.mark.thorough
def test_a_run_that_still_writes_is_left_alone(tmp_path, states, rows_of):
    with ResultFile(tmp_path / "x.h5", states, {"truth": True}) as file:
        file.write("truth", rows_of("truth", 70_000))
        (tmp,) = tmp_path.iterdir()
        script = "import sys; from wsnsim.recording import recover; recover(sys.argv[1])"
        done = subprocess.run([sys.executable, "-c", script, str(tmp)], capture_output=True, text=True, timeout=60)
    assert "is still being written" in done.stderr
    assert tables(tmp_path / "x.h5")["truth"].rows == 70_000


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("name", "final"), [("a.b.node-1.17.tmp", "a.b.h5"), ("x.host.17-2.tmp", "x.h5"), ("x.hdf5.h.1.tmp", "x.hdf5.h5")]
)
def test_the_final_name_is_read_from_the_temporary_one(tmp_path, left_behind, name, final):
    (tmp_path / name).write_bytes(left_behind)
    assert recover(tmp_path / name) == tmp_path / final


def test_a_name_that_says_nothing_needs_to_be_told_where_to_write(tmp_path, left_behind):
    (tmp_path / "rescued").write_bytes(left_behind)
    with pytest.raises(ResultError, match=r"is not named NAME\.host\.pid\.tmp"):
        recover(tmp_path / "rescued")
    assert recover(tmp_path / "rescued", tmp_path / "y.h5") == tmp_path / "y.h5"
