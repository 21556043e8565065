"""Onset of slip: the skin stops following the object, with a corner, while the object goes on moving.

Tangential force and torsion over the normal force are the load of a contact. While the object sticks, the
beads follow it and the load grows with its way. Then the edge of the contact slides and the part that sticks
shrinks. For a ball on a plane that moves steadily, the load is mu (1 - (1 - t/t_s)^1.5), with the time t_s
when the last point slides (Cattaneo 1938, Mindlin 1949); from then on it is mu. Its growth therefore ends
like the square root of the time that is left, where a motion that is slowed down ends like its first or a
higher power.

The corner is found in the mean motion of all beads, which is more exact than a load. Onset is a steady
growth along one line for three intervals, after which the skin moves less than at half of its speed, and less
than if it went on to slow down evenly. The load has to confirm it: it has grown too, faster than by a weight
that is lifted, and under a normal force that hardly changes. A push that begins abruptly has no steady growth
before its corner, so it is no onset; neither is the slip that such a push causes (docs/calibrating.md).

The same holds for balls and flat faces. A flat face that twists slides at its rim first, so its torsion ends
without a corner. The load at the corner is a measurement of the coefficient of friction.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from operator import mul, sub

import msgspec

from palpate_edge.common.contact import Contact
from palpate_edge.kernels.canonical_field import MeanMotion

Load = tuple[float, float, float, float]

TORSION_RADIUS_MM = 3.0
"""r_t of the friction ellipsoid, 3 pi/16 of a contact radius of 5 mm; see the host's tip_friction.py."""
WINDOW_US = 400_000
MOST_FRAMES = 40
INTERVALS = (1, 2, 3, 4)
"""Frames of an interval. More would take the turn of shear that is moved to and fro for a corner."""
LEAST_NORMAL_N = 0.2
LEAST_LOAD = 0.25
LEAST_GROWTH = 0.1
"""Growth of the load, which the noise of loads does not reach."""
LEAST_BEND = 20.0
"""Growth of the load over the square of an interval, 1/s^2; a weight that is lifted in 1 s has up to 5."""
LARGEST_NORMAL_CHANGE = 0.05
"""Largest relative change of the normal force after the corner."""
LARGEST_NORMAL_GROWTH = 0.15
"""Largest relative change of the normal force in the three intervals before the corner; a push at an angle
changes both forces."""
STEADY = (0.7, 1.5)
"""Growth in the first interval over that in the second; more or less belongs to an abrupt push."""
LEAST_BEFORE = 0.7
"""Growth in the second interval over that in the last; less belongs to a push that begins abruptly."""
STRAIGHT = 1.1
"""Largest way of the skin in the first interval over its part along the way in the last one; an object that
is pushed abruptly rocks at first."""
STILL = 0.5
"""Largest motion after the corner, over that at the speed before."""
SHARP = 0.3
"""By how much the motion after the corner falls short of that of an even deceleration, over that at the speed
before. It is 0.45 for a ball, which ends like the square root of the time that is left."""
CLEAR = 12.0
"""Growth in the last interval over the standard error of a place."""
CLEAR_AFTER = 10.0
"""The same for the way that the speed before would have added after the corner."""
LEAST_NOISE_MM = 1e-4
QUARTILE = 0.3186
"""Lower quartile of the size of a standard normal variable; a corner has only large second differences."""


class LoadedFrame(msgspec.Struct, frozen=True):
    """Time of exposure, load, normal force and mean motion of the beads of one frame."""

    exposed_at_us: int
    load: Load
    normal_N: float
    skin_mm: MeanMotion


LoadHistory = tuple[LoadedFrame, ...]
"""Frames of one contact, oldest first."""


def detect_onset(history: LoadHistory, contact: Contact, skin_mm: MeanMotion) -> tuple[LoadHistory, bool]:
    """Return the history with this frame's contact, and whether slip begins.

    skin_mm: DisplacementReader.mean_motion_mm of the frame's beads.
    """
    frame = _loaded(contact, skin_mm)
    if frame is None:
        return (), False
    oldest_us = frame.exposed_at_us - WINDOW_US
    kept = history[1 - MOST_FRAMES :]
    if kept and kept[0].exposed_at_us < oldest_us:
        kept = tuple(one for one in kept if one.exposed_at_us >= oldest_us)
    frames = (*kept, frame)
    return frames, _has_corner(frames)


