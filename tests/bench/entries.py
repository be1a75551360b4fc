"""Which kernels are measured: a line a kernel, with its twin and a maker of the arguments for N particles.

    Entry("acoustic.propagate", "bench.twins:propagate", propagation)

A kernel and a twin are named, not imported: who only calls the kernels does not load what the tests load. What a new
kernel needs is a line in ENTRIES, in the place of its file; its twin's home is its test.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from tests.bench import frames
from wsnsim.base.rng import derive_all

Arguments = tuple[Any, ...]

SEGMENTS, SENSORS = 8, 10
DRIFT, ROOT, LAW = (0.04, 180.0, 0.75, 1.0), (0.0008, 0.04, 0.005), (1.0, 1e4, 2.2, 0.003, 0.0)
RANGE, GROWTH = (0.0, 1.0, 0.0, 4.0, np.inf, False), (1.2, 1.5)
SINGLE = np.array([0, 2])
FEW = (24, 8)
"""Sizes of what is as small as a cluster of sensors."""
NEAR = (40, 10)


@dataclass(frozen=True)
class Entry:
    """A kernel of wsnsim.kernels, its NumPy twin somewhere in tests, its arguments, and what N counts: how many each.

    It is called with `sizes`. A filter a sensor, or a bank of them, is smaller than a cloud.
    """

    kernel: str
    twin: str
    arguments: Callable[[int], Arguments]
    sizes: tuple[int, int] = (400, 100)
    each: str = "particle-step"

    def load(self) -> Callable[..., Any]:
        """The compiled kernel."""
        module, name = self.kernel.split(".")
        return getattr(importlib.import_module(f"wsnsim.kernels.{module}"), name)  # type: ignore[no-any-return]

    def load_twin(self) -> Callable[..., Any]:
        """Its twin."""
        module, name = self.twin.split(":")
        return getattr(importlib.import_module(f"tests.{module}"), name)  # type: ignore[no-any-return]


def copies(arguments: Arguments) -> Arguments:
    """Arguments that a kernel may change."""
    return tuple(a.copy() if isinstance(a, np.ndarray) else a for a in arguments)


def _rng() -> np.random.Generator:
    return np.random.default_rng(7)


def _keys(count: int) -> np.ndarray:
    return derive_all(3, np.arange(count))


def _offsets(count: int) -> np.ndarray:
    return np.linspace(0, count, SEGMENTS + 1).astype(np.int64)


def _states(count: int) -> np.ndarray:
    return _rng().normal(0.0, 1.0, (4, count)) * np.array([[180.0], [30.0], [180.0], [30.0]])


def _spd(count: int) -> np.ndarray:
    root = _rng().normal(size=(count, 4, 4))
    return root @ root.transpose(0, 2, 1) + np.eye(4)


def _sensing(count: int) -> dict[str, np.ndarray]:
    rng = _rng()
    positions, gains = rng.uniform(-60.0, 60.0, (SENSORS, 2)), rng.uniform(0.7, 1.3, SENSORS)
    x, y = rng.normal(0.0, 15.0, (2, count))
    readings = 1.0 + gains * 1e4 * np.maximum((positions**2).sum(axis=1), 1.0) ** -1.1
    return {"x": x, "y": y, "z": readings, "p": positions, "g": gains, "o": np.arange(count) % SENSORS}


def _sense(names: str, law: Any) -> Callable[[int], Arguments]:
    """Those of points x and y, readings z, positions p, gains g and owners o that `names` names, and a law."""
    return lambda count: (*(_sensing(count)[name] for name in names), law)


def _log_weights(count: int) -> np.ndarray:
    return _rng().normal(0.0, 3.0, count)


def _teeth(count: int) -> Arguments:
    return _log_weights(count), _offsets(count), np.diff(_offsets(count)), _rng().random(SEGMENTS)


def _densities(count: int) -> Arguments:
    return _states(count), _rng().normal(size=(SEGMENTS, 4)), np.linalg.cholesky(_spd(SEGMENTS)), _offsets(count)


def _gaussians(count: int) -> Arguments:
    return _rng().normal(size=(count, 4)), _rng().dirichlet(np.ones(count))


def _linear_update(count: int) -> Arguments:
    rng = _rng()
    expected, variances = rng.normal(size=(SENSORS, count)), rng.uniform(0.5, 2.0, (SENSORS, count))
    gradients, readings = rng.normal(size=(SENSORS, 2, count)), rng.normal(size=SENSORS)
    return _states(count), _spd(count), expected, gradients, variances, readings, SINGLE


def _flight(count: int) -> Arguments:
    rng, offsets = _rng(), _offsets(count)
    cloud, velocity, best = rng.normal(size=(3, 4, count))
    return cloud, velocity, best, rng.normal(size=count), offsets, _keys(count), 9, 1.0, 2.0, 2.0, 0.04, True


def _acceptance(count: int) -> Arguments:
    rng = _rng()
    cloud, proposal, best = rng.normal(size=(3, 4, count))
    fitness, prior, new_fitness, new_prior = rng.normal(size=(4, count))
    best_fitness, keys = fitness + 0.5, _keys(count)
    return cloud, fitness, prior, proposal, new_fitness, new_prior, best, best_fitness, keys, 9


def _swarm_move(count: int) -> Arguments:
    rng, offsets = _rng(), _offsets(count)
    positions, sizes = rng.uniform(-30.0, 30.0, (SEGMENTS, 2)), np.diff(offsets)
    cloud = rng.normal(0.0, 1.0, (4, count)) * np.array([[2.0], [1.0], [2.0], [1.0]])
    readings = 1.0 + 1e4 * np.maximum((positions**2).sum(axis=1), 1.0) ** -1.1
    log_weights, carried, fitness = rng.normal(size=(3, count))
    stack = cloud, log_weights, carried, fitness, offsets, np.arange(SEGMENTS) % 3 == 1, np.log(sizes), _keys(SEGMENTS)
    return *stack, readings, positions, np.ones(SEGMENTS), LAW, (0, 2), 1, (2, 2.0, 2.0, 1.0, True), True, 1e-3


def _linear(count: int) -> Arguments:
    transition = np.kron(np.eye(2), np.array([[1.0, 0.04], [0.0, 1.0]]))
    return _states(count), _keys(count), transition, 0.1 * np.eye(4) + np.tri(4, k=-1)


def _linear_density(count: int) -> Arguments:
    states, _, transition, factor = _linear(count)
    return transition @ states + factor @ _rng().normal(size=states.shape), states, transition, factor


def _scalars(count: int) -> np.ndarray:
    return _rng().normal(0.0, 12.0, (1, count))


def _cuckoos(count: int) -> Arguments:
    cloud = _rng().normal(size=(4, count))
    return cloud, cloud[:, 0].copy() + 1.0, np.array([0, 2]), _keys(count), 4, 1.0, True, 0.7, 1.5, np.ones(count)


def _nests(count: int) -> Arguments:
    cloud = _rng().normal(size=(4, count))
    return cloud, cloud.copy(), np.array([0, 2]), _keys(count), 4, 0.75


def _chains(count: int) -> Arguments:
    cloud, fitness, prior, proposal, new_fitness, new_prior, *_ = _acceptance(count)
    return cloud, fitness, prior, proposal, new_fitness, new_prior, np.zeros(count), _keys(count), 9


def _greedy(count: int) -> Arguments:
    cloud, fitness, _, proposal, new_fitness, *_ = _acceptance(count)
    return cloud, fitness, proposal, new_fitness


def _masses(count: int) -> Arguments:
    rng = _rng()
    points, velocities = rng.normal(size=(2, 4, count))
    return points, velocities, rng.normal(size=count), SINGLE, _keys(count), 5, 10.0, min(count, 10), 1e-6


def _cells(count: int) -> Arguments:
    rng, width = _rng(), 40.0 / count
    return rng.dirichlet(np.ones(count)), rng.uniform(-20.0, 20.0, count), np.full(count, 1.0), -20.0, width, count


def _bank(count: int) -> Arguments:
    """A filter a sensor, three columns each: means (3, n), covs (3, 3, n), probabilities (n,)."""
    rng = _rng()
    root = rng.normal(size=(count, 3, 3))
    covs = (root @ root.transpose(0, 2, 1) + np.eye(3)).transpose(1, 2, 0)
    return rng.normal(size=(3, count)), np.ascontiguousarray(covs), rng.dirichlet(np.ones(count))


def _mixing(count: int) -> Arguments:
    return *_bank(count), 0.9, False, np.zeros((3, count)), np.zeros((3, 3, count))


def _readings(sensors: int, points: int) -> Arguments:
    """What sensors on a line read, linearised at so many points, and which row is the position."""
    rng = _rng()
    expected, variances = rng.normal(size=(sensors, points)), rng.uniform(0.5, 2.0, (sensors, points))
    return expected, rng.normal(size=(sensors, 1, points)), variances, rng.normal(size=sensors), np.array([0])


def _bank_step(count: int) -> Arguments:
    transitions, (_, covs, _) = _rng().normal(size=(3, 3, count)), _bank(1)
    noise = np.ascontiguousarray(covs[:, :, 0])
    return *_bank(count), transitions, noise, *_readings(count, count), 0.9, True, np.zeros(3), np.zeros((3, 3))


def _kalman(count: int) -> Arguments:
    means, covs, _ = _bank(1)
    return means[:, 0].copy(), np.ascontiguousarray(covs[:, :, 0]), *_readings(count, 1)


def _association(count: int) -> Arguments:
    """Likelihoods of a scan of `count` detections about four tracks, what each track has without one, and clutter."""
    rng = _rng()
    return rng.exponential(1.0, (4, count)) * (rng.random((4, count)) < 0.6), np.full(4, 0.1), np.full(count, 0.3), 10


def _scan(count: int) -> Arguments:
    """The joint moments of `count` tracks and a range and a bearing, and a scan of three detections."""
    roots = _rng().normal(size=(count, 6, 8))
    covs, periods = np.ascontiguousarray(roots @ roots.transpose(0, 2, 1)), np.array([0.0, 2.0 * np.pi])
    return _rng().normal(size=(count, 6)), covs, 4, _rng().normal(size=(3, 2)), periods


ENTRIES: tuple[Entry, ...] = (
    Entry("elementary.particle_keys", "bench.twins:particle_keys", lambda n: (_keys(SEGMENTS), _offsets(n), 1)),
    Entry("acoustic.advance", "bench.twins:advance", lambda n: (_states(n), DRIFT)),
    Entry("acoustic.transitions", "bench.twins:transitions", lambda n: (_states(n), DRIFT)),
    Entry("acoustic.propagate", "bench.twins:propagate", lambda n: (_states(n), _keys(n), DRIFT, ROOT)),
    Entry(
        "acoustic.log_transition", "bench.twins:log_transition", lambda n: (_states(n) + 0.1, _states(n), DRIFT, ROOT)
    ),
    Entry("acoustic.joint_log_likelihood", "bench.twins:joint_log_likelihood", _sense("xyzpg", LAW)),
    Entry("acoustic.own_log_likelihood", "bench.twins:own_log_likelihood", _sense("xyzpgo", LAW)),
    Entry("acoustic.linearised", "bench.twins:linearised", _sense("xypg", LAW)),
    Entry("particles.weigh", "bench.twins:weigh", lambda n: (_log_weights(n), _offsets(n))),
    Entry("particles.moments", "bench.twins:moments", lambda n: (_states(n), _log_weights(n), _offsets(n))),
    Entry("particles.systematic", "bench.twins:systematic", _teeth),
    Entry("gaussian.fit", "bench.twins:fit", lambda n: (_states(n), _offsets(n), 1e-3)),
    Entry(
        "gaussian.fit_weighted", "bench.twins:fit_weighted", lambda n: (_states(n), _log_weights(n), _offsets(n), 1e-3)
    ),
    Entry("gaussian.log_density", "bench.twins:log_density", _densities),
    Entry("gaussian.fuse", "bench.twins:fuse", lambda n: (*_gaussians(n), _spd(1)[0]), FEW, "member"),
    Entry("gaussian.cholesky", "bench.twins:cholesky", lambda n: (_spd(1)[0], np.zeros((4, 4))), (1, 1), "matrix"),
    Entry("gaussian.sample", "bench.twins:sample", lambda n: (_states(n), _spd(n), _keys(n))),
    Entry("gaussian.predict", "bench.twins:predict", lambda n: (_spd(n), _rng().normal(size=(n, 4, 4)), _spd(1)[0])),
    Entry("gaussian.update", "bench.twins:update", _linear_update),
    Entry("swarm.fly", "bench.twins:fly", _flight),
    Entry("swarm.accept", "bench.twins:accept", _acceptance),
    Entry("swarm.move_own", "kernels.test_swarm_kernels:move_own_twin", _swarm_move),
    Entry("linear.advance", "kernels.test_linear:advance_twin", lambda n: _linear(n)[0::2]),
    Entry("linear.propagate", "kernels.test_linear:propagate_twin", _linear),
    Entry("linear.log_transition", "kernels.test_linear:log_transition_twin", _linear_density),
    Entry("ungm.advance", "kernels.test_ungm:advance_twin", lambda n: (_scalars(n), GROWTH, 7.0)),
    Entry("ungm.propagate", "kernels.test_ungm:propagate_twin", lambda n: (_scalars(n), _keys(n), GROWTH, 7.0)),
    Entry(
        "ungm.log_transition",
        "kernels.test_ungm:log_transition_twin",
        lambda n: (_scalars(n) / 2.0, _scalars(n), GROWTH, 7.0),
    ),
    Entry(
        "ungm.joint_log_likelihood",
        "kernels.test_ungm:joint_log_likelihood_twin",
        lambda n: (_scalars(n)[0], _rng().normal(5.0, 4.0, SENSORS), 0.8),
    ),
    Entry(
        "ungm.own_log_likelihood",
        "kernels.test_ungm:own_log_likelihood_twin",
        lambda n: (_scalars(n)[0], _rng().normal(5.0, 4.0, SENSORS), np.arange(n) % SENSORS, 0.8),
    ),
    Entry("ranging.joint_log_likelihood", "kernels.test_ranging:joint_log_likelihood_twin", _sense("xyzp", RANGE)),
    Entry("ranging.own_log_likelihood", "kernels.test_ranging:own_log_likelihood_twin", _sense("xyzpo", RANGE)),
    Entry("ranging.linearised", "kernels.test_ranging:linearised_twin", _sense("xyp", RANGE)),
    Entry("association.associate", "kernels.test_association:associate_twin", _association, (8, 4), "detection"),
    Entry("detections.score", "kernels.test_detections:score_twin", _scan, FEW, "track"),
    Entry(
        "detections.condition",
        "kernels.test_detections:condition_twin",
        lambda n: (*_scan(n), _rng().dirichlet(np.ones(4), n)[:, 1:].copy()),
        FEW,
        "track",
    ),
    Entry("cuckoo.fly_cuckoos", "kernels.test_cuckoo:fly_cuckoos_twin", _cuckoos),
    Entry("cuckoo.replace_nests", "kernels.test_cuckoo:replace_nests_twin", _nests),
    Entry("cuckoo.accept_greedy", "kernels.test_cuckoo:accept_greedy_twin", _greedy),
    Entry(
        "cuckoo.relative_changes", "kernels.test_cuckoo:relative_changes_twin", lambda n: (np.ones(n), _log_weights(n))
    ),
    Entry("cuckoo.accept_chains", "kernels.test_cuckoo:accept_chains_twin", _chains),
    Entry("gravity.attract", "kernels.test_gravity:attract_twin", _masses),
    Entry("grid.spread", "kernels.test_grid:spread_twin", _cells, each="cell"),
    Entry("grid.weigh", "kernels.test_grid:weigh_twin", lambda n: (np.ones(n) / n, _log_weights(n)), each="cell"),
    Entry("relay.mix", "kernels.test_relay:mix_twin", _mixing, FEW, "sensor"),
    Entry("relay.filter_each", "kernels.test_relay:filter_each_twin", _bank_step, FEW, "sensor"),
    Entry("relay.kalman", "kernels.test_relay:kalman_twin", _kalman, FEW, "sensor"),
    Entry("reception.outcomes", "kernels.test_reception:outcomes_twin", frames.frame, NEAR, "neighbour"),
    Entry("reception.find_links", "kernels.test_reception:find_links_twin", frames.links, NEAR, "link"),
    Entry("reception.overlap", "kernels.test_reception:overlap_twin", frames.other_frame, NEAR, "neighbour"),
    Entry("reception.add_common", "kernels.test_reception:add_common_twin", frames.interferer, NEAR, "neighbour"),
    Entry("reception.unlock", "kernels.test_reception:unlock_twin", frames.sending, NEAR, "neighbour"),
    Entry("reception.take_over", "kernels.test_reception:take_over_twin", frames.rivals, NEAR, "neighbour"),
    Entry("reception.advance", "kernels.test_reception:advance_twin", frames.bursty_links, NEAR, "link"),
    Entry("nodes.listening", "kernels.test_nodes:listening_twin", frames.sleepers, NEAR, "neighbour"),
    Entry("nodes.period_spans", "kernels.test_nodes:period_spans_twin", frames.schedules, NEAR, "node"),
    Entry("nodes.period_sums", "kernels.test_nodes:period_sums_twin", frames.spells, NEAR, "node"),
    Entry("nodes.book", "kernels.test_nodes:book_twin", frames.charge, NEAR, "neighbour"),
    Entry("nodes.mark_busy", "kernels.test_nodes:mark_busy_twin", frames.busy, NEAR, "neighbour"),
)
