"""What an estimate of a lifetime leaves out, with its size, and what is special about a network."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from wsnsim.base.errors import counted
from wsnsim.base.setups import NetworkSetup
from wsnsim.base.tables import CAUSE
from wsnsim.lifetimes.library import Library, Visit
from wsnsim.lifetimes.quiet import QuietPower
from wsnsim.lifetimes.stores import Stores


def overlap(visit: Visit) -> float:
    """The share of Poisson visits at this rate that would begin while another lasts; 0 for listed visits."""
    rate = visit.visits.rate
    return 0.0 if rate is None else -math.expm1(-rate * visit.visits.duration())


def thinned(most: float, come_back: bool) -> str:
    """What is not known of tracking in a network that has lost more than this share of nodes, the most simulated."""
    if come_back:
        return "visits while nodes are down: all nodes are up in simulated visits, and tracked shares are those"
    return f"visits with more than {most:.0%} of the nodes dead: the tracked share is that with {most:.0%} dead"


def not_modelled(
    setup: NetworkSetup,
    quiet: QuietPower,
    library: Library,
    stores: Stores,
    visit: Visit,
    strays: Sequence[float],
    horizon: float,
) -> Iterator[str]:
    """Yield what is left out, each with its size.

    Args:
        setup: the network.
        quiet: its power without a target.
        library: its visits.
        stores: their batteries.
        visit: the window of a visit.
        strays: mean share of the nodes that are dead in a path, but not in the library, at the begin of each epoch.
        horizon: end of the paths in s.
    """
    visits = visit.visits
    nodes = np.flatnonzero(stores.alive & np.isfinite(stores.joules))
    if nodes.size:
        power = quiet.watts.sum(axis=0) + visits.frequency(horizon) * library.added.mean(axis=0)
        uneven = float(power[nodes].std() / max(float(power[nodes].max()), 1e-300))
        yield (
            "choices that depend on residual energy: batteries are full in simulated visits; at the first death those "
            f"of equal capacity differ by {uneven:.1%} of it (standard deviation)"
        )
    if visits.rate is not None:
        soon = -math.expm1(-visit.tail / float(visits.gaps().min()))
        yield (
            f"memory between visits: {soon:.1%} begin less than {visit.tail:g} s after another has ended (busiest "
            "hour), and are simulated as if it had not been"
        )
        yield f"visits that overlap: {overlap(visit):.1%} of Poisson visits at this rate would; here none does"
    kept = float((library.false_time > 0.9 * visit.tail).mean()) if library.false_time.size else 0.0
    if kept:
        yield (
            f"tracks of targets that have left: in {kept:.0%} of the simulated visits one was kept to the end, "
            f"{visit.tail:g} s later, and what it costs from then on is left out"
        )
    if setup.faults:
        yield f"faults of the scenario: {len(setup.faults)} are ignored"
    if strays:
        yield (
            f"paths that differ from the median path: {max(strays):.0%} of the nodes that are dead in a path are alive "
            "in the simulated visits of its epoch (mean of the paths, largest of the epochs)"
        )
    error = float(quiet.error.sum(axis=0)[nodes].mean()) if nodes.size else 0.0
    if error:
        share = error / max(float(quiet.watts.sum(axis=0)[nodes].mean()), 1e-300)
        yield f"the error of the quiet power, {share:.2%} of it"


def notes(quiet: QuietPower, library: Library, stores: Stores, visit: Visit, horizon: float) -> Iterator[str]:
    """Yield what is special about a network, and how it was treated."""
    visits = visit.visits
    living = np.flatnonzero(stores.alive)
    mortal = living[np.isfinite(stores.joules[living])]
    most = library.added.max(axis=0)
    if not visits.frequency(horizon):
        yield "no target comes before the horizon: the network is quiet"
    elif visits.rate is None and visits.begins[-1] < horizon:
        yield f"the last visit begins at {visits.begins[-1]:g} s; the network is quiet from then on"
    if not mortal.size:
        yield "all nodes are on mains or have infinite batteries: none can die"
    if living.size < stores.alive.size:
        dead = stores.alive.size - living.size
        yield f"{counted(dead, 'node')} dead at the start, with nothing to draw: no first death"
    small = int((most[mortal] >= stores.joules[mortal]).sum())
    if small:
        yield f"one visit can empty the batteries of {counted(small, 'node')}: a death is timed evenly within the visit"
    if not quiet.watts[CAUSE["sleep"], living].any() and quiet.watts[:, living].any():
        yield "no node ever sleeps: nearly all energy is that of the quiet network"
