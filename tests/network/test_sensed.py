import numpy as np
from scipy.spatial import KDTree

from wsnsim.models.sensing import AcousticEnergy
from wsnsim.network.sensed import Sensed


def sensed(points, positions, key=5, target=0):
    sensor = AcousticEnergy()
    return Sensed(target, points, positions, np.ones((len(positions), 1)), sensor, KDTree(positions), key)


def test_who_senses_when_is_what_brute_force_finds():
    rng = np.random.default_rng(2)
    positions, points = rng.uniform(-200, 200, (300, 2)), rng.uniform(-200, 200, (20, 2))
    found = sensed(points, positions)
    for step, point in enumerate(points):
        near = np.flatnonzero(np.linalg.norm(positions - point, axis=1) <= 60.0).tolist()
        assert found.ids[step] == near
        before = np.flatnonzero(np.linalg.norm(positions - points[step - 1], axis=1) <= 60.0).tolist() if step else []
        assert found.appeared(step) == sorted(set(near) - set(before))
        assert found.vanished(step) == sorted(set(before) - set(near))


def test_a_reading_depends_on_target_step_and_node_but_not_on_who_else_is_there():
    rng = np.random.default_rng(3)
    positions, points = rng.uniform(-50, 50, (40, 2)), rng.uniform(-10, 10, (5, 2))
    all_of_them = sensed(points, positions)
    first_ten = sensed(points, positions[:10])
    for step in range(5):
        whole = all_of_them.readings(step)
        assert {node: whole[node] for node in range(10)} == first_ten.readings(step)
    values = [value for step in range(5) for value in all_of_them.readings(step).values()]
    assert len(set(values)) == len(values)
    assert all_of_them.readings(0) != sensed(points, positions, target=1).readings(0)


def test_a_target_out_of_everybodys_range_is_sensed_by_nobody():
    found = sensed(np.array([[500.0, 500.0], [0.0, 0.0]]), np.array([[0.0, 10.0]]))
    assert found.readings(0) == {} and list(found.readings(1)) == [0] and found.appeared(1) == [0]