def _loaded(contact: Contact, skin_mm: MeanMotion) -> LoadedFrame | None:
    """Return the frame's load: shear and torsion over its radius, over the normal force.

    None where a force is unknown or too small.
    """
    normal_N, shear_N = contact.normal_force_N, contact.shear_N
    if not contact.in_contact or normal_N is None or shear_N is None or normal_N < LEAST_NORMAL_N:
        return None
    twist_N = (contact.torsion_Nmm or 0.0) / TORSION_RADIUS_MM
    x, y, z = shear_N
    load = (x / normal_N, y / normal_N, z / normal_N, twist_N / normal_N)
    return LoadedFrame(contact.exposed_at_us, load, normal_N, skin_mm)


def _has_corner(frames: LoadHistory) -> bool:
    """Return whether skin and load grew steadily up to a corner and have stood still since."""
    if math.hypot(*_mean([one.load for one in frames[-2:]])) < LEAST_LOAD:
        return False
    return any(
        _is_corner(frames, len(frames) - 1 - math.ceil(interval / 3), interval)
        for interval in INTERVALS
        if 3 * interval + math.ceil(interval / 3) < len(frames)
    )


def _is_corner(frames: LoadHistory, corner: int, interval: int) -> bool:
    """Return whether the skin has a corner at this frame, judged by intervals of so many frames."""
    way = tuple(map(sub, frames[corner].skin_mm, frames[corner - interval].skin_mm))
    last_mm = math.hypot(*way)
    if last_mm < CLEAR * LEAST_NOISE_MM:
        return False
    path = [sum(map(mul, way, frames[corner - n * interval].skin_mm)) / last_mm for n in (3, 2, 1)]
    first_mm, second_mm = (after - before for before, after in pairwise(path))
    low, high = STEADY
    if second_mm < LEAST_BEFORE * last_mm or not low * second_mm <= first_mm <= high * second_mm:
        return False
    begun, went_on = frames[corner - 3 * interval], frames[corner - 2 * interval]
    if math.dist(begun.skin_mm, went_on.skin_mm) > STRAIGHT * first_mm:
        return False
    along = [sum(map(mul, way, one.skin_mm)) / last_mm for one in frames]
    share, noise_mm = (len(frames) - 1 - corner) / interval, _noise(along)
    steady_mm = share * last_mm
    if last_mm < CLEAR * noise_mm or steady_mm < CLEAR_AFTER * noise_mm:
        return False
    slowing_mm = max((first_mm - last_mm) / 2.0, second_mm - last_mm)
    slowed_mm = steady_mm - share * slowing_mm * (1.0 + share) / 2.0
    moved_mm = max(abs(one - along[corner]) for one in along[corner + 1 :])
    still_mm = min(STILL * steady_mm, slowed_mm - SHARP * steady_mm)
    return moved_mm <= still_mm and _load_grew(frames, corner, interval)


def _load_grew(frames: LoadHistory, corner: int, interval: int) -> bool:
    """Return whether the load grew up to the corner, under a normal force that stays before and after."""
    lasted_s = 1e-6 * (frames[corner].exposed_at_us - frames[corner - interval].exposed_at_us)
    load = _mean([one.load for one in frames[corner:]])
    before = _mean([one.load for one in frames[corner - 2 * interval : corner - interval]])
    growth, size = sum(map(mul, load, map(sub, load, before))), math.hypot(*load)
    normal_N = [one.normal_N for one in frames[corner - interval :]]
    until, since = normal_N[: interval + 1], normal_N[interval:]
    change = sum(since) / len(since) / (sum(until) / len(until)) - 1.0
    grown = frames[corner].normal_N / frames[corner - 3 * interval].normal_N - 1.0
    is_steady = abs(change) < LARGEST_NORMAL_CHANGE and abs(grown) <= LARGEST_NORMAL_GROWTH
    least_growth = max(LEAST_GROWTH, LEAST_BEND * lasted_s**2)
    return growth > least_growth * size and is_steady


def _mean(loads: Sequence[Load]) -> tuple[float, ...]:
    return tuple(sum(parts) / len(loads) for parts in zip(*loads, strict=True))


def _noise(along: list[float]) -> float:
    """Return the standard error of one place, from the second differences of all."""
    bends = sorted(abs(a - 2.0 * b + c) for a, b, c in zip(along, along[1:], along[2:], strict=False))
    return max(bends[len(bends) // 4] / QUARTILE / math.sqrt(6.0), LEAST_NOISE_MM)
