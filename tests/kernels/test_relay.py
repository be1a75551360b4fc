"""Kalman filters over a chain of sensors, against the joint Gaussian, mixtures summed by hand, and textbook twins."""

from __future__ import annotations

import numpy as np
import pytest

from wsnsim.kernels import relay
from wsnsim.kernels.relay import LARGEST

SENSORS = 8
PLACE = np.array([0])
HEARD = np.ones(SENSORS, dtype=np.bool_)


def chain(sensors, stay):
    """M, which the kernels never build."""
    if sensors == 1:
        return np.ones((1, 1))
    matrix = np.full((sensors, sensors), (1.0 - stay) / (sensors - 1))
    np.fill_diagonal(matrix, stay)
    return matrix


def weighed_twin(predicted, logs, heard):
    """Eq. 18; those not heard keep their predicted probability."""
    if not heard.any():
        return predicted
    weights = np.where(heard, predicted * np.exp(logs - logs[heard].max()), 0.0)
    if not weights.sum() > 0.0:
        return predicted
    return np.where(heard, predicted[heard].sum() * weights / weights.sum(), predicted)


def rkf_by_the_book(
    mean, cov, probabilities, expected, gradients, variances, readings, heard, place, stay, spread
):  # fmt: skip
    """Eqs. 8-14, 18-20 as they are printed; the spread of the means about theirs, which does not cancel."""
    slopes = np.zeros((len(readings), mean.size))
    slopes[:, place] = gradients
    widths = np.einsum("id,de,ie->i", slopes, cov, slopes) + variances
    surprises = np.where(heard, readings - expected, 0.0)
    predicted = chain(len(readings), stay) @ probabilities
    updated = weighed_twin(predicted, -0.5 * (surprises**2 / widths + np.log(widths)), heard)
    gains = cov @ slopes.T / widths
    shares = np.where(heard, updated, 0.0)
    shift = gains @ (shares * surprises)
    after = cov - (gains * shares) @ slopes @ cov
    if spread:
        apart = gains * surprises - shift[:, None]
        after = after + (apart * updated) @ apart.T
    return mean + shift, after, updated


def mix_by_the_book(means, covs, probabilities, stay, printed):
    """Eqs. 20-23, one filter after another."""
    count = means.shape[1]
    matrix = chain(count, stay)
    predicted = matrix @ probabilities
    mixed, spreads = np.empty(means.shape), np.empty(covs.shape)
    for i in range(count):
        shares = matrix[i] * probabilities / predicted[i]
        mixed[:, i] = means @ shares
        around = means - mixed[:, i : i + 1]
        within = covs.sum(axis=0) if printed else np.einsum("j,jde->de", shares, covs)
        spreads[i] = within + (around * shares) @ around.T
    return mixed, spreads, predicted


def update_each_by_the_book(means, covs, probabilities, expected, gradients, variances, readings, heard, place):
    """Eqs. 10-14 with b = 1 in every filter, then 18, 19; in place. Gives what `combine_by_the_book` gives."""
    logs = np.zeros(len(readings))
    for i in np.flatnonzero(heard):
        slope = np.zeros(len(means))
        slope[place] = gradients[i, :, i]
        width = slope @ covs[i] @ slope + variances[i, i]
        surprise = readings[i] - expected[i, i]
        logs[i] = -0.5 * (surprise**2 / width + np.log(width))
        gain = covs[i] @ slope / width
        means[:, i] += gain * surprise
        covs[i] -= np.outer(gain, slope @ covs[i])
    probabilities[:] = weighed_twin(probabilities, logs, heard)
    return combine_by_the_book(means, covs, probabilities)


def combine_by_the_book(means, covs, probabilities):
    """Eqs. 24, 25."""
    mean = means @ probabilities
    around = means - mean[:, None]
    return mean, np.einsum("j,jde->de", probabilities, covs) + (around * probabilities) @ around.T


def kalman_by_the_book(mean, cov, expected, gradients, variances, readings, place):
    """Conditioning of the joint Gaussian of state and all readings."""
    slopes = np.zeros((len(readings), mean.size))
    slopes[:, place] = gradients
    cross = cov @ slopes.T
    gain = np.linalg.solve(slopes @ cross + np.diag(variances), cross.T).T
    return mean + gain @ (readings - expected), cov - gain @ cross.T


