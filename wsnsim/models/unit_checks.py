"""Checks that question units: degrees taken for metres, fields of millimetres, positions that contradict speeds.

degrees_said(path, kind, x, y), remedy   what refuses columns of degrees, and the command that converts them
too_close(points, reach, least)          what a set of places says of its unit
slower_than_stated, other_than_stated(times, x, y, speeds)      whether a track contradicts its own speeds
unlikely_speeds(times, x, y)             whether it is too fast for metres, or jumps
losses(off, sds), is_explained(loss, unexplained)       whether another unit, or another reason, explains residuals

Scenarios (`check`), `wsnsim import` and `wsnsim fit` use the same checks. All limits are our choice.
"""

from __future__ import annotations

import math
import shlex
from typing import Final

import numpy as np

from wsnsim.base.arrays import Floats

LONGITUDES: Final = frozenset({"lon", "lng", "long", "longitude"})
LATITUDES: Final = frozenset({"lat", "latitude"})
SMALL_PART: Final = 1e-3
"""Places whose extent is a smaller part of the sensing range are in another unit."""
FEW_DEGREES: Final = 1.0
"""Places within the ranges of longitude and latitude whose extent is smaller, and far from (0, 0), are degrees."""
FAR: Final = 5.0
"""How many times farther from (0, 0) than their extent such places are."""
LEAST_SPEED: Final = 0.1
"""m/s: slower movers tell nothing of the unit."""
SLOW: Final = 1e-2
"""Places that move at less than this part of the speed that the file states: a degree is 111 km, a kilometre 1000 m."""
OTHER: Final = 2.0
"""Places that move faster or slower than stated by more than this factor: km/h are 3.6 times as many as m/s."""
FAST: Final = 100.0
"""m/s: movers on the ground whose median speed is greater are several, or in another unit."""
CLEARLY: Final = 0.5
"""Loss by which an explanation must be better than none: that of residuals which are larger by about a half."""
JUMP, LEAST_JUMP = 10.0, 10.0
"""How many times faster than 90 % of its steps, and than so many m/s, a jump is."""


def losses(off: Floats, sds: Floats | float) -> Floats:
    """(n,) log(1 + (r / σ)²) of residuals (n,): of a Cauchy distribution, so that few outliers do not decide it."""
    return np.asarray(2.0 * np.log(np.hypot(1.0, off / sds)))


def is_explained(loss: float, unexplained: float) -> bool:
    """Whether an explanation that leaves this mean loss is clearly better than none."""
    return loss < min(unexplained / 2.0, unexplained - CLEARLY)


def degrees_said(path: str, kind: str, x: str, y: str) -> str:
    """The message that refuses columns called longitude and latitude as x and y; '' if they are not called so."""
    names = {x.strip().casefold(), y.strip().casefold()}
    if not (names & LONGITUDES and names & LATITUDES):
        return ""
    said = f"{path}: the columns '{x}' and '{y}' are degrees, must be metres. Write"
    return f"{said}: {remedy(path, kind, '--crs wgs84')}"


def remedy(path: str, kind: str, option: str) -> str:
    """The command line that converts a file; `kind` is that of the import."""
    return f"wsnsim import {kind} {shlex.quote(path)} {option}"


def other_units(path: str, kind: str) -> str:
    """The end of a note on places that are probably in another unit: the command lines that convert them."""
    return f"in degrees? Write: {remedy(path, kind, '--crs wgs84')}; in kilometres: --unit km"


def too_close(points: Floats, reach: float = math.inf, least: float = 0.0) -> str:
    """Why places (n, 2) in m are probably in another unit, such as '6 places lie within 0.002 m'; '' if they are not.

    Args:
        points: The places.
        reach: Sensing range in m.
        least: Least distance in m that the sensor distinguishes.
    """
    extent = float(np.hypot(*np.ptp(points, axis=0))) if len(points) > 1 else 0.0
    if extent == 0.0:
        return ""
    said = f"all {len(points)} places lie within {extent:.3g} m"
    if extent < least:
        return f"{said}, nearer than the sensor's least distance of {least:g} m"
    if extent < SMALL_PART * reach < math.inf:
        return f"{said}, less than {SMALL_PART:g} of the sensing range of {reach:g} m"
    middle = points.mean(axis=0)
    if extent < FEW_DEGREES and np.hypot(*middle) > FAR * extent and (np.abs(points) <= (180.0, 90.0)).all():
        return f"{said} around ({middle[0]:.6g}, {middle[1]:.6g}), as places in degrees do"
    return ""


def slower_than_stated(times: Floats, x: Floats, y: Floats, speeds: Floats) -> str:
    """Why a track is not in metres: places at times (n,) contradict its own speeds (n,) in m/s; '' if not."""
    found, stated = _usual_speeds(times, x, y, speeds)
    return f"moves by {found:.3g} a second at {stated:.3g} m/s" if found < SLOW * stated else ""


def other_than_stated(times: Floats, x: Floats, y: Floats, speeds: Floats) -> str:
    """What is doubtful where places at times (n,) hardly fit its own speeds (n,) in m/s; '' if nothing."""
    found, stated = _usual_speeds(times, x, y, speeds)
    if stated / OTHER <= found <= OTHER * stated:
        return ""
    said = f"moves by {found:.3g} m a second, and its speeds are {stated:.3g} m/s"
    return f"{said}: places (--unit), times or speeds in another unit, or several movers in one (--column id=NAME)?"


def _usual_speeds(times: Floats, x: Floats, y: Floats, speeds: Floats) -> tuple[float, float]:
    """The median speed by the places of a track, and that of its own speeds, where it moves; 0 if it never does."""
    passed = np.diff(times)
    moving = (passed > 0.0) & (speeds[1:] > LEAST_SPEED)
    if not moving.any():
        return 0.0, 0.0
    found = np.hypot(np.diff(x), np.diff(y))[moving] / passed[moving]
    return float(np.median(found)), float(np.median(speeds[1:][moving]))


def unlikely_speeds(times: Floats, x: Floats, y: Floats) -> str:
    """What is doubtful in the speeds of a track at ascending times (n,) in s and places (n,) in m; '' if nothing."""
    passed, steps = np.diff(times), np.hypot(np.diff(x), np.diff(y))
    speeds = np.divide(steps, passed, out=np.zeros_like(steps), where=passed > 0.0)
    if not speeds.size:
        return ""
    middle, usual = np.quantile(speeds, (0.5, 0.9), method="lower").tolist()
    if middle > FAST:
        return f"moves at {middle:.3g} m/s: several movers in one (--column id=NAME), or not in m (--unit mm)?"
    jumps = np.flatnonzero(speeds > max(JUMP * usual, LEAST_JUMP))
    if not jumps.size:
        return ""
    first = jumps[0]
    more = f", and {jumps.size - 1:,} more times" if jumps.size > 1 else ""
    return (
        f"jumps by {steps[first]:.4g} m in {passed[first]:.3g} s at {times[first + 1]:.10g} s{more}: a wrong row, or "
        "another mover?"
    )
