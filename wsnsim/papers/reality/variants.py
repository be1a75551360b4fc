"""The words of the variants that depend on a recording: each track with its readings and the law of the others.

filled(document, folder) -> the document with the tracks of a folder

    T, recorded                   recorded readings; the tracker assumes path loss alone
    T, simulated                  readings drawn from that law, on the same trajectory
    T, recorded, gains            recorded readings; path loss and the gain of each receiver
    T, simulated, gains           readings with these gains, and with correlated shadowing and noise as fitted
    T, recorded, unknown gains    recorded readings; the tracker knows only how much gains vary
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from wsnsim.papers.document import PaperDocument
from wsnsim.papers.reality.recording import TrackFolder, WalkedTrack, recording, shipped_folder
from wsnsim.scenario.documents import Document

SCENARIO = "recorded_track"
"""The shipped scenario on which the settings of all variants are laid."""
MARGIN = 1.0
"""Metres of the field around receivers and tracks."""


def filled(document: Document[PaperDocument], folder: Path | None = None) -> Document[PaperDocument]:
    """The document with the tracks of a folder, or of the shipped one, as the text `tracks` and as words.

    Raises:
        UsageError: the folder has no receivers, or fewer than two tracks.
        RunError: a file cannot be used; names file and line.
    """
    content, found = document.content, recording(folder or shipped_folder())
    names = [track.name for track in found.tracks]
    words = dict(_words(found, content.published["registered"]))
    experiments = list(content.experiments)
    if folder is not None:
        experiments = [each.model_copy(update={"name": f"{folder.name}_{each.name}"}) for each in experiments]
    new = {"texts": content.texts | {"tracks": names}, "words": content.words | words, "experiments": experiments}
    return replace(document, content=content.model_copy(update=new))


def _words(found: TrackFolder, registered: Mapping[str, Any]) -> Iterator[tuple[str, str | list[str]]]:
    """The words of every track, each with its settings."""
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
    places = [found.sample.places[:, :2], found.sample.points[:, :2]]
    low = [min(float(each[:, i].min()) for each in places) - MARGIN for i in (0, 1)]
    high = [max(float(each[:, i].max()) for each in places) + MARGIN for i in (0, 1)]
    centre = [round((a + b) / 2, 3) for a, b in zip(low, high, strict=True)]
    width, height = (round(b - a, 3) for a, b in zip(low, high, strict=True))
    return {"width": width, "height": height, "centre": centre, "cover": False}


def _setting(role: str, component: Mapping[str, Any]) -> str:
    return f"{role}={json.dumps(component)}"