def lengthened(gradients, place, size):
    """(n, D) slopes in all columns, of those (n, P) in the columns of the position."""
    slopes = np.zeros((len(gradients), size))
    slopes[:, place] = gradients
    return slopes


def mix_twin(means, covs, probabilities, stay, printed, mixed, spreads):
    """Eqs. 20-23, all filters at once."""
    matrix = chain(means.shape[1], stay)
    shares = matrix.T * probabilities[:, None] / (matrix @ probabilities)
    mixed[:] = means @ shares
    around = means[:, :, None] - mixed[:, None, :]
    within = covs.sum(axis=2)[..., None] if printed else covs @ shares
    spreads[:] = within + np.einsum("dji,eji,ji->dei", around, around, shares)


def filter_each_twin(
    means, covs, probabilities, transitions, noise, expected, gradients, variances, readings, place, stay, spread,
    mean, cov,
):  # fmt: skip
    """Eqs. 10-14 with b = 1 in every filter, 17-20, 24, 25, all filters at once."""
    size, count = means.shape
    if transitions.shape[2]:
        moved = np.matmul(np.matmul(transitions.T.swapaxes(1, 2), covs.T), transitions.T)
        covs[:] = (moved + noise).transpose(1, 2, 0)
    each = np.arange(count), np.arange(count) if expected.shape[1] > 1 else np.zeros(count, int)
    slopes, heard = lengthened(gradients[each[0], :, each[1]], place, size), np.isfinite(readings)
    lifts = np.einsum("dei,ie->di", covs, slopes)
    widths = np.einsum("di,id->i", lifts, slopes) + variances[each]
    surprises = np.where(heard, readings - expected[each], 0.0)
    gains = np.where(heard, lifts / widths, 0.0)
    means += gains * surprises
    covs -= gains[:, None] * lifts
    logs = -0.5 * (surprises**2 / widths + np.log(widths))
    probabilities[:] = weighed_twin(chain(count, stay) @ probabilities, logs, heard)
    mean[:] = means @ probabilities
    around = means - mean[:, None]
    cov[:] = covs @ probabilities + ((around * probabilities) @ around.T if spread else 0.0)


def kalman_twin(mean, cov, expected, gradients, variances, readings, place):
    """Conditioning of the joint Gaussian of state and all readings; its normalised innovation squared, and how many."""
    slopes = lengthened(gradients[:, :, 0], place, mean.size)
    cross = cov @ slopes.T
    spread, innovation = slopes @ cross + np.diag(variances[:, 0]), readings - expected[:, 0]
    gain = np.linalg.solve(spread, cross.T).T
    mean += gain @ innovation
    cov -= gain @ cross.T
    return float(innovation @ np.linalg.solve(spread, innovation)), readings.size


def inner(covs):
    """(D, D, n), as the kernels take them, of covariances (n, D, D)."""
    return np.ascontiguousarray(covs.transpose(1, 2, 0))


def mix(means, covs, probabilities, stay, printed):
    """Mixed means, covariances (n, D, D), predicted probabilities."""
    mixed, spreads = np.empty(means.shape), np.empty(covs.T.shape)
    relay.mix(means, inner(covs), probabilities, stay, printed, mixed, spreads)
    return mixed, spreads.transpose(2, 0, 1).copy(), chain(means.shape[1], stay) @ probabilities


def filtered(means, covs, probabilities, transitions, noise, linear, readings, heard, place, stay, spread):
    """The moments of all, and the filters' own, that the kernel makes of covariances (n, D, D), as it leaves them."""
    after = means.copy(), inner(covs), probabilities.copy()
    mean, cov = np.empty(len(means)), np.empty((len(means), len(means)))
    readings = np.where(heard, readings, np.nan)
    relay.filter_each(*after, transitions, noise, *linear, readings, place, stay, spread, mean, cov)
    return mean, cov, after[0], after[1].transpose(2, 0, 1), after[2]


def rkf(
    mean, cov, probabilities, expected, gradients, variances, readings, heard, place, stay, spread
):  # fmt: skip
    """Mean, covariance and probabilities of the relaying filter, whose sensors all start from one prediction."""
    count, size = len(readings), mean.size
    bank = np.repeat(mean[:, None], count, axis=1), np.repeat(cov[None], count, axis=0), probabilities
    linear = expected[:, None], np.ascontiguousarray(gradients[:, :, None]), variances[:, None]
    done = filtered(*bank, np.empty((size, size, 0)), cov, linear, readings, heard, place, stay, spread)
    return done[0], done[1], done[4]


