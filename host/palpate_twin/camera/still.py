"""Static parts of a sensor's image: skin texture, mask of the dome, reflections and surroundings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from palpate_edge.common.arrays import Array, Image
from palpate_edge.common.errors import ConfigError
from palpate_edge.geometry.sensor import Sensor, View
from palpate_twin.camera.look import Look

TEXT_BLUR_PX = 2.5  # blur by the silicone between print and camera
MOTTLE_PX = 9.0
VEIL_BGR = (165.0, 160.0, 155.0)  # of a white haze under full light
VEIL_MOTTLE_PX, VEIL_MOTTLE = 60.0, 0.1
MOTTLE = 0.02  # relative standard deviation of the skin's brightness
GLINT_SIGMA_PX = 1.8
OUTSIDE_MOTTLE_GREY = 2.0


@dataclass(frozen=True, slots=True)
class Part:
    """A rectangle of an image, in pixels."""

    left: int
    top: int
    width: int
    height: int

    def of(self, picture: NDArray[Any]) -> NDArray[Any]:
        """Return the view of this rectangle in an image."""
        return picture[self.top : self.top + self.height, self.left : self.left + self.width]


def part_with_dome(mask: Image, multiple: int) -> Part:
    """Return the smallest rectangle that contains all non-zero pixels of a mask (height, width).

    Its sides are multiples of `multiple`, except at the edge of the image. Raises ConfigError if the mask is
    empty.
    """
    if not mask.any():
        raise ConfigError(
            "the camera does not see the dome: correct camera.matrix and camera.position_mm in sensor.toml"
        )
    height, width = mask.shape
    (top, bottom), (left, right) = (
        (int(used.min()) // multiple * multiple, -(-(int(used.max()) + 1) // multiple) * multiple)
        for used in (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    )
    return Part(left, top, min(right, width) - left, min(bottom, height) - top)


def skin_picture(sensor: Sensor, view: View, look: Look) -> Image:
    """Return the skin under full light (height, width, 3): mottled, with print and dust; black outside."""
    rng = np.random.default_rng([look.seed, 2])
    height, width = sensor.camera.height, sensor.camera.width
    relative: Array = 1 + _mottle(rng, height, width, MOTTLE)
    if look.text:
        relative = relative * (1 - look.text_contrast * _print(look.text, height, width, rng))
    for _ in range(look.dust):
        middle = rng.uniform([0.3 * width, 0.2 * height], [0.7 * width, 0.8 * height])
        relative = relative * (
            1 - rng.uniform(0.2, 1.0) * look.dust_contrast * _spot(middle, rng.uniform(1, 2), height, width)
        )
    bgr = relative[..., None] * np.asarray(look.skin_bgr) * dome_mask(sensor, view, look)[..., None]
    return np.asarray(np.clip(np.rint(bgr), 0, 255), dtype=np.uint8)


def veil_picture(sensor: Sensor, view: View, look: Look) -> Image:
    """Return the haze under full light (height, width, 3): uneven over the dome, black outside."""
    rng = np.random.default_rng([look.seed, 8])
    height, width = sensor.camera.height, sensor.camera.width
    relative = 1 + _mottle(rng, height, width, VEIL_MOTTLE, VEIL_MOTTLE_PX)
    bgr = relative[..., None] * np.asarray(VEIL_BGR) * dome_mask(sensor, view, look)[..., None]
    return np.asarray(np.clip(np.rint(look.veil * bgr), 0, 255), dtype=np.uint8)


def dome_mask(sensor: Sensor, view: View, look: Look) -> Array:
    """Return the mask (height, width) of the dome's opening: 1 inside, 0 outside, with a soft edge."""
    inner_mm = sensor.dome.outer_radius_mm - sensor.dome.wall_mm
    phi = 2 * np.pi * np.arange(360) / 360
    edge = view.project(inner_mm * np.stack([np.cos(phi), np.sin(phi), np.zeros(360)], axis=1))
    mask = np.zeros((sensor.camera.height, sensor.camera.width), dtype=np.uint8)
    bits = 4
    cv2.fillPoly(mask, [np.rint(edge * 2**bits).astype(np.int32)], 255, cv2.LINE_AA, bits)
    soft = cv2.GaussianBlur(mask.astype(np.float64) / 255, (0, 0), max(look.softness_px, 0.3))
    return np.asarray(soft, dtype=np.float64)


