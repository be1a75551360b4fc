"""Notes for readers: on values of a scenario that are probably not intended, and beside the figures of its runs.

    before_a_run(setup), of_setup(setup) -> notes, by the table `RULES`
    of_report(report, figures) -> notes            reasons(report, figures) -> {figure without a value: reason}
    parts(positions, reach) -> [node numbers of each part of a network], the largest first

A network is in one piece if links join all nodes. A disk of the communication range stands for the links, lossy ones
included: beyond it no frame is received. Recorded links are those that deliver half of the frames in both directions,
in the first round.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np

import wsnsim.scenario as scenarios
from wsnsim.analysis import recording_notes, setup_notes
from wsnsim.analysis.conclusions import degenerate
from wsnsim.analysis.quantities import FIGURES, NETWORK_ONLY
from wsnsim.analysis.setup_notes import covering_range, named
from wsnsim.analysis.statistics import LEAST
from wsnsim.base.arrays import Floats, Ints, is_relative, planar
from wsnsim.base.errors import RunError, counted
from wsnsim.base.initial_conditions import InitialConditions, node_names, sample_initial_conditions, sample_positions
from wsnsim.base.optional_ports import ReportsState, Snapshots
from wsnsim.base.radio import RecordsLinks
from wsnsim.base.results import COUNTS, ROWS, Report, provenance_of
from wsnsim.base.sensing import detected
from wsnsim.base.setups import BeaconSetup, NetworkSetup, RadioSetup, Setup, TrackingSetup
from wsnsim.recording import read_json

ALWAYS, BEFORE_A_RUN, IN_A_CHECK = "always", "before a run", "in a check"
SURELY_LINKED: Final = 3.0
"""With more expected neighbours than this (mean over the field), some nodes are surely within range of another."""
UNKNOWN: Final = "it is not known in any run"
OF_THREE: Final = ("rmse_three", "mean_error_three", "median_error_three")
"""Errors at the steps with three readings or more."""
ON_REQUEST: Final = "it is computed by `wsnsim run --bound`"
FEWEST_DIFFERENCES: Final = 3
"""Nodes whose differences of readings fix a place in the plane, but for a few more places."""


class _Visibility(NamedTuple):
    """Of how many steps of a target it is out of the sensing range of all nodes, and outside the field."""

    steps: int
    unheard: int
    outside: int
    nearest: float


def first_run(setup: Setup) -> Iterator[str]:
    """What the initial conditions of the first run make hopeless or harder than it looks, or why it cannot start."""
    try:
        if isinstance(setup, BeaconSetup):
            yield from _parted(setup, sample_positions(setup, setup.link.reach, 0))
        if not isinstance(setup, TrackingSetup):
            return
        conditions = sample_initial_conditions(setup, 0)
    except RunError as error:
        yield f"run 0 cannot start: {error}"
        return
    yield from _skipped(provenance_of(setup))
    if setup.recorded is not None:
        yield from _silent_steps(setup)
    else:
        yield from _visibility_notes(setup, [_visibilities(setup, conditions, setup.steps)], "run 0")
    if isinstance(setup, NetworkSetup):
        yield from _parted(setup, conditions.positions)


def links_that_reach_nobody(setup: RadioSetup) -> Iterator[str]:
    """A communication range within which no node has another, in the first run; looked for where nodes are sparse."""
    if isinstance(setup.link, RecordsLinks):
        return
    field, reach = setup.deploy.field, setup.link.reach
    if getattr(setup.deploy, "nodes", 0) * math.pi * reach**2 > SURELY_LINKED * field.width * field.height:
        return
    with contextlib.suppress(RunError):  # `first_run` says so
        positions = sample_positions(setup, covering_range(setup), 0)
        if len(positions) > 1 and (said := nobody(positions, reach)):
            yield f"run 0: {said}"


def few_differences(setup: TrackingSetup) -> Iterator[str]:
    """Steps of the first run at which one or two nodes alone measure a target, by the differences of their readings."""
    if not is_relative(setup.sensor):
        return
    with contextlib.suppress(RunError):  # `first_run` says so
        conditions = sample_initial_conditions(setup, 0)
        points = [
            planar(truth[1:, list(each.position)]) for each, truth in zip(setup.motions, conditions.truths, strict=True)
        ]
        seen = [detected(setup.sensor, each, conditions.positions) for each in points]
        if setup.recorded is not None:
            found = setup.recorded.recordings(node_names(setup), len(setup.motions), setup.steps, setup.dt)
            seen = [each.counts[1:] > 0 for each in found]
        for target, nodes in enumerate(each.sum(axis=1) for each in seen):
            if few := int(((nodes > 0) & (nodes < FEWEST_DIFFERENCES)).sum()):
                yield (
                    f"run 0: one or two nodes alone measure target {target} at {few:,} of {setup.steps:,} steps: one "
                    "reading says nothing of the place, two that the target is on a hyperbola"
                )


RULES: Final[tuple[tuple[str, type[Setup], Callable[[Any], Iterator[str]]], ...]] = (
    (ALWAYS, Setup, setup_notes.keys_without_effect),
    (ALWAYS, Setup, setup_notes.parameters_without_effect),
    (ALWAYS, Setup, setup_notes.faults_that_hit_nobody),
    (ALWAYS, Setup, setup_notes.faults_between_instants),
    (ALWAYS, TrackingSetup, setup_notes.motions_beyond_the_field),
    (ALWAYS, TrackingSetup, setup_notes.targets_that_never_exist),
    (ALWAYS, TrackingSetup, setup_notes.steps_across_the_field),
    (ALWAYS, TrackingSetup, setup_notes.shadowing_that_filters_ignore),
    (ALWAYS, TrackingSetup, recording_notes.absent_movers),
    (ALWAYS, TrackingSetup, recording_notes.unread_identifiers),
    (ALWAYS, TrackingSetup, recording_notes.late_readings),
    (ALWAYS, TrackingSetup, recording_notes.unexplained_readings),
    (ALWAYS, TrackingSetup, setup_notes.gaussian_filter_of_cells),
    (ALWAYS, TrackingSetup, setup_notes.cells_beside_the_readings),
    (ALWAYS, TrackingSetup, setup_notes.places_in_another_unit),
    (ALWAYS, RadioSetup, setup_notes.sink_outside_the_field),
    (ALWAYS, RadioSetup, setup_notes.sensitivity_beside_a_datasheet),
    (ALWAYS, RadioSetup, setup_notes.links_that_are_left_out),
    (ALWAYS, Setup, setup_notes.longer_than_the_run),
    (ALWAYS, RadioSetup, setup_notes.sleep_that_costs_more),
    (ALWAYS, NetworkSetup, setup_notes.steps_shorter_than_a_hop),
    (ALWAYS, NetworkSetup, setup_notes.rounds_longer_than_a_step),
    (ALWAYS, NetworkSetup, setup_notes.messages_after_their_step),
    (ALWAYS, RadioSetup, setup_notes.radios_that_save_nothing),
    (ALWAYS, RadioSetup, setup_notes.beacons_that_fill_the_channel),
    (ALWAYS, TrackingSetup, few_differences),
    (BEFORE_A_RUN, RadioSetup, links_that_reach_nobody),
    (IN_A_CHECK, TrackingSetup, setup_notes.window_out_of_reach),
    (IN_A_CHECK, Setup, first_run),
)
"""(when a rule is asked, what setups it is about, what it notes of one).

