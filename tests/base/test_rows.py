from dataclasses import replace

import numpy as np

from wsnsim.base.arrays import Estimate
from wsnsim.base.rows import Issued, consistency, fingerprint


def issued(step: int, seconds: float = 0.0) -> Issued:
    return Issued(
        step, step + seconds, Estimate(np.array([1.0, 2.0]), np.eye(2)), head=0, active=1, members=1, readings=1
    )


def test_the_fingerprint_sees_events_time_step_target_mean_and_covariance_to_the_last_bit():
    tracks = [{1: issued(1), 2: issued(2)}, {1: issued(1)}]
    mean, cov = np.nextafter([1.0, 2.0], 9.0), np.nextafter(np.eye(2), 9.0)
    changed = [
        (6, tracks),
        (5, [tracks[0], {}]),
        (5, tracks[::-1]),
        (5, [tracks[0], {2: issued(2)}]),
        (5, [tracks[0], {1: issued(1, seconds=1e-9)}]),
        (5, [tracks[0], {1: replace(issued(1), estimate=Estimate(mean, np.eye(2)))}]),
        (5, [tracks[0], {1: replace(issued(1), estimate=Estimate(np.array([1.0, 2.0]), cov))}]),
    ]
    plain = fingerprint(5, tracks)
    assert plain == fingerprint(5, [dict(reversed(tracks[0].items())), tracks[1]])
    assert len({plain, *(fingerprint(*arguments) for arguments in changed)}) == 1 + len(changed)


def test_consistency_has_the_mean_and_the_median_of_steps_and_counts_singular_covariances():
    """Of five steps, one has a cloud that is nearly a point, one a singular covariance, and one no estimate."""
    nees = np.array([2.0, 9.2e75, 1.0, np.nan, np.nan])
    sd = np.array([1.0, 1e-38, 1.0, 0.0, np.nan])
    track = {"nees": nees, "nis": nees, "nis_dof": np.zeros(5), "sd_x": sd, "error": sd}
    found = consistency([track], 2)
    assert found["nees"] == np.mean(nees[:3]) / 2 and found["nees_median"] == 1.0 and found["singular"] == 1
    absent = track | {"nees": np.full(5, np.nan), "error": np.full(5, np.nan)}
    assert consistency([absent], 2)["singular"] == 0, "an estimate of an absent target has no error, and so no NEES"
