"""Onset of slip: the load across the skin stops growing, with a corner, while the object goes on moving.

Tangential force and torsion over the normal force are the load of a contact. While the object sticks, the
beads follow it and the load grows with its way. Then the edge of the contact slides and the part that sticks
shrinks. For a ball on a plane that moves steadily, the load is mu (1 - (1 - t/t_s)^1.5), with the time t_s
when the last point slides (Cattaneo 1938, Mindlin 1949); from then on it is mu. Its growth therefore ends
like the square root of the time that is left, where a motion that is slowed down ends like its first or a
higher power. Onset is this corner: a load that stands still for two intervals after it grew in the last one
by more than 1/2.4 of the growth in the one before (sqrt: 1/1.83; first power: 1/3).

The same holds for balls and flat faces, slides and twists. The load at the corner is a measurement of the
coefficient of friction. An object that is stopped abruptly, or held by a push of constant force that begins
abruptly, looks the same (docs/calibrating.md).
"""

from __future__ import annotations

import math

import msgspec

from palpate_edge.common.contact import Contact

Load = tuple[float, float, float, float]

TORSION_RADIUS_MM = 3.0
"""r_t of the friction ellipsoid, 3 pi/16 of a contact radius of 5 mm; see the host's tip_friction.py."""
WINDOW_US = 400_000
MOST_FRAMES = 40
LEAST_NORMAL_N = 0.2
LEAST_LOAD = 0.25
STILL, STILL_NOISE = 0.08, 2.5
"""Largest change of the load after the corner: over its growth in the interval before, and over the standard
error of a load."""
SLOWED = 2.4
"""Growth in the last but one interval over that in the last; more belongs to a motion that is slowed down."""
LEAST_BEND = 8.0
"""Change of the load's growth at the corner, 1/s^2; shear that a hand turns back has 4."""
ABRUPT_BEND = 150.0
"""The same where one frame after the corner suffices."""
CLEAR = 12.0
"""Growth before the corner over the standard error of a load."""
LEAST_NOISE = 1e-3
QUARTILE = 0.3186
"""Lower quartile of the size of a standard normal variable; a corner has only large second differences."""
LARGEST_NORMAL_CHANGE = 0.03


class LoadedFrame(msgspec.Struct, frozen=True):
    """Time of exposure, load and normal force of one frame."""

    exposed_at_us: int
    load: Load
    normal_N: float


LoadHistory = tuple[LoadedFrame, ...]
"""Frames of one contact, oldest first."""


def detect_onset(history: LoadHistory, contact: Contact) -> tuple[LoadHistory, bool]:
    """Return the history with this frame's contact, and whether slip begins."""
    frame = _loaded(contact)
    if frame is None:
        return (), False
    oldest_us = frame.exposed_at_us - WINDOW_US
    kept = history[1 - MOST_FRAMES :]
    if kept and kept[0].exposed_at_us < oldest_us:
        kept = tuple(one for one in kept if one.exposed_at_us >= oldest_us)
    frames = (*kept, frame)
    return frames, _has_corner(frames)


def _loaded(contact: Contact) -> LoadedFrame | None:
    """Return the frame's load: shear and torsion over its radius, over the normal force.

    None where a force is unknown or too small.
    """
    normal_N, shear_N = contact.normal_force_N, contact.shear_N
    if not contact.in_contact or normal_N is None or shear_N is None or normal_N < LEAST_NORMAL_N:
        return None
    twist_N = (contact.torsion_Nmm or 0.0) / TORSION_RADIUS_MM
    x, y, z = shear_N
    return LoadedFrame(
        contact.exposed_at_us, (x / normal_N, y / normal_N, z / normal_N, twist_N / normal_N), normal_N
    )


def _has_corner(frames: LoadHistory) -> bool:
    """Return whether the load grew up to a corner and has stood still since."""
    load = frames[-1].load
    size = math.hypot(*load)
    if size < LEAST_LOAD or len(frames) < 4:
        return False
    a, b, c, d = (one / size for one in load)
    along = [a * x + b * y + c * z + d * w for x, y, z, w in (one.load for one in frames)]
    noise = _noise(along)
    for interval in range(1, len(along) // 3 + 1):
        for after in (interval, 2 * interval):
            if after + 2 * interval < len(along) and _is_corner(frames, along, after, interval, noise):
                return True
    return False


def _is_corner(frames: LoadHistory, along: list[float], after: int, interval: int, noise: float) -> bool:
    """Return whether there is a corner `after` frames ago, judged by intervals of so many frames."""
    corner = len(along) - 1 - after
    grown = along[corner] - along[corner - interval]
    if grown < CLEAR * noise or along[corner - interval] - along[corner - 2 * interval] > SLOWED * grown:
        return False
    still, limit = along[corner + 1 :], max(STILL * grown, STILL_NOISE * noise)
    if max(still) - along[corner] > limit or along[corner] - min(still) > limit:
        return False
    if abs(frames[-1].normal_N / frames[corner].normal_N - 1.0) > LARGEST_NORMAL_CHANGE:
        return False
    lasted_s = 1e-6 * (frames[corner].exposed_at_us - frames[corner - interval].exposed_at_us)
    bend = grown / lasted_s**2
    return bend > (ABRUPT_BEND if after == interval else LEAST_BEND)


def _noise(along: list[float]) -> float:
    """Return the standard error of one load, from the second differences of all."""
    bends = sorted(abs(a - 2.0 * b + c) for a, b, c in zip(along, along[1:], along[2:], strict=False))
    return max(bends[len(bends) // 4] / QUARTILE / math.sqrt(6.0), LEAST_NOISE)
