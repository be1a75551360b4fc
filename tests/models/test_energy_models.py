"""Joules against hand counts."""

import math

import pytest

from wsnsim.models.energy import FirstOrder, FirstOrder2002


def test_a_packet_of_twelve_bytes_over_seventy_five_metres():
    electronics, amplifier = FirstOrder().transmit(96, 75.0)
    assert electronics == pytest.approx(4.8e-6)  # 96 bit x 50 nJ
    assert amplifier == pytest.approx(54e-6)  # 96 bit x 100 pJ x 5625 m2
    assert FirstOrder().receive(96) == pytest.approx(4.8e-6)


def test_a_step_of_a_cluster_counted_by_hand():
    """Four members send one packet to the head, 10, 20, 30 and 40 m away; each computes 1000 operations."""
    model = FirstOrder()
    spent = sum(
        sum(model.transmit(96, distance)) + model.receive(96) + model.compute(1000) for distance in (10, 20, 30, 40)
    )
    by_hand = 8 * 96 * 50e-9 + 96 * 100e-12 * (100 + 400 + 900 + 1600) + 4 * 1000 * 0.67e-9 * 1.5**2
    assert spent == pytest.approx(by_hand)


def test_cycles_are_operations_times_what_one_takes():
    assert FirstOrder().compute(1000) == pytest.approx(1000 * 0.67e-9 * 2.25)
    assert FirstOrder(cycles_per_operation=10).compute(1000) == pytest.approx(10 * FirstOrder().compute(1000))
    assert FirstOrder2002(cycles_per_operation=10, voltage=3.0).compute(1000) == pytest.approx(
        40 * FirstOrder2002().compute(1000)
    )


def test_sensing_is_free_unless_it_is_given_a_price():
    for model in (FirstOrder, FirstOrder2002):
        assert model().sense() == 0.0
        assert model(sensing=1e-6).sense() == 1e-6


def test_the_crossover_follows_from_the_two_amplifiers_and_both_agree_there():
    model = FirstOrder2002()
    assert model.crossover == pytest.approx(87.7, abs=0.05)
    near, far = (model.transmit(1000, math.nextafter(model.crossover, to))[1] for to in (0.0, 1000.0))
    assert near == pytest.approx(far, rel=1e-9)
    assert FirstOrder2002(free_space=40e-12).crossover == pytest.approx(2 * model.crossover)


def test_free_space_falls_with_the_square_and_multipath_with_the_fourth_power():
    model = FirstOrder2002()
    assert model.transmit(8, 40.0) == (pytest.approx(8 * 50e-9), pytest.approx(8 * 10e-12 * 1600))
    assert model.transmit(8, 100.0)[1] == pytest.approx(8 * 0.0013e-12 * 1e8)
    assert model.receive(8) == pytest.approx(8 * 50e-9)