def update_each(means, covs, predicted, expected, gradients, variances, readings, heard, place):
    """The update alone, in place: nothing moves, and the chain stays where it is."""
    size = len(means)
    linear = expected, np.ascontiguousarray(gradients), variances
    mean, cov, *after = filtered(
        means, covs, predicted, np.empty((size, size, 0)), np.eye(size), linear, readings, heard, place, 1.0, True
    )
    means[:], covs[:], predicted[:] = after
    return mean, cov


def kalman(mean, cov, expected, gradients, variances, readings, place):
    """Mean and covariance after the joint update."""
    mean, cov = mean.copy(), cov.copy()
    slopes = np.ascontiguousarray(gradients[:, :, None])
    relay.kalman(mean, cov, expected[:, None], slopes, variances[:, None], readings, place)
    return mean, cov


def spd(rng, count, size=3):
    root = rng.normal(size=(count, size, size))
    return root @ root.transpose(0, 2, 1) + 0.1 * np.eye(size)


def single(seed, sensors=SENSORS, place=PLACE, size=3):
    """Arguments of `rkf` up to the readings, all as random as they may be."""
    rng = np.random.default_rng(seed)
    return (
        rng.normal(size=size),
        spd(rng, 1, size)[0],
        rng.dirichlet(np.ones(sensors)),
        rng.normal(0.0, 2.0, sensors),
        rng.normal(size=(sensors, place.size)),
        rng.uniform(0.3, 2.0, sensors),
        rng.normal(0.0, 3.0, sensors),
    )


def bank(seed, sensors=SENSORS, place=PLACE, size=3):
    """Means, covs and probabilities of a filter a sensor; and the arguments of `update_each` from `expected` on."""
    rng = np.random.default_rng(seed)
    filters = rng.normal(0.0, 2.0, (size, sensors)), spd(rng, sensors, size), rng.dirichlet(np.ones(sensors))
    linear = (
        rng.normal(0.0, 2.0, (sensors, sensors)),
        rng.normal(size=(sensors, place.size, sensors)),
        rng.uniform(0.3, 2.0, (sensors, sensors)),
        rng.normal(0.0, 3.0, sensors),
    )
    return filters, linear


def close(first, second, rel=1e-9):
    for a, b in zip(first, second, strict=True):
        assert a == pytest.approx(b, rel=rel, abs=1e-9)


@pytest.mark.parametrize("place", [np.array([0]), np.array([0, 2])], ids=["line", "plane"])
@pytest.mark.parametrize("sensors", [1, 2, 8])
@pytest.mark.parametrize("spread", [False, True])
def test_rkf_is_its_textbook_twin_with_all_or_some_readings(place, sensors, spread) -> None:
    for seed in range(20):
        heard = np.random.default_rng(seed).random(sensors) < (0.6 if seed % 2 else 2.0)
        args = (*single(seed, sensors, place), heard, place, 0.93, spread)
        close(rkf(*args), rkf_by_the_book(*args))


@pytest.mark.parametrize("place", [np.array([0]), np.array([0, 2])], ids=["line", "plane"])
@pytest.mark.parametrize("sensors", [1, 2, 8])
def test_the_kernels_of_imsf_are_their_textbook_twins_with_all_or_some_readings(place, sensors) -> None:
    for seed in range(20):
        heard = np.random.default_rng(seed).random(sensors) < (0.6 if seed % 2 else 2.0)
        filters, linear = bank(seed, sensors, place)
        for printed in (False, True):
            close(mix(*filters, 0.93, printed), mix_by_the_book(*filters, 0.93, printed))
        ours, theirs = (tuple(array.copy() for array in filters) for _ in range(2))
        close(update_each(*ours, *linear, heard, place), update_each_by_the_book(*theirs, *linear, heard, place))
        close(ours, theirs)


