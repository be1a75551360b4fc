"""The variants and claims that depend on a recording: each track with its readings and the law of the others. Figures.

T, recorded                   recorded readings; the tracker assumes path loss alone
T, simulated                  readings drawn from that law, on the same trajectory
T, recorded, gains            recorded readings; path loss and the gain of each receiver
T, simulated, gains           readings with these gains, and with correlated shadowing and noise as fitted
T, recorded, unknown gains    recorded readings; the tracker knows only how much gains vary
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Mapping
from itertools import product
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wsnsim.papers.toolkit import COLOURS, Data, Floats, Study, plotting, read_table

from .answers import MEASURES, SUMMARIES, gaps, tracks_of
from .recording import TrackFolder, WalkedTrack, recording, track_residuals

SCENARIO = "recorded_track"
"""The shipped scenario on which the settings of all variants are laid."""
MARGIN = 1.0
"""Metres of the field around receivers and tracks."""
SHIPPED: Final = Path(__file__).parents[2] / "recorded" / "ble"
"""The recorded tracks that come with wsnsim."""
CALIBRATED: Final = ("pf", "gpf", "ekf", "trilateration")
"""Trackers that are run with gains and on the calibrated twin as well."""
ESTIMATING: Final = CALIBRATED[:3]
OTHERS: Final = (
    "pso_gpf", "gsa_gpf", "pso_mhpf", "ipf", "ppf", "central_pf", "rkf", "imsf", "cs_pf", "ics_pf", "cluster", "gmtt",
    "tsstp", "ris",
)  # fmt: skip
PARTICLES: Final = ("pf", "gpf", "pso_gpf", "gsa_gpf", "ipf", "ppf", "central_pf", "cs_pf", "ics_pf", "cluster")
TRACKERS: Final = {
    **{kind: [f"tracker={{kind: {kind}}}"] for kind in (*CALIBRATED, *OTHERS)},
    **{kind: [f"tracker={{kind: {kind}, particles: 400}}"] for kind in PARTICLES},
    "pf": ["tracker={kind: pf, particles: 400}", "record.estimates=true"],
    "pso_mhpf": ["tracker={kind: pso_mhpf, particles: 400, measurements: all}"],
}
"""The settings of every tracker."""
ASSUMPTIONS: Final = {"inflated": ["tracker.assumes.inflate=true"], "estimated": ["tracker.assumes.gains=estimated"]}
MEDIANS: Final = [
    {"of": "all", "id": "rmse", "quantity": "RMSE of a run, median, m", "measure": "median:rmse", "shown": False},
    {"of": "all", "id": "nees", "quantity": "NEES of a run, median", "measure": "median:nees", "shown": False},
]
"""The claims that reasons use."""


def _calibrated_trackers(study: Study, folder: Path | None) -> dict[str, Any]:
    """All tracks with the trackers that are run on a calibrated twin, too."""
    found = recording(folder or SHIPPED)
    names = [track.name for track in found.tracks]
    states = ("recorded", "simulated", "recorded, gains", "simulated, gains", "recorded, unknown gains")
    crossed = [
        *product(names, states[:2], CALIBRATED),
        *product(names, states[2:3], CALIBRATED),
        *product(names, states[3:4], [f"{kind}, inflated" for kind in CALIBRATED]),
        *product(names, states[4:], [f"{kind}, estimated" for kind in ESTIMATING]),
    ]
    return {
        "variants": _variants(found, study, crossed),
        "claims": [*(claim for name in names for claim in _of_track(name)), *MEDIANS],
    }


def _other_trackers(study: Study, folder: Path | None) -> dict[str, Any]:
    """All tracks with all other trackers."""
    found = recording(folder or SHIPPED)
    names = [track.name for track in found.tracks]
    claims = [_gap_claim(name, kind) for name in names for kind in OTHERS]
    crossed = product(names, ("recorded", "simulated"), OTHERS)
    return {"variants": _variants(found, study, crossed), "claims": [*claims, *MEDIANS]}


def _variants(found: TrackFolder, study: Study, crossed: Iterable[tuple[str, str, str]]) -> dict[str, list[str]]:
    """{'TRACK, readings, TRACKER': scenario and settings}."""
    of_track = dict(_settings_of_tracks(found, study.registered))
    return {
        f"{track}, {state}, {tracker}": [
            *of_track[f"{track}, {state}"],
            *(setting for word in tracker.split(", ") for setting in (TRACKERS | ASSUMPTIONS)[word]),
        ]
        for track, state, tracker in crossed
    }


def _of_track(track: str) -> Iterator[dict[str, Any]]:
    """The claims on a track: recorded readings over simulated ones, and what known and estimated gains change."""
    real = f"{track}, recorded"
    for kind in CALIBRATED:
        yield _gap_claim(track, kind)
    for kind in CALIBRATED:
        one, other = f"{real}, gains, {kind}", f"{track}, simulated, gains, {kind}, inflated"
        yield _claim(
            "factor",
            "RMSE over that on the calibrated twin",
            one,
            other,
            _both("recorded", "calibrated twin", one, other),
        )
    for kind in CALIBRATED:
        one, other = f"{real}, gains, {kind}", f"{real}, {kind}"
        reason = f"NEES {_nees(other)} without gains, {_nees(one)} with them"
        yield _claim("known", "RMSE with known gains over that without", one, other, reason)
    for kind in ESTIMATING:
        one, other = f"{real}, unknown gains, {kind}, estimated", f"{real}, {kind}"
        reason = f"NEES {_nees(other)} without gains, {_nees(one)} with estimated ones"
        yield _claim("estimated", "RMSE with estimated gains over that without", one, other, reason)


def _gap_claim(track: str, kind: str) -> dict[str, Any]:
    one, other = (f"{track}, {word}, {kind}" for word in ("recorded", "simulated"))
    return _claim(
        "factor", "RMSE over that on the simulated twin", one, other, _both("recorded", "simulated", one, other)
    )


def _claim(label: str, quantity: str, one: str, other: str, reason: str) -> dict[str, Any]:
    """The claim of the median RMSE of a variant over that of another."""
    return {"of": one, "id": label, "quantity": quantity, "measure": f"over:{other}; median:rmse", "reason": reason}


def _both(word: str, twin: str, one: str, other: str) -> str:
    """The reason of a ratio: the errors and the NEES of both."""
    errors = [f"{{rmse[{name}].measured:.2f}} m" for name in (one, other)]
    return f"{word} {errors[0]}, {twin} {errors[1]}; NEES {_nees(one)} and {_nees(other)}"


def _nees(variant: str) -> str:
    return f"{{nees[{variant}].measured:.1f}}"


def _settings_of_tracks(found: TrackFolder, registered: Mapping[str, Any]) -> Iterator[tuple[str, list[str]]]:
    """The scenario and the settings of every track with either kind of readings."""
    deploy = {"kind": "file", "path": str(found.nodes), "columns": {"id": "receiver"}, **_field(found)}
    for track in found.tracks:
        laws, step = found.laws(track.name), registered["step"]
        common = [
            SCENARIO,
            f"step={step}",
            f"duration={(math.floor(track.seconds / step) + 1) * step:g}",
            _setting("deploy", deploy),
            _setting("motion", {"kind": "recorded_track", "path": str(track.path), "skip_bad_rows": True}),
        ]
        unknown = {key: value for key, value in laws.gains.items() if key != "gains"} | {"gain_spread": laws.spread}
        for word, sensor in {
            "recorded": _recorded(track, laws.plain),
            "simulated": laws.plain,
            "recorded, gains": _recorded(track, laws.gains),
            "simulated, gains": laws.whole,
            "recorded, unknown gains": _recorded(track, unknown),
        }.items():
            yield f"{track.name}, {word}", [*common, _setting("sensor", sensor)]


def _recorded(track: WalkedTrack, law: Mapping[str, Any]) -> dict[str, Any]:
    """The sensor with the readings of a track, of which a tracker assumes a law."""
    return {
        "kind": "recorded",
        "path": str(track.path),
        "law": dict(law),
        "several": "last",
        "columns": {"node": "receiver", "reading": "rssi"},
        "skip_bad_rows": True,
    }


def _field(found: TrackFolder) -> dict[str, Any]:
    """The field: a rectangle around receivers and tracks."""
    places = [found.sample.deployment.places[:, :2], found.sample.points[:, :2]]
    low = [min(float(each[:, i].min()) for each in places) - MARGIN for i in (0, 1)]
    high = [max(float(each[:, i].max()) for each in places) + MARGIN for i in (0, 1)]
    centre = [round((a + b) / 2, 3) for a, b in zip(low, high, strict=True)]
    width, height = (round(b - a, 3) for a, b in zip(low, high, strict=True))
    return {"width": width, "height": height, "centre": centre, "cover": False}


def _setting(role: str, component: Mapping[str, Any]) -> str:
    return f"{role}={json.dumps(component)}"


LOOKS: Final = {
    "recorded": plotting.Look("recorded readings", COLOURS[1], 1.1),
    "simulated": plotting.Look("simulated twin", COLOURS[0], 1.1),
}
COLUMNS: Final = 3
BINS: Final = np.linspace(-25.0, 25.0, 51)
"""Edges of the histogram's bins, in dB."""


