"""Links, channel access, routing, sleep and waking."""

import numpy as np
import pytest

from wsnsim.models.links import Disk, IdealMac, MinimumEnergy, MinimumHop
from wsnsim.models.sleep import EventWake
from wsnsim.models.wakeup import NoWakeUp


def test_a_disk_ends_at_its_reach():
    disk = Disk()
    assert disk.perfect
    assert np.array_equal(disk.arrivals(75.0, 3, key=1), [True, True, True])
    assert np.array_equal(disk.arrivals(75.001, 3, key=1), [False, False, False])
    assert not Disk(loss=0.1).arrivals(80.0, 200, key=1).any()


def test_packets_are_lost_as_often_as_stated_and_each_for_itself():
    disk = Disk(loss=0.3)
    assert not disk.perfect
    masks = np.array([disk.arrivals(10.0, 50, key=key) for key in range(2000)])
    assert masks.mean() == pytest.approx(0.7, abs=0.005)  # 100,000 draws: three standard errors
    assert np.all(np.abs(masks.mean(axis=0) - 0.7) < 0.05)
    assert np.mean(masks[:, 0] & masks[:, 1]) == pytest.approx(0.49, abs=0.04)


def test_a_frames_losses_depend_on_its_key_alone():
    disk = Disk(loss=0.5)
    assert np.array_equal(disk.arrivals(10.0, 64, key=5), disk.arrivals(70.0, 64, key=5))
    assert not np.array_equal(disk.arrivals(10.0, 64, key=5), disk.arrivals(10.0, 64, key=6))
    assert np.array_equal(disk.arrivals(10.0, 64, key=5)[:10], disk.arrivals(10.0, 10, key=5))


def test_parts_that_the_network_performs_name_their_mechanism():
    assert IdealMac().mechanism == "ideal"
    assert IdealMac().rate is None
    assert IdealMac(rate=250e3).rate == 250e3
    assert (MinimumEnergy().weight, MinimumHop().weight) == ("energy", "hop")
    assert NoWakeUp().mechanism == "none"
    assert EventWake().always_listening