@pytest.mark.parametrize("place", [np.array([0]), np.array([0, 2])], ids=["line", "plane"])
@pytest.mark.parametrize("sensors", [1, 2, 8])
def test_the_kernels_are_their_vectorised_twins_with_their_own_arguments(place, sensors) -> None:
    for seed in range(20):
        rng = np.random.default_rng(seed)
        (means, covs, chances), linear = bank(seed, sensors, place)
        covs, readings = inner(covs), np.where(rng.random(sensors) < (0.6 if seed % 2 else 2.0), linear[3], np.nan)
        found, expected = ((np.empty(means.shape), np.empty(covs.shape)) for _ in range(2))
        for printed in (False, True):
            relay.mix(means, covs, chances, 0.93, printed, *found)
            mix_twin(means, covs, chances, 0.93, printed, *expected)
            close(found, expected)
        for transitions in (rng.normal(size=(3, 3, sensors)), np.empty((3, 3, 0))):
            model = transitions, spd(rng, 1)[0], *linear[:3], readings, place, 0.93, bool(seed % 3)
            ours, theirs = (
                (means.copy(), covs.copy(), chances.copy(), *model, np.empty(3), np.empty((3, 3))) for _ in range(2)
            )
            relay.filter_each(*ours)
            filter_each_twin(*theirs)
            close((*ours[:3], *ours[-2:]), (*theirs[:3], *theirs[-2:]))


@pytest.mark.parametrize("readings", [0, 1, 5])
def test_the_joint_update_conditions_the_joint_gaussian(readings) -> None:
    for seed in range(10):
        mean, cov, _, *linear = single(seed, readings, np.array([0, 2]), 4)
        found = kalman(mean, cov, *linear, np.array([0, 2]))
        close(found, kalman_by_the_book(mean, cov, *linear, np.array([0, 2])))
        ours, (expected, gradients, variances, values) = (mean.copy(), cov.copy()), linear
        kalman_twin(*ours, expected[:, None], gradients[:, :, None], variances[:, None], values, np.array([0, 2]))
        close(found, ours)
        assert np.array_equal(found[1], found[1].T)


@pytest.mark.parametrize("chosen", [0, 5])
def test_with_the_probability_forced_to_one_sensor_rkf_conditions_on_its_reading_alone(chosen) -> None:
    mean, cov, _, *linear = single(3)
    certain = np.eye(SENSORS)[chosen]
    for spread in (False, True):
        after, within, updated = rkf(mean, cov, certain, *linear, HEARD, PLACE, 1.0, spread)
        close(
            (after, within), kalman_by_the_book(mean, cov, *(values[chosen : chosen + 1] for values in linear), PLACE)
        )
        assert np.array_equal(updated, certain)


def test_spread_makes_the_covariance_that_of_the_mixture_of_each_sensors_own_posterior() -> None:
    for seed in range(10):
        mean, cov, probabilities, *linear = single(seed)
        shift, plain, updated = rkf(mean, cov, probabilities, *linear, HEARD, PLACE, 0.93, False)
        each = [kalman_by_the_book(mean, cov, *(v[i : i + 1] for v in linear), PLACE) for i in range(SENSORS)]
        means, covs = np.array([m for m, _ in each]).T, np.array([c for _, c in each])
        assert plain == pytest.approx(np.einsum("i,ide->de", updated, covs), rel=1e-9)
        after, spread, again = rkf(mean, cov, probabilities, *linear, HEARD, PLACE, 0.93, True)
        close((after, spread), combine_by_the_book(means, covs, updated))
        assert np.array_equal(after, shift) and np.array_equal(updated, again)
        assert np.linalg.eigvalsh(spread - plain)[-1] > 1e-6, "the spread adds covariance"
        assert np.linalg.eigvalsh(spread - plain)[0] > -1e-12, "and takes none away"


def test_the_probabilities_of_rkf_are_bayes_rule_over_the_sensors() -> None:
    """By scipy's normal density, for one step of a chain of three."""
    from scipy.stats import norm

    mean, cov, probabilities, expected, gradients, variances, readings = single(4, 3)
    widths = gradients[:, 0] ** 2 * cov[0, 0] + variances
    likelihood = norm.pdf(readings, expected, np.sqrt(widths))
    joint = np.array([sum(chain(3, 0.8)[i, j] * probabilities[j] for j in range(3)) for i in range(3)]) * likelihood
    heard = np.ones(3, dtype=np.bool_)
    found = rkf(mean, cov, probabilities, expected, gradients, variances, readings, heard, PLACE, 0.8, False)[2]
    assert found == pytest.approx(joint / joint.sum(), rel=1e-12)