A check looks at the whole graph of links in place of the nearest nodes; a run that is a trial is meant to be short.
"""


def before_a_run(setup: Setup) -> list[str]:
    """A sentence on each value that is probably not intended, and whether no node can reach another."""
    return of_setup(setup, BEFORE_A_RUN)


def of_setup(setup: Setup, when: str = IN_A_CHECK) -> list[str]:
    """What makes a valid scenario hopeless or harder than it looks: its values, and the initial conditions of a run."""
    return [
        note
        for asked, about, rule in RULES
        if asked in (ALWAYS, when) and isinstance(setup, about)
        for note in rule(setup)
    ]


def of_report(report: Report, figures: Mapping[str, Any]) -> list[str]:
    """Which steps have no estimate, and whether targets were out of range in runs that were not tracked throughout."""
    missing, steps = figures["without_estimate"], figures["present_steps"]
    notes = _absences(report)
    if missing == steps:
        notes.append("no step has an estimate: there is no error")
    elif missing:
        count = f"{missing:,.4g} of {steps:,.10g} steps"
        notes += [f"{count} have no estimate (mean of the runs); errors are over the others"]
    tracker = report.scenario.tracker
    consistency = (figures[key] for key in ("nees_median", "ever_lost", "singular"))
    if said := degenerate(getattr(tracker, "particles", None), *consistency):
        notes.append(f"{tracker.kind}: {said}")
    for table, port in (("particles", Snapshots), ("tracker_state", ReportsState)):
        if getattr(report.scenario.record, table) and not issubclass(tracker.part, port):
            notes.append(f"record.{table}: the table is empty: the tracker {tracker.kind} has none")
    poor = [summary for summary in report.summaries if any(track["tracked"] < 1.0 for track in summary.tracks)]
    if report.out.is_file():  # it may have been moved since
        notes += _skipped(read_json(report.out, "provenance_json", optional=True))
    setup = scenarios.build(report.scenario) if poor else None
    if not isinstance(setup, TrackingSetup):
        return notes
    if setup.recorded is not None:
        return notes + _silent_steps(setup)
    seen = [
        _visibilities(setup, sample_initial_conditions(setup, summary.run["replicate"]), summary.run["steps"])
        for summary in poor
    ]
    when = (
        f"run {poor[0].run['replicate']}" if len(poor) == 1 else f"mean of the {len(poor)} runs with steps not tracked"
    )
    return notes + _visibility_notes(setup, seen, when)


def _absences(report: Report) -> list[str]:
    """In how many runs no target existed, or one of several did not, and how long tracks of absent ones were kept."""
    runs = [summary.tracks for summary in report.summaries]
    if "time_present" not in runs[0][0]:
        return []
    there = np.array([[track["time_present"] > 0.0 for track in tracks] for tracks in runs])
    empty, absent = int((~there.any(axis=1)).sum()), (~there).sum(axis=0).tolist()
    kept = float(np.mean([sum(track["false_time"] for track in tracks) for tracks in runs]))
    found = [f"no target in {empty} of {counted(len(runs), 'run')}"] if empty else []
    each = enumerate(absent if there.shape[1] > 1 else [])
    found += [f"target {i} never existed in {count} of {counted(len(runs), 'run')}" for i, count in each if count]
    if kept:
        found.append(
            f"tracks were kept for {kept:.4g} s while their target was absent (false time, mean of the runs): "
            "that counts as energy, not as error"
        )
    return found


def _skipped(provenance: Mapping[str, Any]) -> list[str]:
    """How many rows of recorded files are left out, and which is the first of each file."""
    rows: Sequence[str] = provenance.get(ROWS, ())
    first = {name: next((row for row in rows if row.startswith(f"{name}:")), "") for name in provenance.get(COUNTS, {})}
    return [
        f"{counted(count, 'row')} of {name} left out" + (f", such as {first[name]}" if first[name] else "")
        for name, count in provenance.get(COUNTS, {}).items()
    ]


def _silent_steps(setup: TrackingSetup) -> list[str]:
    """At how many steps no node has a recorded reading of a target."""
    assert setup.recorded is not None, "readings are sampled"
    recordings = setup.recorded.recordings(node_names(setup), len(setup.motions), setup.steps, setup.dt)
    silent = [int((recording.counts[1:].sum(axis=1) == 0).sum()) for recording in recordings]
    return [
        f"no node has a recorded reading of target {target} at {count:,} of {setup.steps:,} steps"
        for target, count in enumerate(silent)
        if count
    ]


def _parted(setup: BeaconSetup | NetworkSetup, positions: Floats) -> list[str]:
    """The note on a network that falls into parts."""
    said = parted(setup, positions)
    return [f"run 0: {said}"] if said else []


def reasons(report: Report, figures: Mapping[str, Any]) -> dict[str, str]:
    """Why each figure without a value has none."""
    unknown = [
        key
        for key, value in figures.items()
        for each in (value.values() if isinstance(value, Mapping) else (value,))
        if isinstance(each, float) and math.isnan(each)
    ]
    return {key: _reason(key, report, figures) for key in unknown}


def _reason(key: str, report: Report, figures: Mapping[str, Any]) -> str:
    base = key.removesuffix("_low").removesuffix("_high")
    known = figures.get(base, math.nan)
    if base != key and isinstance(known, float) and math.isfinite(known):
        few = len(report.summaries) < LEAST
        return f"an interval needs {LEAST} runs" if few else "it is known in too few runs"
    if base.startswith("bound") and figures["bound_reason"]:
        return str(figures["bound_reason"])
    if base in NETWORK_ONLY and report.scenario.network is not None:
        return "no network is simulated"
    if base in OF_THREE and math.isnan(figures["rmse"]):
        return "no step has an estimate"
    return (FIGURES[base].unknown if base in FIGURES else "") or UNKNOWN


def _visibilities(setup: TrackingSetup, conditions: InitialConditions, steps: int) -> list[_Visibility]:
    """How well each target can be seen over the steps of a run."""
    from scipy.spatial import KDTree  # slow to import, and needed only if a target was not tracked throughout

    tree = KDTree(conditions.positions)
    found = []
    for motion, truth in zip(setup.motions, conditions.truths, strict=True):
        points = planar(truth[1 : steps + 1, list(motion.position)])
        points = points[np.isfinite(points[:, 0])]
        distances = tree.query(points)[0]
        inside = setup.deploy.field.contains(points)
        unheard = int((distances > setup.sensor.reach).sum())
        found.append(_Visibility(len(points), unheard, int((~inside).sum()), float(distances.min(initial=math.inf))))
    return found


def _visibility_notes(setup: TrackingSetup, runs: Sequence[Sequence[_Visibility]], when: str) -> list[str]:
    """What is said of the targets that no node can measure at some steps."""
    notes = []
    for target in range(len(setup.motions)):
        of = [run[target] for run in runs]
        steps, unheard, outside = (
            float(np.mean([getattr(each, key) for each in of])) for key in _Visibility._fields[:3]
        )
        reach = f"the sensing range of {setup.sensor.reach:g} m"
        if 0 < unheard == steps:
            nearest = min(each.nearest for each in of)
            notes.append(
                f"{when}: target {target} is never within {reach} of a node; the nearest is {nearest:.4g} m away"
            )
        elif unheard:
            count = f"{unheard:,.4g} of {steps:,.4g} steps"
            notes.append(f"{when}: target {target} is not within {reach} of any node at {count}")
        if unheard and outside:
            place = named(setup.deploy.field)
            notes.append(f"{when}: target {target} is outside {place} at {outside:,.4g} of {steps:,.4g} steps")
    return notes


MOST: Final = 20_000
"""Nodes above which nothing is said: a graph of more takes seconds [our choice]."""
USABLE: Final = 0.5
"""Ratio of frames that a recorded link must deliver in both directions."""
SHOWN: Final = 4
"""Parts whose sizes are given."""


def parts(positions: Floats, reach: float) -> list[Ints]:
    """The nodes of each connected part of a network, the largest first.

    Args:
        positions: (N, 2) positions in m.
        reach: communication range in m.
    """
    from scipy.spatial import KDTree  # slow to import; for `wsnsim check` alone

    return _joined(len(positions), KDTree(positions).query_pairs(reach))


def _joined(nodes: int, pairs: Iterable[tuple[int, int]]) -> list[Ints]:
    """The nodes of each part that pairs of linked nodes join, the largest first."""
    import networkx as nx  # slow to import; for `wsnsim check` alone

    graph = nx.empty_graph(nodes)
    graph.add_edges_from(pairs)
    found = sorted(nx.connected_components(graph), key=lambda part: (-len(part), min(part)))
    return [np.array(sorted(part)) for part in found]


def parted(setup: NetworkSetup | BeaconSetup, positions: Floats) -> str:
    """A sentence on the parts of a network, '' if it is in one piece or too large to be looked at."""
    reach = setup.link.reach
    if not 1 < len(positions) <= MOST or not np.isfinite(reach):
        return ""
    if isinstance(setup.link, RecordsLinks):
        heard = [setup.link.heard(0, source) for source in range(len(positions))]
        usable = {(i, to) for i, (ids, _, ratios) in enumerate(heard) for to in ids[ratios >= USABLE].tolist()}
        found = _joined(len(positions), {(a, b) for a, b in usable if (b, a) in usable})
        links = "recorded link that delivers half of the frames"
    elif said := nobody(positions, reach):
        return said
    else:
        found, links = parts(positions, reach), f"link of {reach:g} m"
    if len(found) == 1:
        return ""
    sizes = ", ".join(str(len(part)) for part in found[:SHOWN]) + (", ..." if len(found) > SHOWN else "")
    alone = sum(len(part) == 1 for part in found)
    lonely = f"; {alone} nodes have no neighbour" if alone else ""
    said = f"the network is in {len(found)} parts, of {sizes} nodes, that no {links} joins{lonely}"
    return said + _cut_off(setup.sink_points, positions, found)


def _cut_off(points: Sequence[tuple[float, float]], positions: Floats, found: Sequence[Ints]) -> str:
    """How many nodes are in parts without a sink, in words; '' if there is no sink, or none is.

    Args:
        points: (x, y) in m of each sink, which is the node nearest to it.
        positions: (N, 2) positions in m.
        found: the nodes of each part.
    """
    sinks = {int(np.hypot(*(positions - point).T).argmin()) for point in points}
    count = sum(len(part) for part in found if sinks.isdisjoint(part.tolist()))
    if not sinks or not count:
        return ""
    which = f"the sink, node {next(iter(sinks))}" if len(sinks) == 1 else "a sink, nodes " + ", ".join(map(str, sinks))
    return f"; {count} of {len(positions)} nodes have no path to {which}"


def nobody(positions: Floats, reach: float) -> str:
    """A sentence on a network of several nodes of which none is within `reach` m of another, '' for any other."""
    from scipy.spatial import KDTree

    nearest = float(KDTree(positions).query(positions, k=2)[0][:, 1].min())
    if nearest <= reach:
        return ""
    return (
        f"no node is within the communication range of {reach:g} m of another: no frame can be received; the two "
        f"nearest are {nearest:.4g} m apart"
    )