def _panels(figure: Figure, count: int, shared: bool) -> list[Axes]:
    """Axes for as many panels, the unused ones removed."""
    columns = min(count, COLUMNS)
    axes = figure.subplots(math.ceil(count / columns), columns, sharex=shared, sharey=shared, squeeze=False).ravel()
    for empty in axes[count:]:
        empty.remove()
    return list(axes[:count])


def _tracks(figure: Figure, data: Data) -> None:
    """The trajectory of every track, the receivers, and the estimates of one run on either kind of readings."""
    found, kind = tracks_of(data), data.registered["tracker"]
    places = found.sample.deployment.places
    panels = _panels(figure, len(found.tracks), True)
    for axes, track in zip(panels, found.tracks, strict=True):
        for word, look in LOOKS.items():
            path = _estimates(data, f"{track.name}, {word}, {kind}")
            axes.plot(*path.T, color=look.colour, linewidth=look.width, label=look.name)
        plotting.points(axes, places[:, :2], "^", 5, "receivers")
        truth = found.of(track.name).points
        axes.plot(truth[:, 0], truth[:, 1], color=plotting.BLACK, linewidth=1.6, label="truth")
        axes.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
        axes.set_title(f"{track.name}, {track.seconds:.0f} s", loc="left")
        axes.label_outer()
    plotting.legend_below(figure, panels, 4)