@pytest.mark.parametrize("sensors", [1, 2, 8])
def test_the_markov_matrix_has_093_on_its_diagonal_equal_entries_beside_it_and_rows_that_sum_to_one(sensors) -> None:
    silence = np.zeros(sensors, dtype=np.bool_)
    args = single(0, sensors)
    steps = [rkf(*args[:2], column, *args[3:], silence, PLACE, 0.93, False)[2] for column in np.eye(sensors)]
    matrix = np.array(steps).T
    assert matrix == pytest.approx(chain(sensors, 0.93), abs=1e-15)
    assert matrix.sum(axis=0) == pytest.approx(1.0) and matrix.sum(axis=1) == pytest.approx(1.0)


@pytest.mark.parametrize("stay", [0.0, 0.125, 0.93, 1.0])
def test_mixing_leaves_the_moments_of_the_mixture_as_they_are(stay) -> None:
    for seed in range(10):
        filters, _ = bank(seed)
        close(combine_by_the_book(*mix(*filters, stay, False)), combine_by_the_book(*filters))


def test_mixing_a_filter_that_nothing_leads_to_leaves_it_as_it_is() -> None:
    (means, covs, _), _ = bank(1)
    mixed, spreads, _ = mix(means, covs, np.eye(SENSORS)[2], 1.0, False)
    assert np.array_equal(mixed, means) and spreads == pytest.approx(covs, rel=1e-15)


def test_the_printed_mixing_sums_the_covariances_and_diverges_but_stays_finite_and_definite() -> None:
    (means, covs, chances), linear = bank(2)
    within = covs
    for step in range(400):
        means, covs, chances = mix(means, covs, chances, 0.93, True)
        assert np.all(np.isfinite(means)) and np.all(np.isfinite(covs)) and np.all(np.isfinite(chances))
        assert np.diagonal(covs, axis1=1, axis2=2).max() <= LARGEST * (1 + 1e-12)
        assert np.linalg.eigvalsh(covs).min() > -1e-9 * LARGEST
        if step == 0:
            assert np.all(np.trace(covs, axis1=1, axis2=2) > np.trace(within.sum(axis=0)) * (1 - 1e-12))
        if step % 3 == 0:
            update_each(means, covs, chances, *linear, HEARD, PLACE)
    assert np.diagonal(covs, axis1=1, axis2=2).max() > 0.01 * LARGEST


def lonely(log_likelihoods):
    """Readings, with variances of one and no gradients, whose log-likelihoods are these up to their constant."""
    return np.zeros(SENSORS), np.zeros((SENSORS, 1)), np.ones(SENSORS), np.sqrt(-2.0 * log_likelihoods)


@pytest.mark.parametrize("loud", [0, 7])
def test_likelihoods_of_e_to_minus_100000_for_all_but_one_give_that_one_everything(loud) -> None:
    logs = np.full(SENSORS, -1e5)
    logs[loud] = -0.5
    mean, cov, *_ = single(5)
    chances = np.full(SENSORS, 0.01 / 7)
    chances[3] = 0.99
    for found in _both(mean, cov, chances, lonely(logs)):
        assert np.array_equal(found, np.eye(SENSORS)[loud])


def test_likelihoods_of_e_to_minus_100000_for_all_are_weighed_without_underflow() -> None:
    """All -1e5 but for a known difference: the ratio is what that says."""
    logs = np.full(SENSORS, -1e5)
    logs[2] += 1.0
    mean, cov, *_ = single(6)
    expected = np.where(np.arange(SENSORS) == 2, np.e, 1.0)
    for found in _both(mean, cov, np.full(SENSORS, 1 / SENSORS), lonely(logs)):
        assert found == pytest.approx(expected / expected.sum(), rel=1e-9)


def test_where_no_sensor_is_likely_at_all_the_probabilities_stay_predicted_and_the_state_too() -> None:
    mean, cov, chances, *_ = single(7)
    linear = np.zeros(SENSORS), np.ones((SENSORS, 1)), np.ones(SENSORS), np.full(SENSORS, 1e200)
    predicted = chain(SENSORS, 0.93) @ chances
    for found in _both(mean, cov, chances, linear):
        assert found == pytest.approx(predicted, rel=1e-12)
    after, within, _ = rkf(mean, cov, chances, *linear, HEARD, PLACE, 0.93, True)
    assert after == pytest.approx(mean, rel=1e-14) and within == pytest.approx(cov, rel=1e-14)


