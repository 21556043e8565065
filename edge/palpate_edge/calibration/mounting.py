"""Mounting: how far the camera is turned about the sensor's axis, from presses of known place.

A layout of evenly spaced rings looks the same after a turn, and a learned one has no direction at all. The
places of truth.csv do: the azimuth that a press has in the image is compared with that of its place.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_edge.common.errors import CalibrationError
from palpate_edge.geometry.angles import azimuth

FEWEST_PRESSES = 5
MIN_LATERAL = 0.2  # sine of the polar angle: nearer to the apex a press has no clear azimuth
MIN_AGREEMENT = 0.8  # length of the mean direction; 1 where all presses agree
UPRIGHT_RAD = math.radians(20.0)  # of assembly; more is a camera mounted another way round


@dataclass(frozen=True, slots=True)
class Mounting:
    """turn_rad: from azimuths in the image to those of truth.csv; mirrored: they run the other way round."""

    turn_rad: float
    mirrored: bool

    @property
    def upright(self) -> bool:
        """Return whether the camera is mounted as the drawing has it."""
        return abs(self.turn_rad) < UPRIGHT_RAD and not self.mirrored


def find_mounting(seen_rad: Array, places_mm: Array) -> Mounting:
    """Return the mounting by the azimuths (n,) in the image and the places (n, 3) of the presses.

    It is upright where the presses are too few, too near to the apex or too contradictory to decide.
    """
    lateral = np.linalg.norm(places_mm[:, :2], axis=1) / np.linalg.norm(places_mm, axis=1)
    clear = lateral > MIN_LATERAL
    if clear.sum() < FEWEST_PRESSES:
        return Mounting(0.0, mirrored=False)
    true_rad, weight = azimuth(places_mm[clear]), lateral[clear]
    straight, mirrored = (
        complex((weight * np.exp(1j * (true_rad - sign * seen_rad[clear]))).sum() / weight.sum())
        for sign in (1, -1)
    )
    best = max(straight, mirrored, key=abs)
    if abs(best) < MIN_AGREEMENT:
        return Mounting(0.0, mirrored=False)
    return Mounting(float(np.angle(best)), mirrored=abs(mirrored) > abs(straight))


def check_mounting(mounting: Mounting, *, can_turn: bool) -> None:
    """Refuse a mirrored camera; and a turned one unless its layout can be turned with it."""
    if mounting.mirrored:
        raise CalibrationError(
            "the presses run the other way round in the images than in truth.csv: the images are mirrored or "
            "truth.csv has its y axis up; x points to the image's right and y to its bottom"
        )
    if not mounting.upright and not can_turn:
        raise CalibrationError(
            f"the camera is turned by {math.degrees(mounting.turn_rad):+.0f} deg about its axis against the "
            "places of truth.csv: mount it as sensor.toml has it, turn the places, or leave out "
            "markers.rings (the layout is then learned and turned with the camera)"
        )
