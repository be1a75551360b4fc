import numpy as np
import pytest

from wsnsim.base.tables import TABLES, Memory, Words, columns_of


def test_state_columns_stand_where_the_contract_puts_them():
    names = [column.name for column in columns_of("estimates", (("px", "m"), ("vx", "m/s")))]
    assert names[:8] == ["replicate", "target", "step", "time", "issued", "px", "vx", "sd_x"]
    assert [c.name for c in columns_of("truth", (("x", "m"),))] == ["replicate", "target", "step", "time", "x"]


def test_every_column_says_what_it_holds_and_every_table_begins_with_its_replicate():
    for name, columns in TABLES.items():
        assert columns[0].name == "replicate", name
        assert all(column.description for column in columns)
        assert len({column.name for column in columns}) == len(columns)


def test_memory_joins_pieces_and_spreads_scalars():
    memory = Memory({"energy": True})
    memory.write("energy", {"replicate": 1, "node": [1, 2], "cause": 3, "joules": np.array([0.5, 0.25])})
    memory.write("energy", {"replicate": 2, "node": [7], "cause": 4, "joules": [1.0]})
    table = memory.table("energy")
    assert table["replicate"].tolist() == [1, 1, 2]
    assert table["node"].tolist() == [1, 2, 7]
    assert memory.table("events") == {}
    assert memory.wants("energy") and not memory.wants("events")


def test_words_keep_their_codes():
    words = Words()
    assert [words.code(word) for word in ("", "join", "wake", "join")] == [0, 1, 2, 1]
    assert words.all() == ("", "join", "wake")
    with pytest.raises(AssertionError, match="more than 256"):
        for k in range(300):
            words.code(str(k))