@pytest.mark.parametrize("broken", [np.nan, np.inf, -np.inf, 1e200])
@pytest.mark.parametrize("what", [3, 4, 5, 6], ids=["expected", "gradients", "variances", "readings"])
def test_what_is_no_number_touches_nothing_but_its_own_sensor(broken, what) -> None:
    args = list(single(8))
    args[what] = args[what].copy()
    args[what][4] = broken
    after, within, chances = rkf(*args, HEARD, PLACE, 0.93, True)
    assert np.all(np.isfinite(after)) and np.all(np.isfinite(within)) and chances.sum() == pytest.approx(1.0)
    filters, linear = bank(8)
    ours = [array.copy() for array in filters]
    values = [array.copy() for array in linear]
    values[what - 3][4] = broken
    mean, cov = update_each(*ours, *values, HEARD, PLACE)
    assert all(np.all(np.isfinite(array)) for array in (*ours, mean, cov))
    assert ours[2].sum() == pytest.approx(1.0)
    mean, cov = kalman(*args[:2], *args[3:], PLACE)
    assert np.all(np.isfinite(mean)) and np.all(np.isfinite(cov))


def test_a_lost_reading_leaves_its_filter_and_its_probability_predicted_and_the_rest_share_the_remainder() -> None:
    (means, covs, predicted), linear = bank(9)
    heard = HEARD.copy()
    heard[[1, 6]] = False
    ours = means.copy(), covs.copy(), predicted.copy()
    update_each(*ours, *linear, heard, PLACE)
    assert np.array_equal(ours[0][:, ~heard], means[:, ~heard]) and np.array_equal(ours[1][~heard], covs[~heard])
    assert np.array_equal(ours[2][~heard], predicted[~heard])
    complete = means.copy(), covs.copy(), predicted.copy()
    update_each(*complete, *linear, HEARD, PLACE)
    assert np.array_equal(ours[0][:, heard], complete[0][:, heard])
    ratio = ours[2][heard] / complete[2][heard]
    assert ratio == pytest.approx(ratio[0], rel=1e-9)
    assert ours[2].sum() == pytest.approx(1.0)


def _both(mean, cov, chances, linear):
    """The probabilities after a step, by both filters."""
    yield rkf(mean, cov, chances, *linear, HEARD, PLACE, 0.93, False)[2]
    expected, gradients, variances, readings = linear
    means, covs = np.repeat(mean[:, None], SENSORS, axis=1), np.repeat(cov[None], SENSORS, axis=0)
    means, covs, predicted = mix(means, covs, chances, 0.93, False)
    square = (SENSORS, SENSORS)
    update_each(
        means, covs, predicted, np.broadcast_to(expected[:, None], square).copy(),
        np.repeat(gradients[:, :, None], SENSORS, axis=2), np.broadcast_to(variances[:, None], square).copy(),
        readings, HEARD, PLACE,
    )  # fmt: skip
    yield predicted


def test_sharp_readings_leave_covariances_symmetric_and_definite() -> None:
    """A standard deviation of a kilometre against one of 30 micrometres, from many sides, again and again."""
    rng = np.random.default_rng(10)
    place = np.array([0, 2])
    for size in (3, 4):
        start = np.diag([1e6, 1e2, 1e6, 1e2][:size]) + 10.0
        angles = rng.uniform(0.0, 2.0 * np.pi, (50, SENSORS))
        chances = np.full(SENSORS, 1 / SENSORS)
        joint, single_, spread = start.copy(), start.copy(), start.copy()
        each = np.repeat(start[None], SENSORS, axis=0)
        for slopes in np.stack([np.cos(angles), np.sin(angles)], axis=2):
            linear = np.zeros(SENSORS), slopes, np.full(SENSORS, 1e-9), np.zeros(SENSORS)
            joint = kalman(np.zeros(size), joint, *linear, place)[1]
            single_ = rkf(np.zeros(size), single_, chances, *linear, HEARD, place, 0.93, False)[1]
            spread = rkf(np.zeros(size), spread, chances, *linear, HEARD, place, 0.93, True)[1]
            square = np.repeat(slopes[:, :, None], SENSORS, axis=2)
            table = np.zeros((SENSORS, SENSORS))
            update_each(
                np.zeros((size, SENSORS)), each, chances.copy(), table, square, table + 1e-9, linear[3], HEARD, place
            )
            for cov in (joint, single_, spread, *each):
                assert np.array_equal(cov, cov.T)
                assert np.linalg.eigvalsh(cov)[0] > -1e-15 * np.trace(cov) and np.all(np.diag(cov) > 0.0)
