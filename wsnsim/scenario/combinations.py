"""Components that cannot be combined, where neither of them is wrong by itself: one rule each, in one table.

impossible_combinations(setup) -> issues

What a component can say about its own values is in its `check`. `docs/combinations.md` has the table for readers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Final

from wsnsim.base.errors import Issue

if TYPE_CHECKING:
    from wsnsim.base.setups import RadioSetup, Setup


def impossible_combinations(setup: Setup) -> Iterator[Issue]:
    """Yield an issue for each rule that a scenario breaks."""
    from wsnsim.base.setups import RadioSetup

    if isinstance(setup, RadioSetup):
        for rule in RULES:
            yield from rule(setup)


def awake_between_wake_ups(setup: RadioSetup) -> Iterator[Issue]:
    """A sleep schedule whose nodes are awake for less than a wake interval: some sleep whenever their radio is due."""
    from wsnsim.base.hop_times import is_duty_cycled

    awake, interval = getattr(setup.sleep, "awake_part", None), setup.hop.unicast
    if awake is not None and is_duty_cycled(setup.mac) and awake < interval:
        yield Issue(
            ("sleep", "period"),
            f"nodes are awake for {awake:.3g} s at a time, and over mac: {setup.mac.mechanism} a node can be reached "
            f"once in {interval:.3g} s: some never could; give a longer period, or a shorter interval of the radio",
        )


def nothing_to_follow(setup: RadioSetup) -> Iterator[Issue]:
    """A short wake interval that no node would ever use, since nothing tells nodes of a target."""
    from wsnsim.base.setups import NetworkSetup

    if getattr(setup.mac, "near", None) is None:
        return
    if not isinstance(setup, NetworkSetup):
        yield Issue(("mac", "near"), "without a target there is nothing that the wake interval could follow")
    elif setup.head_protocol == "open" and setup.wakeup.mechanism == "none":
        yield Issue(
            ("mac", "near"),
            "no node is told of a target: an open cluster announces nothing, and with wakeup: none there are no "
            "messages; leave mac.near out, or choose other clusters or a wakeup",
        )


def woken_too_late(setup: RadioSetup) -> Iterator[Issue]:
    """Wake-up messages that take longer than the step for which they wake nodes, where nobody is called instead."""
    from wsnsim.base.radio import Mode
    from wsnsim.base.setups import NetworkSetup

    if not isinstance(setup, NetworkSetup) or setup.wakeup.mechanism == "none" or setup.sleep.rest is Mode.SCHEDULED:
        return
    if setup.hop.broadcast >= setup.dt:
        yield Issue(
            ("wakeup", "kind"),
            f"a message takes {setup.hop.broadcast:.3g} s over mac: {setup.mac.mechanism}, and a step lasts "
            f"{setup.dt:g} s: no node would be woken in time, and none sleeps that could be called; give a longer "
            "step, a shorter interval of the radio, or wakeup: none",
        )


def sends_without_end(setup: RadioSetup) -> Iterator[Issue]:
    """A workload whose nodes send more often than one frame takes."""
    from wsnsim.base.hop_times import is_duty_cycled

    workload = getattr(setup, "workload", None)
    period = getattr(workload, "period", None)
    mechanism = getattr(workload, "mechanism", "")
    if mechanism not in ("beacons", "collection") or not isinstance(period, float) or not is_duty_cycled(setup.mac):
        return
    what, takes = ("broadcast", setup.hop.broadcast) if mechanism == "beacons" else ("unicast", setup.hop.unicast)
    if period <= takes:
        yield Issue(
            ("workload", "period"),
            f"{period:g} s is over before a {what} has ended, which takes {takes:.3g} s over mac: "
            f"{setup.mac.mechanism}: frames would queue without end",
        )


def clocks_corrected_twice(setup: RadioSetup) -> Iterator[Issue]:
    """A time synchronisation over a MAC that keeps the clocks together itself: each would undo what the other does."""
    if setup.sync.mechanism != "none" and setup.mac.mechanism == "tsch":
        yield Issue(("sync", "kind"), "mac: tsch keeps the clocks of nodes together itself: use none")


def drift_beyond_guard(setup: RadioSetup) -> Iterator[Issue]:
    """Clocks of which most pairs part by more than the guard of a slot within a step: members miss their slots."""
    from wsnsim.base.setups import NetworkSetup

    guard = getattr(setup.mac, "guard", None)
    if not isinstance(setup, NetworkSetup) or setup.mac.mechanism != "tdma" or guard is None:
        return
    apart = 2.0**0.5 * float(getattr(setup.clock, "sd", 0.0)) * setup.dt
    if apart > guard:
        yield Issue(
            ("mac", "guard"),
            f"in a step of {setup.dt:g} s two clocks drift apart by {apart:.3g} s (standard deviation, by clock.sd), "
            f"more than {guard:g} s: members would miss their slots",
        )


RULES: Final[tuple[Callable[[RadioSetup], Iterator[Issue]], ...]] = (
    awake_between_wake_ups,
    nothing_to_follow,
    woken_too_late,
    sends_without_end,
    clocks_corrected_twice,
    drift_beyond_guard,
)
"""One function for each rule."""
