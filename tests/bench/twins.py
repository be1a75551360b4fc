"""The NumPy side of a ratio, for kernels whose tests hold no twin with the same arguments: as fast as NumPy does it.

Like the kernels they stand for, some change their arguments in place. Segments are taken as not empty.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from wsnsim.base.rng import derive_each, uniforms


def particle_keys(keys, offsets, tag):
    sizes = np.diff(offsets)
    numbers = np.arange(offsets[-1]) - np.repeat(offsets[:-1], sizes)
    tagged = derive_each(keys, np.full(keys.size, tag, np.uint64))
    return derive_each(np.repeat(tagged, sizes), numbers.astype(np.uint64))


def normal_pair(keys, pair):
    radius = np.sqrt(-2.0 * np.log1p(-uniforms(keys, 2 * pair)))
    angle = 2.0 * np.pi * uniforms(keys, 2 * pair + 1)
    return radius * np.cos(angle), radius * np.sin(angle)


def advance(states, law):
    step, bound, c1, c2 = law
    position, velocity = states[0::2], states[1::2]
    pull = np.where(np.abs(position) <= bound, 0.0, c1 * position + c2 * velocity)
    result = np.empty_like(states)
    result[0::2] = position + step * velocity
    result[1::2] = velocity - step * pull
    return result


def transitions(states, law):
    step, _, c1, c2 = law
    beyond = np.abs(states[0::2]) > law[1]
    result = np.zeros((states.shape[1], 4, 4))
    for axis in (0, 2):
        result[:, axis, axis], result[:, axis, axis + 1] = 1.0, step
        result[:, axis + 1, axis] = -step * c1 * beyond[axis // 2]
        result[:, axis + 1, axis + 1] = 1.0 - step * c2 * beyond[axis // 2]
    return result


def propagate(states, keys, law, root):
    result = advance(states, law)
    for axis in (0, 2):
        first, second = normal_pair(keys, axis // 2)
        result[axis] += root[0] * first
        result[axis + 1] += root[1] * first + root[2] * second
    return result


def log_transition(after, before, law, root):
    apart = after - advance(before, law)
    first = apart[0::2] / root[0]
    second = (apart[1::2] - root[1] * first) / root[2]
    constant = -2.0 * np.log(2.0 * np.pi) - 2.0 * np.log(root[0] * root[2])
    return constant - 0.5 * (first**2 + second**2).sum(axis=0)


def _heard(x, y, positions, gains, law):
    noise, intensity, decay, spread, inflation = law
    dx, dy = x - positions[:, :1], y - positions[:, 1:]
    squared = dx * dx + dy * dy
    signal = intensity * np.maximum(squared, 1.0) ** (-0.5 * decay)
    mean = noise + gains[:, None] * signal
    return mean, spread * mean**2 + inflation * signal**2, dx, dy, squared, signal


def joint_log_likelihood(x, y, readings, positions, gains, law):
    mean, variance, *_ = _heard(x, y, positions, gains, law)
    return -0.5 * ((readings[:, None] - mean) ** 2 / variance + np.log(2.0 * np.pi * variance)).sum(axis=0)


def own_log_likelihood(x, y, readings, positions, gains, owners, law):
    noise, intensity, decay, spread, inflation = law
    squared = (x - positions[owners, 0]) ** 2 + (y - positions[owners, 1]) ** 2
    signal = intensity * np.maximum(squared, 1.0) ** (-0.5 * decay)
    mean = noise + gains[owners] * signal
    variance = spread * mean**2 + inflation * signal**2
    return -0.5 * ((readings[owners] - mean) ** 2 / variance + np.log(2.0 * np.pi * variance))


def linearised(x, y, positions, gains, law):
    mean, variance, dx, dy, squared, signal = _heard(x, y, positions, gains, law)
    slope = np.where(squared > 1.0, -law[2] * gains[:, None] * signal / squared, 0.0)
    return mean, np.stack([slope * dx, slope * dy], axis=1), variance


def _relative(log_weights, offsets):
    tops = np.maximum.reduceat(log_weights, offsets[:-1])
    return np.exp(log_weights - np.repeat(tops, np.diff(offsets))), tops


def weigh(log_weights, offsets):
    sizes = np.diff(offsets)
    weights, tops = _relative(log_weights, offsets)
    totals = np.add.reduceat(weights, offsets[:-1])
    log_weights -= np.repeat(tops + np.log(totals / sizes), sizes)
    return totals**2 / np.add.reduceat(weights**2, offsets[:-1])


def moments(cloud, log_weights, offsets):
    sizes = np.diff(offsets)
    weights, _ = _relative(log_weights, offsets)
    shares = weights / np.repeat(np.add.reduceat(weights, offsets[:-1]), sizes)
    means = np.add.reduceat(shares * cloud, offsets[:-1], axis=1)
    around = cloud - np.repeat(means, sizes, axis=1)
    products = (shares * around)[:, None, :] * around
    return means.T, np.add.reduceat(products, offsets[:-1], axis=2).transpose(2, 0, 1)


def systematic(log_weights, offsets, sizes, starts):
    weights, _ = _relative(log_weights, offsets)
    chosen = []
    for (first, last), size, start in zip(pairwise(offsets), sizes, starts, strict=True):
        sums = np.cumsum(weights[first:last])
        teeth = (np.arange(size) + start) * sums[-1] / size
        chosen.append(first + np.searchsorted(sums, teeth, side="right"))
    return np.concatenate(chosen)


def fit(cloud, offsets, ridge):
    sizes = np.diff(offsets)
    means = np.add.reduceat(cloud, offsets[:-1], axis=1) / sizes
    around = cloud - np.repeat(means, sizes, axis=1)
    covs = np.add.reduceat(around[:, None, :] * around, offsets[:-1], axis=2) / (sizes - 1)
    return means.T, np.linalg.cholesky(covs.transpose(2, 0, 1) + ridge * np.eye(len(cloud)))


def fit_weighted(cloud, log_weights, offsets, ridge):
    sizes = np.diff(offsets)
    peaks = np.repeat(np.maximum.reduceat(log_weights, offsets[:-1]), sizes)
    weights = np.exp(log_weights - peaks)
    weights /= np.repeat(np.add.reduceat(weights, offsets[:-1]), sizes)
    means = np.add.reduceat(cloud * weights, offsets[:-1], axis=1)
    around = cloud - np.repeat(means, sizes, axis=1)
    covs = np.add.reduceat((weights * around)[:, None, :] * around, offsets[:-1], axis=2)
    covs /= 1.0 - np.add.reduceat(weights**2, offsets[:-1])
    return means.T, np.linalg.cholesky(covs.transpose(2, 0, 1) + ridge * np.eye(len(cloud)))


def log_density(points, means, factors, offsets):
    around = points - np.repeat(means.T, np.diff(offsets), axis=1)
    inverses = np.repeat(np.linalg.inv(factors), np.diff(offsets), axis=0)
    return -0.5 * (np.einsum("nde,en->dn", inverses, around) ** 2).sum(axis=0)


def fuse(means, shares, within):
    mean = shares @ means / shares.sum()
    around = means - mean
    return mean, (shares * around.T) @ around / shares.sum() + 0.5 * (within + within.T)


def cholesky(matrix, result):
    result[:] = np.linalg.cholesky(matrix)


def sample(means, covs, keys):
    size = len(means)
    white = np.concatenate([normal_pair(keys, pair) for pair in range((size + 1) // 2)])[:size]
    factors = np.linalg.cholesky(covs)
    logs = -0.5 * (white**2).sum(axis=0) - np.log(np.diagonal(factors, axis1=1, axis2=2)).sum(axis=1)
    return means + np.einsum("nde,en->dn", factors, white), logs


def predict(covs, transitions, noise):
    return transitions @ covs @ transitions.transpose(0, 2, 1) + noise


def update(means, covs, expected, gradients, variances, readings, place):
    start = means[place].copy()
    for s in range(readings.size):
        lift = np.einsum("ndp,pn->dn", covs[:, :, place], gradients[s])
        spread = (gradients[s] * lift[place]).sum(axis=0) + variances[s]
        innovation = readings[s] - expected[s] - (gradients[s] * (means[place] - start)).sum(axis=0)
        means += lift * innovation / spread
        covs -= (lift[:, None, :] * lift / spread).transpose(2, 0, 1)


def fly(cloud, velocity, best, best_fitness, offsets, keys, draw, inertia, phi1, phi2, length, random_factors):
    sizes, size = np.diff(offsets), len(cloud)
    leaders = np.array([first + np.argmax(best_fitness[first:last]) for first, last in pairwise(offsets)])
    at_best = np.repeat(best[:, leaders], sizes, axis=1)
    factors = [uniforms(keys, draw + k) if random_factors else np.ones(keys.size) for k in range(2 * size)]
    velocity *= inertia
    velocity += phi1 * np.array(factors[0::2]) * (best - cloud) + phi2 * np.array(factors[1::2]) * (at_best - cloud)
    return cloud + velocity * length


def accept(cloud, fitness, prior, proposal, new_fitness, new_prior, best, best_fitness, keys, draw):
    limits = np.log(uniforms(keys, draw + 2 * len(cloud)))
    taken = limits < new_fitness + new_prior - fitness - prior
    taken &= np.abs(proposal).max(axis=0) < 1e9
    fitness[taken], prior[taken] = new_fitness[taken], new_prior[taken]
    cloud[:, taken] = proposal[:, taken]
    improved = fitness > best_fitness
    best_fitness[improved] = fitness[improved]
    best[:, improved] = cloud[:, improved]
    return int(taken.sum())