def _estimates(data: Data, variant: str) -> Floats:
    """(K, 2) positions of the first run of a variant, which alone may have recorded them."""
    point = data.manifest.points[data.variants.index(variant)]
    table = read_table(data.folder.batches(point.id)[0].path, "estimates", ("replicate", "px", "py"))
    first = table["replicate"] == 0
    return np.column_stack([table["px"][first], table["py"][first]])


def _residuals(figure: Figure, data: Data) -> None:
    """Histograms of readings minus their expectation under the laws of the other tracks, with normal densities."""
    found = tracks_of(data)
    panels = _panels(figure, len(found.tracks), True)
    for axes, track in zip(panels, found.tracks, strict=True):
        these = track_residuals(found, track.name)
        rows = (("path loss alone", these.plain, COLOURS[1]), ("with gains", these.gains, COLOURS[0]))
        for (word, values, colour), sd, bend in zip(rows, these.sd, these.kurtosis, strict=True):
            axes.hist(values, BINS.tolist(), density=True, histtype="step", color=colour, label=word)
            axes.plot(BINS, _normal(BINS, sd), color=colour, linewidth=0.8, linestyle=":")
            at = 0.93 if word == "with gains" else 0.83
            axes.text(0.02, at, f"{sd:.1f} dB, kurtosis {bend:.1f}", color=colour, transform=axes.transAxes, fontsize=8)
        axes.set_title(track.name, loc="left")
        axes.set(xlabel="residual [dB]", ylabel="density [1/dB]")
        axes.label_outer()
    plotting.legend_below(figure, panels)


def _normal(values: Floats, sd: float) -> Floats:
    """The density of N(0, sd²)."""
    density: Floats = np.exp(-0.5 * (values / sd) ** 2) / (sd * math.sqrt(2.0 * math.pi))
    return density


def _gap(figure: Figure, data: Data) -> None:
    """The RMSE on recorded readings over that on the twin, of every tracker on every track, before and after."""
    before = gaps(data)
    after = {gap.tracker: gap for gap in gaps(data, "recorded, gains", "simulated, gains", "inflated")}
    axes = figure.subplots()
    places = {gap.tracker: len(before) - row for row, gap in enumerate(before)}
    for name, at in places.items():
        gap = next(each for each in before if each.tracker == name)
        for shift, each, colour in ((0.15, gap, COLOURS[1]), (-0.2, after.get(name), COLOURS[0])):
            if each is not None:
                values = [found.value for found in each.tracks.values()]
                axes.plot(values, [at + shift] * len(values), "o", color=colour, markersize=3.5, alpha=0.6)
                axes.plot([each.median], [at + shift], "|", color=colour, markersize=13, markeredgewidth=2.0)
    for word, colour in (("path loss alone", COLOURS[1]), ("with gains; calibrated twin", COLOURS[0])):
        axes.plot([], [], "o", color=colour, markersize=3.5, label=word)
    axes.axvline(1.0, color=plotting.GREY, linewidth=0.8)
    axes.axvline(data.registered["factor"], color=plotting.GREY, linewidth=0.8, linestyle=":")
    axes.set_yticks(list(places.values()), list(places))
    axes.set(xscale="log", xlabel="RMSE on recorded readings / on the simulated twin; a dot per track, bar: median")
    axes.set_xticks(ticks := [0.5, 1.0, 1.5, 2.0, 3.0, 4.0], [f"{tick:g}" for tick in ticks])
    axes.set_xticks([], minor=True)
    plotting.legend_below(figure, (axes,))


FIGURES: Final[plotting.Drawings] = {"tracks": _tracks, "residuals": _residuals, "gap": _gap}
EXPERIMENTS: Final = {"tracks": _calibrated_trackers, "trackers": _other_trackers}
__all__ = ["EXPERIMENTS", "FIGURES", "MEASURES", "SUMMARIES"]