def overlay(sensor: Sensor, view: View, look: Look) -> Image:
    """Return the light in front of the beads (height, width, 3): reflections, glare and surroundings."""
    rng = np.random.default_rng([look.seed, 3])
    height, width = sensor.camera.height, sensor.camera.width
    outside = (1 - dome_mask(sensor, view, look)) * (
        look.outside_grey + _mottle(rng, height, width, OUTSIDE_MOTTLE_GREY)
    )
    light: Array = outside
    inner_mm = sensor.dome.outer_radius_mm - sensor.dome.wall_mm
    # In a concave mirror of radius r, a lamp next to the camera, at distance d from the mirror's centre, is
    # reflected where the normal bisects the angle between lamp and camera: at about r / (2 d) of the lamp's
    # offset from the axis.
    reach_mm = 0.5 * look.led_ring_mm * inner_mm / abs(float(view.position_mm[2]))
    for angle in 2 * np.pi * (np.arange(look.leds) + rng.uniform()) / look.leds:
        place = inner_mm * np.array([0.0, 0.0, 1.0]) + reach_mm * np.array([np.cos(angle), np.sin(angle), 0])
        size = GLINT_SIGMA_PX * rng.uniform(0.6, 1.2)
        light = light + 255 * look.glints * _spot(view.project(place[None])[0], size, height, width)
    if look.glare:
        middle = rng.uniform([0.3 * width, 0.2 * height], [0.7 * width, 0.8 * height])
        light = light + 255 * look.glare * _spot(middle, rng.uniform(10, 25), height, width)
    return np.clip(np.rint(np.repeat(light[..., None], 3, axis=2)), 0, 255).astype(np.uint8)


def _print(text: str, height: int, width: int, rng: np.random.Generator) -> Array:
    """Return an image (height, width), 0 to 1, of a rotated line of print, blurred by the wall."""
    canvas = np.zeros((height, width), dtype=np.uint8)
    size = float(rng.uniform(1.5, 3.0))
    (long, high), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, size, 6)
    corner = ((width - long) // 2, (height + high) // 2)
    cv2.putText(canvas, text, corner, cv2.FONT_HERSHEY_SIMPLEX, size, 255, 6, cv2.LINE_AA)
    turn = cv2.getRotationMatrix2D((width / 2, height / 2), float(rng.uniform(0, 360)), 1.0)
    turn[:, 2] = turn[:, 2] + rng.uniform(-80, 80, 2)
    turned = cv2.warpAffine(canvas, turn, (width, height))
    return cv2.GaussianBlur(turned, (0, 0), TEXT_BLUR_PX).astype(np.float64) / 255


def _mottle(
    rng: np.random.Generator, height: int, width: int, deviation: float, size_px: float = MOTTLE_PX
) -> Array:
    """Return smooth noise (height, width) of the given standard deviation."""
    noise = cv2.GaussianBlur(rng.standard_normal((height, width)), (0, 0), size_px)
    return np.asarray(noise * (deviation / noise.std()))


def _spot(middle: Array, sigma_px: float, height: int, width: int) -> Array:
    """Return a Gaussian spot (height, width) with a peak of 1."""
    x = np.exp(-((np.arange(width) - middle[0]) ** 2) / (2 * sigma_px**2))
    y = np.exp(-((np.arange(height) - middle[1]) ** 2) / (2 * sigma_px**2))
    return np.outer(y, x)
