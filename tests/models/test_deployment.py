"""Deployments, anchors included."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from wsnsim.base.errors import RunError
from wsnsim.base.network_ports import Field
from wsnsim.base.setups import NetworkSetup, TrackingSetup
from wsnsim.models.clusters import StrongestSignal
from wsnsim.models.coverage import covers
from wsnsim.models.deploy import Anchors, Grid, JitteredGrid, Uniform, cells
from wsnsim.models.node_file import FromFile, PlaceColumns
from wsnsim.models.ranging import Range
from wsnsim.models.sensing import AcousticEnergy
from wsnsim.scenario.fields import fields_of


def generator(seed=1):
    return np.random.default_rng(seed)


def company(reach=60.0):
    return of_kind(NetworkSetup, sensor=AcousticEnergy(reach=reach), clusters=StrongestSignal())


def of_kind(kind, **given):
    """A scenario with or without a network, of which only what is given matters."""
    return kind(**dict.fromkeys(field.name for field in dataclasses.fields(kind)) | given)


def issues(part, reach=60.0, parts=None):
    return [(".".join(map(str, issue.path)), issue.message) for issue in part.check(parts or company(reach))]


def written(folder, text):
    path = folder / "nodes.csv"
    path.write_text(text, encoding="utf-8")
    return str(path)


@pytest.mark.thorough
def test_a_uniform_deployment_covers_the_field_if_asked():
    for seed in range(20):
        positions = Uniform().draw(60.0, generator(seed))
        assert positions.shape == (256, 2)
        assert np.all(np.abs(positions) <= 200)
        assert covers(positions, 60.0, 400, 400)


@pytest.mark.thorough
def test_about_one_draw_in_twenty_is_thrown_away():
    """The figure for 256 nodes on 400 m by 400 m with a reach of 60 m: about 1.05 draws a deployment."""
    draw = generator()
    covered = sum(covers(Uniform(cover=False).draw(60.0, draw), 60.0, 400, 400) for _ in range(300))
    assert 0.90 < covered / 300 < 0.99


def test_a_uniform_deployment_is_uniform():
    positions = Uniform(nodes=40_000, width=200, height=100, cover=False).draw(1.0, generator())
    counts, _, _ = np.histogram2d(*positions.T, bins=10, range=[[-100, 100], [-50, 50]])
    assert np.all(np.abs(counts - 400) < 5 * np.sqrt(400))


def test_a_field_that_no_draw_covers_is_an_error_that_counts_the_draws():
    with pytest.raises(RunError, match="none of 3 sampled deployments of 20 nodes"):
        Uniform(nodes=20, draws=3).draw(60.0, generator())


def test_too_few_nodes_to_cover_are_a_fault_that_says_how_many_are_needed():
    said = "17 nodes with a sensing range of 60 m cannot cover 400 m by 400 m: at least 18 are needed, or cover: false"
    assert issues(Uniform(nodes=17)) == [("deploy.cover", said)]
    assert not issues(Uniform(nodes=18))
    assert not issues(Uniform(nodes=17, cover=False))


def test_fewer_nodes_than_a_cluster_needs_are_a_fault():
    assert issues(Uniform(nodes=2, cover=False)) == [
        ("deploy.nodes", "2 nodes cannot form a cluster of clusters.minimum_active = 3 members")
    ]


@pytest.mark.parametrize("nodes", [1, 2, 3, 7, 16, 100, 255, 256, 257])
@pytest.mark.parametrize(("width", "height"), [(400.0, 400.0), (800.0, 100.0), (90.0, 700.0)])
def test_the_cells_of_a_grid_fill_the_field_with_one_node_each(nodes, width, height):
    centres, sizes = cells(nodes, width, height)
    assert centres.shape == (nodes, 2)
    assert np.sum(sizes[:, 0] * sizes[:, 1]) == pytest.approx(width * height)
    assert np.all(np.abs(centres) + sizes / 2 <= np.array([width, height]) / 2 + 1e-9)
    assert len(np.unique(centres.round(6), axis=0)) == nodes


def test_a_square_number_of_nodes_makes_a_square_grid():
    positions = Grid(nodes=16, width=400, height=400).draw(60.0, generator())
    assert np.allclose(sorted(set(positions[:, 0])), [-150, -50, 50, 150])
    assert np.allclose(positions[:4], [[-150, -150], [-50, -150], [50, -150], [150, -150]])


def test_a_grid_that_does_not_cover_is_a_fault():
    assert not issues(Grid(nodes=16), reach=70.8)
    [(path, message)] = issues(Grid(nodes=16), reach=70.6)
    assert path == "deploy.cover"
    assert "uncovered" in message
    assert not issues(Grid(nodes=16, cover=False), reach=70.6)


def test_jitter_keeps_a_node_in_its_part_of_the_cell():
    centres, sizes = cells(100, 400, 400)
    moved = JitteredGrid(nodes=100, jitter=0.5).draw(60.0, generator()) - centres
    assert np.all(np.abs(moved) <= 0.25 * sizes)
    assert np.std(moved[:, 0]) == pytest.approx(20 / np.sqrt(12), rel=0.2)
    assert np.allclose(JitteredGrid(nodes=100, jitter=0.0).draw(60.0, generator()), centres)


def test_a_jittered_grid_that_cannot_cover_gives_up():
    with pytest.raises(RunError, match="none of 5 sampled deployments of 16 nodes"):
        JitteredGrid(nodes=16, jitter=1.0, draws=5).draw(65.0, generator())


def test_positions_come_from_a_file_in_its_order(tmp_path):
    path = written(tmp_path, "node, x ,y\n0,1.5,-2\n\n1,0,0\n2,0,0\n")
    part = FromFile(path=path, cover=False)
    assert np.array_equal(part.draw(60.0, generator()), [[1.5, -2.0], [0.0, 0.0], [0.0, 0.0]])
    assert not issues(part)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "nodes.csv:1: the header must name the columns x and y"),
        ("x;y\n1;2\n", "nodes.csv:1: the header must name"),
        ("x,y\n", "nodes.csv: contains no positions"),
        ("x,y\n1,2\n3,four\n", "nodes.csv:3: y must be a finite number, is 'four'"),
        ("x,y\n1,2\n3\n", "nodes.csv:3: y must be a finite number, is ''"),
        ("x,y\n1,2\n\n0,201\n", "nodes.csv:4: (0, 201) m is outside the field of 400 m by 400 m"),
        ("x,y\nnan,0\n", "nodes.csv:2: x must be a finite number, is 'nan'"),
    ],
)
def test_a_faulty_file_is_named_with_its_line(tmp_path, text, said):
    part = FromFile(path=written(tmp_path, text))
    with pytest.raises(RunError) as caught:
        part.draw(60.0, generator())
    assert said in str(caught.value)
    [(path, message)] = issues(part)
    assert path == "deploy.path"
    assert said in message


def test_a_file_that_cannot_be_read_is_named(tmp_path):
    binary = tmp_path / "nodes.bin"
    binary.write_bytes(b"\xff\xff\x00\x01")
    endless = Path("/dev/zero")
    for path, said in (
        (tmp_path / "none.csv", "No such file"), (tmp_path, "is a folder"), (binary, "not a CSV text"),
        (endless, "not a regular file"),
    ):  # fmt: skip
        with pytest.raises(RunError, match="cannot be read") as caught:
            FromFile(path=str(path)).draw(60.0, generator())
        assert str(path) in str(caught.value)
        assert said in str(caught.value)


def test_nodes_from_a_file_must_cover_and_suffice(tmp_path):
    part = FromFile(path=written(tmp_path, "x,y\n0,0\n"), width=100, height=100)
    assert [path for path, _ in issues(part, reach=80.0)] == ["deploy.path"]
    assert [path for path, _ in issues(part, reach=70.0)] == ["deploy.path", "deploy.cover"]


def test_every_deployment_names_its_field(tmp_path):
    path = written(tmp_path, "x,y\n0,0\n")
    for part in (Uniform, Grid, JitteredGrid):
        assert part(width=30.0, height=20.0).field == Field(30.0, 20.0)
    assert FromFile(path=path, width=30.0, height=20.0).field == Field(30.0, 20.0)
    assert FromFile(path=path, width=30.0, height=20.0, centre=(5.0, 2.0)).field == Field(30.0, 20.0, (5.0, 2.0))


def test_without_a_network_there_is_no_cluster_to_be_too_small_for(tmp_path):
    alone = of_kind(TrackingSetup, sensor=AcousticEnergy())
    path = written(tmp_path, "x,y\n0,0\n")
    for part in (Uniform(nodes=2, cover=False), Grid(nodes=2, cover=False), FromFile(path=path, cover=False)):
        assert issues(part, parts=alone) == []
        assert len(issues(part)) == 1
    assert [path for path, _ in issues(Uniform(nodes=2), parts=alone)] == ["deploy.cover"]


@pytest.mark.parametrize("reach", [np.inf, 1e300])
def test_one_sensor_without_end_covers_any_field(reach, tmp_path):
    alone = of_kind(TrackingSetup, sensor=Range(reach=reach))
    path = written(tmp_path, "x,y\n-7,3\n")
    for part in (Uniform(nodes=1), Grid(nodes=1), JitteredGrid(nodes=1), FromFile(path=path)):
        assert issues(part, parts=alone) == []
        assert part.draw(reach, generator()).shape == (1, 2)
    assert covers(np.zeros((1, 2)), reach, 400.0, 400.0)
    assert not covers(np.empty((0, 2)), reach, 400.0, 400.0)


def test_the_field_of_a_file_may_be_centred_elsewhere(tmp_path):
    path = written(tmp_path, "x,y\n100,60\n120,40\n")
    part = FromFile(path=path, width=40.0, height=40.0, centre=(110.0, 50.0))
    assert part.draw(60.0, generator()).tolist() == [[100.0, 60.0], [120.0, 40.0]]
    with pytest.raises(RunError, match="outside the field of 40 m by 40 m around"):
        FromFile(path=path, width=40.0, height=40.0).draw(60.0, generator())


def test_a_file_names_its_nodes_and_gives_their_heights(tmp_path: Path) -> None:
    path = written(tmp_path, "receiver,x,y,z\nnorth,0,5,2\nsouth,0,-5,1.5\n")
    part = FromFile(path=path, columns=PlaceColumns(id="receiver"))
    assert part.names == ("north", "south")
    assert part.heights is not None and part.heights.tolist() == [2.0, 1.5]
    with pytest.raises(
        RunError, match=r"the column 'receiver' looks like names: columns: \{id: receiver\}; count_from: 0"
    ):
        _ = FromFile(path=path).names
    assert FromFile(path=path, count_from=1).names == ("1", "2")
    assert FromFile(path=path, columns=PlaceColumns(z="height")).heights is None


def test_places_of_a_file_may_have_other_names(tmp_path: Path) -> None:
    part = FromFile(path=written(tmp_path, "east,north\n3,4\n"), columns=PlaceColumns(x="east", y="north"))
    assert part.draw(60.0, generator()).tolist() == [[3.0, 4.0]]


def test_two_nodes_of_one_name_and_a_height_that_is_no_number_are_refused_with_their_line(tmp_path: Path) -> None:
    path = written(tmp_path, "id,x,y,z\na,0,5,2\na,0,-5,none\n")
    with pytest.raises(RunError, match=r"nodes\.csv:3: the node 'a' stands in line 2 already"):
        _ = FromFile(path=path).names
    with pytest.raises(RunError, match=r"nodes\.csv:3: z must be a finite number, is 'none'"):
        _ = FromFile(path=path).heights


def test_the_default_field_of_anchors_contains_all_of_them():
    places = [(0.71, 6.16), (18.12, 11.93), (7.18, 17.64), (12.76, 0.27)]
    assert Anchors(places=tuple(places)).field.contains(np.array(places)).all(), "its centre is rounded"
    rng = np.random.default_rng(1)
    for _ in range(200):
        places = rng.uniform(-30.0, 30.0, (5, 2)).round(2)
        assert Anchors(places=tuple(map(tuple, places.tolist()))).field.contains(places).all()


LIU = tuple((x, 10.0) for x in (-1.0, 150.0, 300.0, 450.0, 600.0, 750.0, 900.0, 1000.0))
ROOM = ((0.0, 5.0), (5.0, 10.0), (10.0, 0.0))


def anchor_issues(
    part: Anchors, reach: float = 400.0, kind: type[TrackingSetup] = TrackingSetup
) -> list[tuple[str, str]]:
    given: dict[str, Any] = dict.fromkeys(field.name for field in dataclasses.fields(kind))
    given |= {"sensor": Range(reach=reach)} | ({"clusters": StrongestSignal()} if kind is NetworkSetup else {})
    return [(".".join(map(str, issue.path)), issue.message) for issue in part.check(kind(**given))]


def test_nodes_stand_at_the_places_in_their_order_and_nothing_is_drawn() -> None:
    rng = np.random.default_rng(0)
    assert Anchors(places=LIU).draw(400.0, rng).tolist() == [list(place) for place in LIU]
    assert rng.random() == np.random.default_rng(0).random()
    assert Anchors().draw(400.0, rng).tolist() == [[0.0, 0.0]]


def test_the_field_is_what_the_places_span_and_at_least_a_metre() -> None:
    assert Anchors(places=ROOM).field == Field(10.0, 10.0, (5.0, 5.0))
    assert Anchors(places=LIU).field == Field(1001.0, 1.0, (499.5, 10.0))
    assert Anchors().field == Field(1.0, 1.0, (0.0, 0.0))
    for places in (ROOM, LIU):
        assert Anchors(places=places).field.contains(np.array(places)).all()


def test_what_is_said_of_the_field_goes_before_what_the_places_span() -> None:
    assert Anchors(places=LIU, height=40.0).field == Field(1001.0, 40.0, (499.5, 10.0))
    assert Anchors(places=ROOM, width=20.0, centre=(4.0, 6.0)).field == Field(20.0, 10.0, (4.0, 6.0))


def test_a_place_outside_the_field_is_a_fault_that_names_it() -> None:
    found = anchor_issues(Anchors(places=ROOM, centre=(4.0, 5.0)))
    assert found == [("deploy.places.2", "(10, 0) m is outside the field of 10 m by 10 m around (4, 5)")]


def test_anchors_must_cover_a_field_wherever_it_lies_if_asked() -> None:
    far = tuple((x + 1e4, y - 2e4) for x, y in ROOM)
    for places in (ROOM, far):
        assert anchor_issues(Anchors(places=places, cover=True), reach=7.0) == []
        [(path, message)] = anchor_issues(Anchors(places=places, cover=True), reach=5.5)
        assert path == "deploy.cover" and "of the field uncovered" in message
        assert anchor_issues(Anchors(places=places), reach=5.5) == []


def test_too_few_anchors_for_a_cluster_are_a_fault_in_a_network_only() -> None:
    assert [path for path, _ in anchor_issues(Anchors(), kind=NetworkSetup)] == ["deploy.places"]
    assert anchor_issues(Anchors()) == []
    assert anchor_issues(Anchors(places=ROOM), kind=NetworkSetup) == []


def test_a_list_without_places_is_refused() -> None:
    with pytest.raises(ValueError, match="at least one node"):
        Anchors(places=())


def test_a_scenario_can_write_places() -> None:
    annotation, _ = fields_of(Anchors)["places"]
    reader: TypeAdapter[Any] = TypeAdapter(annotation)
    assert reader.validate_python([["1 km", 2], [3, "4 m"]]) == ((1000.0, 2.0), (3.0, 4.0))
    for wrong in ([[1.0]], [1.0, 2.0], [[1.0, 1e9]], "none"):
        with pytest.raises(ValidationError):
            reader.validate_python(wrong)
