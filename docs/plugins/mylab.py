"""Bearings, a target with friction, and an unscented Kalman filter."""

from dataclasses import replace
from typing import Annotated

import numpy as np

from wsnsim import Compute, Estimate, GatherReadings, Parcel, Quantity, Send, part
from wsnsim.plugins import normals


@part
class Bearing:
    """The direction of the target from the node, with noise of constant variance."""

    trait_names = ()  # nodes have no constants of their own
    components = ("bearing",)
    periods = (2 * np.pi,)  # differences of readings are taken the short way round

    sd: Annotated[float, Quantity("rad", gt=0, le=0.5), "standard deviation of a bearing"] = 0.05
    reach: Annotated[float, Quantity("m", gt=0), "sensing range"] = 60.0

    def draw_traits(self, nodes, rng):
        return np.empty((nodes, 0))

    def measure(self, points, positions, traits, noise):
        """Readings (N,) of targets at points (N, 2) by nodes at positions (N, 2), one by one."""
        return wrapped(np.arctan2(*(points - positions).T[::-1]) + self.sd * noise)

    def linearise(self, points, positions, traits):
        """Expected readings (S, N) at points (2, N), their gradients (S, 2, N) and variances (S, N)."""
        across, up = points[:, None, :] - positions.T[:, :, None]
        squared = np.maximum(across**2 + up**2, 1e-6)
        expected = np.arctan2(up, across)
        return expected, np.stack([-up, across], axis=1) / squared[:, None, :], np.full(expected.shape, self.sd**2)

    def log_likelihood(self, points, readings, positions, traits, owners=None):
        """log p (N,) of all readings at points (2, N), or of reading owners[j] alone for particle j."""
        expected, _, variances = self.linearise(points, positions, traits)
        apart = wrapped(readings[:, None] - expected)
        logs = -0.5 * (apart**2 / variances + np.log(2 * np.pi * variances))
        chosen = logs.sum(axis=0) if owners is None else logs[owners, np.arange(owners.size)]
        return np.where(np.isfinite(chosen), chosen, -np.inf)

    def strength(self, reading):
        """How strong a reading is in the election of a cluster head: all bearings are alike."""
        return 0.0

    def assumed(self, gains, inflate):
        return self


@part
class Friction:
    """A velocity that friction slows and noise drives; the position is its integral."""

    columns = ("px", "vx", "py", "vy")
    units = ("m", "m/s", "m", "m/s")
    position = (0, 2)  # the columns that are x and y

    start: Annotated[tuple[float, ...], Quantity("", ge=-1e6, le=1e6), "px, vx, py, vy at time 0"] = (
        -60.0,
        8.0,
        -40.0,
        6.0,
    )
    friction: Annotated[float, Quantity("1/s", ge=0, le=10), "deceleration per speed"] = 0.05
    q: Annotated[float, Quantity("m2/s3", gt=0, le=1e6), "intensity of the noise in the velocity"] = 1.0

    def law(self, dt):
        """The transition matrix (4, 4) and the process covariance (4, 4) of a step."""
        move = np.array([[1, dt * (1 - 0.5 * self.friction * dt)], [0, 1 - self.friction * dt]])
        noise = self.q * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
        return np.kron(np.eye(2), move), np.kron(np.eye(2), noise)

    def truth(self, steps, dt, rng):
        """One ground-truth trajectory (steps + 1, 4)."""
        move, noise = self.law(dt)
        states = [np.array(self.start)]
        for _ in range(steps):
            states.append(move @ states[-1] + np.linalg.cholesky(noise) @ rng.standard_normal(4))
        return np.array(states)

    def advance(self, states, dt, time=0.0):
        return self.law(dt)[0] @ states

    def propagate(self, states, dt, keys, time=0.0):
        """The states (4, N) after a step with noise, which is a function of a particle's key alone."""
        move, noise = self.law(dt)
        return move @ states + np.linalg.cholesky(noise) @ np.stack([normals(keys, draw) for draw in range(4)])

    def matrices(self, states, dt, time=0.0):
        move, noise = self.law(dt)
        return np.broadcast_to(move, (states.shape[1], 4, 4)), noise

    def log_transition(self, after, before, dt, time=0.0):
        move, noise = self.law(dt)
        root = np.linalg.cholesky(noise)
        white = np.linalg.solve(root, after - move @ before)
        return -0.5 * (white**2).sum(axis=0) - np.log(np.diag(root)).sum() - 2 * np.log(2 * np.pi)

    def assumed(self, noise_scale):
        return replace(self, q=self.q * noise_scale)


@part
class Unscented:
    """Unscented Kalman filter in the cluster head, on all measurements that arrive."""

    angles = True  # it compares bearings the short way round
    spread: Annotated[float, Quantity("", gt=0, le=10), "distance of the sigma points, in standard deviations"] = 1.7

    def start(self, prior, scene):
        return prior
        yield  # makes this a generator, which makes no request

    def step(self, belief, scene):
        heard = yield GatherReadings()
        yield Compute(cycles=1000 + 500 * len(heard.ids))
        predicted = self.predicted(belief, scene, scene.steps)
        if not heard.ids:  # loss is ordinary: without a measurement it predicts
            return predicted
        nodes = [scene.ids.index(node) for node in heard.ids]
        states, weights = self.sigma_points(predicted)
        points = states[list(scene.motion.position)]
        expected, _, variances = scene.sensor.linearise(points, scene.positions[nodes], scene.traits[nodes])
        expected = expected[:, :1] + wrapped(expected - expected[:, :1])
        middle = expected @ weights
        apart, around = states - predicted.mean[:, None], expected - middle[:, None]
        seen = (weights * around) @ around.T + np.diag(variances[:, 0])
        gain = np.linalg.solve(seen, (weights * around) @ apart.T).T
        cov = predicted.cov - gain @ seen @ gain.T
        return Estimate(predicted.mean + gain @ wrapped(heard.values - middle), 0.5 * (cov + cov.T))

    def hand_over(self, belief, scene, successor):
        arrived = yield Send(successor, Parcel(belief, packets=4, packet_bits=96, what="estimate"))
        return belief if np.all(arrived) else None

    def estimate(self, belief):
        return belief

    def forecast(self, belief, scene, ahead):
        return self.predicted(belief, scene, ahead)

    def predicted(self, belief, scene, steps):
        """The estimate some steps later, by sigma points."""
        for _ in range(steps):
            states, weights = self.sigma_points(belief)
            _, noise = scene.motion.matrices(states, scene.dt, scene.time)
            states = scene.motion.advance(states, scene.dt, scene.time)
            mean = states @ weights
            apart = states - mean[:, None]
            belief = Estimate(mean, (weights * apart) @ apart.T + noise)
        return belief

    def sigma_points(self, belief):
        """Sigma points (D, 2 D + 1) of a Gaussian and their weights (2 D + 1,)."""
        size = belief.mean.size
        root = self.spread * np.linalg.cholesky(belief.cov + 1e-12 * np.eye(size))
        states = belief.mean[:, None] + np.hstack([np.zeros((size, 1)), root, -root])
        weights = np.full(2 * size + 1, 0.5 / self.spread**2)
        weights[0] = 1 - size / self.spread**2
        return states, weights


def wrapped(angles):
    """Angles moved into -π to π."""
    return (angles + np.pi) % (2 * np.pi) - np.pi
