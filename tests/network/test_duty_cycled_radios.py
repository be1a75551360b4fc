"""Radios that are mostly off: what they consume against a second account, their deaths, and the share of time on."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import wsnsim
from tests.network.duty_cycled_radios import (
    DUTIES,
    LISTEN,
    PROCESSOR,
    SLEEP,
    START,
    STOP,
    Account,
    Power,
    network_of,
)
from tests.network.radio_network import RadioNetwork
from wsnsim.base.frames import MacFrame
from wsnsim.base.medium_access import RadioDuty
from wsnsim.base.part import part
from wsnsim.base.radio import Mode
from wsnsim.base.rng import Streams, derive_all
from wsnsim.base.tables import CAUSE, CAUSES
from wsnsim.models.access import Csma
from wsnsim.models.energy import FirstOrder
from wsnsim.models.sleep import DutyCycle, RandomIndependent
from wsnsim.scenario import build, load

IDLE, SWITCH, SLEEPING = (CAUSE[name] for name in ("idle", "switch", "sleep"))
SEED = 11
HORIZON = 100.0
STEPS = st.one_of(
    st.tuples(st.just("hold"), st.booleans()),
    st.tuples(st.just("release"), st.sampled_from([None, 0.0, 1.0])),
    st.tuples(st.just("duty"), st.integers(0, len(DUTIES) - 1)),
    st.tuples(st.just("listen"), st.tuples(st.floats(-1e-3, 0.05), st.integers(-1, 3))),
    st.tuples(st.just("mode"), st.sampled_from([Mode.DORMANT, Mode.AWAKE, Mode.ASLEEP])),
    st.tuples(st.just("receive"), st.floats(1e-4, 0.01)),
    st.tuples(st.just("crash"), st.none()),
    st.tuples(st.just("restart"), st.none()),
)  # fmt: skip
PROGRAMS = st.lists(st.tuples(st.floats(0.01, 0.7), STEPS), max_size=14)


class Driven:
    """One node of a network and its account, to which the same happens. `sleep`: its schedule, if it has one."""

    def __init__(self, sleep: Any = None, **components: Any) -> None:
        self.schedule = sleep
        self.network = network_of(1, horizon=HORIZON, seed=SEED, **components | ({"sleep": sleep} if sleep else {}))
        self.nodes, self.account = self.network.nodes, Account()
        self.key = derive_all(Streams(SEED, 0).key("sleep"), np.array([0]))
        self.rest = Mode.SCHEDULED if sleep else Mode.DORMANT
        self.account.mode = self.rest
        self.held_since, self.held_on = 0.0, False

    def hold(self, on: bool) -> None:
        account = self.account
        self.nodes.hold_radio(0, on)
        if account.mode is not Mode.DOWN and not account.held:
            account.held, self.held_since, self.held_on = True, self.network.env.now, on
            account.joules["switch"] += 0.0 if on else START

    def release(self, missed: float | None) -> None:
        """`missed`: 0 for as many wake-ups as there are at least in the time, 1 for one more."""
        account = self.account
        if missed is not None:
            missed += (self.network.env.now - self.held_since) // account.duty.interval
        self.nodes.release_radio(0, missed)
        if not account.held:
            return
        account.held = False
        account.joules["switch"] += 0.0 if self.held_on else STOP
        if missed is not None:
            wake_ups = (self.network.env.now - self.held_since) / account.duty.interval - missed
            self._add(wake_ups * account.duty.on, wake_ups * account.duty.starts)
            if account.mode is Mode.ASLEEP:
                self.mode(Mode.AWAKE)
            self.pass_time(1.0)

    def duty(self, index: int) -> None:
        self.nodes.set_duty(0, index)
        if self.account.mode is not Mode.DOWN:
            self.account.duty = DUTIES[index]

    def listen(self, amounts: tuple[float, int]) -> None:
        if min(amounts) < 0 and (self.account.held or self.account.mode in (Mode.ASLEEP, Mode.DOWN)):
            return  # only a radio that follows a duty has something to give back
        self.nodes.spend_listening(0, *amounts)
        if self.account.mode is not Mode.DOWN:
            self._add(*amounts)
            self.pass_time(1.0)

    def _add(self, seconds: float, starts: float) -> None:
        self.account.joules["idle"] += LISTEN * seconds
        self.account.joules["sleep"] -= (
            0.0 if self.account.held and self.account.mode is not Mode.ASLEEP else SLEEP * seconds
        )
        self.account.joules["switch"] += (START + STOP) * starts
        self.account.on += seconds

    def mode(self, mode: Mode) -> None:
        mode = self.rest if mode is Mode.DORMANT else mode
        self.nodes.set_mode(0, mode)
        if self.account.mode is not Mode.DOWN:
            self.account.mode = mode

    def receive(self, seconds: float) -> None:
        """A frame that ended now, and began when the radio was what it is now."""
        if self.account.mode not in (Mode.DORMANT, Mode.AWAKE):
            return
        self.nodes.spend_receive(0, 2e-5, 100, seconds=seconds)
        self.account.joules["rx"] += 2e-5
        self.account.busy(seconds)

    def crash(self, _: None) -> None:
        self.nodes.crash(0)
        self.account.mode, self.account.held, self.account.duty = Mode.DOWN, False, DUTIES[0]

    def restart(self, _: None) -> None:
        self.nodes.restart(0, self.network.env.now)
        if self.account.mode is Mode.DOWN:
            self.account.mode = self.rest

    def pass_time(self, seconds: float) -> None:
        """Let time pass for both."""
        now = self.network.env.now
        end = now + seconds
        self.network.env.run(until=end)
        if self.account.mode is not Mode.SCHEDULED:
            self.account.pass_time(seconds)
            return
        while now < end:
            awake, _, until = self.schedule.state(self.key, now)
            after = min(float(until[0]), end)
            self.account.mode = Mode.AWAKE if awake[0] else Mode.ASLEEP
            self.account.pass_time(after - now)
            now = after
        self.account.mode = Mode.SCHEDULED


def assert_the_same(driven: Driven) -> None:
    """Ledger, totals and the share of time on are those of the account."""
    network, account = driven.network, driven.account
    totals = network.nodes.totals_now() + network.nodes.consumption.network.scheduled(np.array([network.env.now]))[0]
    on = network.nodes.consumption.radio_on()
    network.nodes.close()
    ledger = network.nodes.ledger
    expected = [max(account.joules[name], 0.0) for name in CAUSES]
    assert ledger.joules[:, 0] == pytest.approx(expected, rel=1e-9, abs=1e-9 * account.spent)
    assert totals == pytest.approx(expected, rel=1e-9, abs=1e-9 * account.spent)
    assert on * network.env.now == pytest.approx(account.on, rel=1e-9)
    assert network.ledger_adds_up()


SLEEPS = st.sampled_from([None, DutyCycle(period=1.3, awake_share=0.4), RandomIndependent(period=0.7, probability=0.5)])


@pytest.mark.thorough
@given(PROGRAMS, SLEEPS)
def test_what_a_radio_consumes_is_what_a_plain_account_of_its_states_says(program, sleep):
    driven = Driven(sleep)
    driven.pass_time(1.4)  # what is given back was consumed before
    for passed, (what, argument) in program:
        driven.pass_time(passed)
        getattr(driven, what)(argument)
    driven.mode(Mode.AWAKE)
    driven.release(None)
    driven.pass_time(1.0)
    assert_the_same(driven)


@given(PROGRAMS, SLEEPS, st.floats(0.002, 0.3))
def test_a_node_dies_at_the_instant_at_which_its_account_reaches_its_charge(program, sleep, battery):
    driven = Driven(sleep, energy=Power(battery))
    network, account = driven.network, driven.account
    for passed, (what, argument) in [*program, (1.0, ("hold", False)), (60.0, ("release", None))]:
        if what in ("crash", "restart") or (what == "listen" and min(argument) < 0.0):
            continue
        start, spent = network.env.now, account.spent
        driven.pass_time(passed)
        if network.died:
            ((time, _),) = network.died
            assert spent < battery * (1.0 + 1e-9) and account.spent > battery * (1.0 - 1e-9)
            assert start < time <= start + passed
            if sleep is None:
                power = (account.spent - spent) / passed
                assert time == pytest.approx(start + (battery - spent) / power, abs=1e-8, rel=1e-9)
            assert network.nodes.ledger.spent[0] == battery and network.ledger_adds_up()
            return
        assert account.spent < battery * (1.0 + 1e-9)
        getattr(driven, what)(argument if what != "release" else None)
        if network.died:
            assert account.spent > battery * (1.0 - 1e-9)
            return


def test_a_wake_up_that_hears_something_can_be_charged_to_the_microsecond():
    """A radio wakes every 0.5 s at 0.1 s and listens for 20 ms; in its fourth wake-up a frame of 3 ms comes after 8 ms.

    The radio stays on for 40 ms after it. Sixteen intervals are counted by hand.
    """
    network = network_of(1, [RadioDuty(0.5, 1.0, 0.02)], energy=Power(start_time=0.0))
    nodes = network.nodes
    frame, wake_up = 1.608, 1.6

    def heard() -> None:
        nodes.spend_receive(0, 2e-5, 100, seconds=0.003)
        nodes.spend_listening(0, frame - wake_up - 0.02)  # the rest of the wake-up was the frame
        nodes.hold_radio(0, on=True)

    network.at(frame + 0.003, heard)
    network.at(frame + 0.043, lambda: nodes.release_radio(0, missed=0))
    network.env.run(until=8.0)
    nodes.close()
    listened = 15 * 0.02 + 0.008 + 0.04
    asleep = 8.0 - listened - 0.003
    assert nodes.ledger.joules[IDLE, 0] == pytest.approx(LISTEN * listened, rel=1e-9)
    assert nodes.ledger.joules[SWITCH, 0] == pytest.approx(16 * (START + STOP), rel=1e-9)
    assert nodes.ledger.joules[SLEEPING, 0] == pytest.approx(SLEEP * asleep + PROCESSOR * 8.0, rel=1e-9)


def test_the_shares_of_two_assessments_eight_times_a_second_on_a_cc2420():
    """Two of 192 µs at 8 Hz: 0.31 % on, and 0.62 % with the turn-on of 0.194 ms before each of them."""
    states = build(load("gmtt", ["duration=4 s"])).energy
    radio = replace(states.radio, sleep=0.0, wake=0.194e-3, wake_power=states.radio.listen, doze=0.0)
    network = network_of(1, [RadioDuty(0.125, 2.0, 2 * 192e-6)], energy=replace(states, radio=radio))
    network.env.run(until=10.0)
    assert network.nodes.consumption.radio_on() == pytest.approx(0.0031, rel=0.01)
    network.nodes.close()
    joules = network.nodes.ledger.joules[:, 0]
    assert joules[IDLE] / 10.0 == pytest.approx(radio.listen * 16 * 192e-6, rel=1e-9)
    assert (joules[IDLE] + joules[SWITCH]) / (10.0 * radio.listen) == pytest.approx(0.0062, rel=0.01)


def test_a_radio_without_a_duty_is_neither_held_nor_released():
    books = []
    for calls in (False, True):
        network = RadioNetwork([(0, 0)], energy=FirstOrder(idle=0.06, sleep=0.01, switch=1e-3))
        if calls:
            network.at(1.0, lambda network=network: network.nodes.hold_radio(0))
            network.at(2.0, lambda network=network: network.nodes.release_radio(0, 0))
            network.at(3.0, lambda network=network: network.nodes.spend_listening(0, 1.0, 1))
        network.env.run(until=5.0)
        assert network.nodes.consumption.radio_on() is None
        network.nodes.close()
        books.append(network.nodes.ledger.joules.copy())
    assert np.array_equal(*books)


def test_a_first_order_radio_pays_its_switch_for_each_start_and_each_stop():
    network = network_of(1, [RadioDuty(0.5, 1.0, 0.02)], energy=FirstOrder(switch=1e-3))
    network.at(2.0, lambda: network.nodes.hold_radio(0))
    network.at(3.0, lambda: network.nodes.release_radio(0))
    network.env.run(until=4.0)
    network.nodes.close()
    assert network.nodes.ledger.joules[SWITCH, 0] == pytest.approx((3.0 / 0.5 + 1.0) * 2e-3)


def test_channels_of_a_mac_share_numbers_and_losses_but_no_collisions():
    network = RadioNetwork([(0, 0), (30, 0), (60, 0)])
    services = network.mac._services
    first, second = (services.open_channel(Csma(), 128e-6) for _ in range(2))
    got = []
    for channel, source in ((first, 0), (second, 2)):
        frame = MacFrame(1, 232, packets=1, target=-1)
        sent = channel.transmit(source, frame, lambda sent, received: got.append((sent.number, received)))
        assert channel.is_sending(source) and sent.overlapping is None
    assert not second.is_busy(0) or not first.is_busy(2)
    network.env.run(until=1.0)
    assert got == [(1, True), (2, True)] and network.counters.collided == 0


@pytest.mark.thorough
def test_the_share_of_time_on_is_a_column_only_where_radios_are_switched_off(tmp_path):
    changes = ["duration=1 s", f"mac.kind={__name__}:MostlyOff"]
    runs = {}
    for name, overrides in (("always", changes[:1]), ("off", changes)):
        wsnsim.run(load("ekf_real", overrides), out=tmp_path / f"{name}.h5", replicates=1)
        runs[name] = wsnsim.read(tmp_path / f"{name}.h5", "runs")
    assert "radio_on" not in runs["always"] and 0.003 < runs["off"]["radio_on"][0] < 0.1


@part
class MostlyOff(Csma):
    """CSMA/CA whose radios are charged as if they followed a duty."""

    duties = DUTIES[:1]


def test_what_a_mac_gave_back_last_is_taken_off_at_the_end_too():
    """A run may end before a duty has consumed again what a frame in its last wake-up took the place of."""
    network = network_of(2, [RadioDuty(0.5, 1.0, 0.02)])
    network.at(4.0, lambda: network.nodes.hold_radio(1))
    network.at(4.9, lambda: network.nodes.release_radio(1, missed=3))
    network.at(4.999, lambda: network.nodes.set_duty(0, 0))
    network.at(4.999, lambda: network.nodes.spend_listening(0, -0.01, -1))
    network.env.run(until=5.0)
    totals = network.nodes.totals_now()
    network.nodes.close()
    assert totals == pytest.approx(network.nodes.ledger.totals, rel=1e-9)
    assert network.nodes.ledger.joules[IDLE, 0] == pytest.approx(LISTEN * (5.0 / 0.5 * 0.02 - 0.01), rel=1e-9)
    assert (network.nodes.ledger.joules >= 0.0).all() and network.ledger_adds_up()
