"""Every join of two data sets about the same nodes is one by name: rows, columns and names may be any."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import wsnsim
from wsnsim.base.errors import RunError, ScenarioError
from wsnsim.base.initial_conditions import joined_by_name
from wsnsim.fitting.link_sample import read_link_rows
from wsnsim.scenario import build, load

PLACES = np.array([(0.0, 0.0, 3.0), (20.0, 0.0, 2.0), (20.0, 15.0, 3.5), (0.0, 15.0, 2.5)])
BIASES = np.array([0.4, -0.3, 0.1, 0.9])
TIMES = np.arange(0.0, 24.0, 0.5)
NAMES = ("a", "b", "c", "d")


class Recorded:
    """A recording of four nodes: the file of nodes has them in this order, and all files have rows and columns so."""

    def __init__(self, folder: Path, names: Sequence[str] = NAMES, shuffled: int | None = None) -> None:
        self.folder, self.names = folder, list(names)
        self.order = np.random.default_rng(shuffled).permutation(4) if shuffled is not None else np.arange(4)
        rng = np.random.default_rng(3)
        points = np.column_stack([10 + 8 * np.cos(TIMES / 4), 7 + 6 * np.sin(TIMES / 3), np.full(len(TIMES), 1.0)])
        apart = np.linalg.norm(points[:, None] - PLACES, axis=2)
        readings = (apart + BIASES + rng.normal(0.0, 0.2, apart.shape)).ravel()
        times, x, y, z = (np.repeat(column, 4) for column in (TIMES, *points.T))
        who = np.tile(self.names, len(TIMES))
        places = dict(zip("xyz", PLACES[self.order].T, strict=True))
        self.write("nodes.csv", {"id": np.array(self.names)[self.order], **places})
        rows = np.random.default_rng(shuffled).permutation(len(who)) if shuffled is not None else np.arange(len(who))
        columns = {"time": times, "node": who, "reading": readings, "x": x, "y": y, "z": z}
        self.write("r.csv", {name: column[rows] for name, column in columns.items()}, bool(shuffled))
        links = [f"2020-01-01T00:0{i}:00,{self.names[i]},{self.names[j]},26,{-60 - 3 * i - j},0.{5 + j},100"
                 for i in self.order for j in self.order if i != j]  # fmt: skip
        head = '{"tx_length": 100, "interframe_duration": 10}\ndatetime,src,dst,channel,mean_rssi,pdr,tx_count'
        (folder / "l.k7").write_text("\n".join([head, *links]) + "\n")

    def write(self, file: str, columns: dict[str, Any], reversed_columns: bool = False) -> None:
        names = list(columns)[:: -1 if reversed_columns else 1]
        rows = zip(*(columns[name] for name in names), strict=True)
        (self.folder / file).write_text("\n".join([",".join(names), *(",".join(map(str, row)) for row in rows)]) + "\n")

    def path(self, file: str) -> str:
        return str(self.folder / file)

    def scenario(self, **law: Any) -> dict[str, Any]:
        heights = {"kind": "range", "sd": 0.2, "target_height": 1.0} | law
        return {
            "name": "r", "network": "none", "seed": 1, "duration": 20.0, "step": 0.5, "tracker": {"kind": "ekf"},
            "prior": {"sd": [1.0, 1.0, 1.0, 1.0]},
            "deploy": {"kind": "file", "path": self.path("nodes.csv"), "fit": True, "margin": 5.0, "cover": False},
            "motion": {"kind": "recorded_track", "path": self.path("r.csv"), "q": 0.1},
            "sensor": {"kind": "recorded", "path": self.path("r.csv"), "law": heights, "in_sample": True},
        }  # fmt: skip


def estimated(data: dict[str, Any]) -> np.ndarray:
    return wsnsim.run(data).estimates[["px", "py"]].to_numpy()


def readings_and_heights(made: Recorded) -> np.ndarray:
    """The deployment has the heights of the law."""
    return estimated(made.scenario())


def constants(made: Recorded) -> np.ndarray:
    """The law lists them in an order of its own."""
    return estimated(made.scenario(biases=BIASES.tolist()[::-1], nodes=made.names[::-1]))


def fitted_readings(made: Recorded) -> np.ndarray:
    found = wsnsim.fit(made.path("r.csv"), made.path("nodes.csv"), law="range")
    gains = {gain.node: gain.value for gain in found.gains}
    return np.array([*(gains[name] for name in made.names), found.values["bias"].value, found.values["sd"].value])


def fitted_laws(made: Recorded) -> np.ndarray:
    """What a fit writes, in a scenario whose nodes have another order."""
    found = wsnsim.fit(made.path("r.csv"), made.path("nodes.csv"), law="range").law
    return estimated(made.scenario(**{key: found[key] for key in ("biases", "nodes", "sd")}))


def played_links(made: Recorded) -> np.ndarray:
    link = {"kind": "recorded", "path": made.path("l.k7"), "channel": 26, "round_length": "1 s"}
    deploy = {"kind": "file", "path": made.path("nodes.csv"), "fit": True, "cover": False}
    changes = ["duration=1 s", "step=1 s", f"link={json.dumps(link)}", f"deploy={json.dumps(deploy)}"]
    built: Any = build(load("recorded_links", changes))
    names = built.deploy.names
    found = np.zeros((4, 4))
    for source in range(4):
        heard = built.link.heard(0, source)
        rows = [made.names.index(names[receiver]) for receiver in heard.ids.tolist()]
        found[made.names.index(names[source]), rows] = heard.ratios
    return found


def fitted_links(made: Recorded) -> np.ndarray:
    rows = read_link_rows([made.path("l.k7")], made.path("nodes.csv"), {}, False)
    assert rows.places is not None
    return rows.places[[rows.nodes.index(name) for name in made.names]]


JOINS = {
    "readings and heights": readings_and_heights, "constants of a law": constants, "fit": fitted_readings,
    "written law": fitted_laws, "played links": played_links, "fit of links": fitted_links,
}  # fmt: skip


@pytest.mark.parametrize("join", JOINS)
def test_rows_columns_and_names_may_be_any(join: str, tmp_path: Path) -> None:
    expected = JOINS[join](Recorded(tmp_path))
    assert np.isfinite(expected).all() and np.ptp(expected) > 0.0
    for names, shuffled in ((NAMES, 1), (("7", "x y", "a", "n-1"), None), (("3", "1", "0", "2"), 5)):
        np.testing.assert_allclose(JOINS[join](Recorded(tmp_path, names, shuffled)), expected, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("join", JOINS)
def test_names_that_do_not_meet_are_refused_and_never_taken_by_their_order(join: str, tmp_path: Path) -> None:
    made = Recorded(tmp_path)
    text = (tmp_path / "nodes.csv").read_text()
    lines = [line.split(",", 1) for line in text.splitlines()[1:]]
    (tmp_path / "nodes.csv").write_text("\n".join(["id,x,y,z,mote", *(f"n{i},{rest},{i}" for i, rest in lines)]) + "\n")
    with pytest.raises((RunError, ScenarioError), match="have no name of a node in common: ") as refused:
        JOINS[join](made)
    assert "a, b, c, d" in str(refused.value) and "na, nb, nc, nd" in str(refused.value)
    assert "fit" not in join or "the column 'mote' has some" in str(refused.value)
    (tmp_path / "nodes.csv").write_text(text.replace("id,", "mote,"))
    with pytest.raises((RunError, ScenarioError), match=r"mote|must name the columns id"):
        JOINS[join](made)


def test_a_name_that_one_of_two_sets_lacks_is_minus_one_and_columns_are_looked_at_where_none_meets() -> None:
    assert joined_by_name(["b", "x", "a"], ["a", "b"], "one", "other", lambda: pytest.fail("not needed")).tolist() == [
        1, -1, 0,
    ]  # fmt: skip
    with pytest.raises(RunError, match="one and other have no name of a node in common: x; a; the column 'm' has some"):
        joined_by_name(["x"], ["a"], "one", "other", lambda: {"m": ["a"], "k": ["z"]})


def test_constants_are_refused_for_nodes_that_they_do_not_name(tmp_path: Path) -> None:
    made = Recorded(tmp_path)
    for nodes, said in (
        (["a", "b", "c", "e"], "biases: none for d, they are those of a, b, c, e"),
        (["a", "b", "c", "c"], "4 biases for the 4 names in nodes: name each node once"),
        (["a", "b", "c"], "4 biases for the 3 names in nodes"),
    ):
        with pytest.raises(ScenarioError, match=said):
            build(load(made.scenario(biases=BIASES.tolist(), nodes=nodes)))
