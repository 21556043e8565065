"""Illumination of the dome's inner skin, by LEDs from inside and room light through the skin.

Light varies slowly over the image, so it is computed for every eighth pixel (`STEP`) of every eighth row.
"""

from __future__ import annotations

import cv2
import numpy as np

from palpate_edge.common.arrays import Array, Floats
from palpate_edge.geometry.angles import polar_angle
from palpate_edge.geometry.sensor import Sensor, View
from palpate_twin.camera.deformation import AZIMUTHS, skin_directions
from palpate_twin.camera.look import Look
from palpate_twin.camera.still import Part
from palpate_twin.dome import field_grid as grid

STEP = 8
LEAST_GAIN, MOST_GAIN = 0.4, 1.8
BLOCKING_MM = 0.5  # indentation at which the touching object blocks half of the room light
PATCH_RADIUS_PX = (60.0, 160.0)
CHANGING_PATCHES = 2
WRAP = 2  # columns of the polar grid repeated on either side


class LightField:
    """Light over a part of the image (height/8, width/8, 3), BGR; 1 is the maximum of the LEDs untouched."""

    def __init__(self, sensor: Sensor, view: View, look: Look, part: Part) -> None:
        """Compute the light without touch. part: of the image; its sides are multiples of `STEP`."""
        rng = np.random.default_rng([look.seed, 1])
        inner_mm = sensor.dome.outer_radius_mm - sensor.dome.wall_mm
        self._directions = skin_directions()
        leds_mm, powers = _leds(view, look, rng)
        rest_mm = self._rest_mm = inner_mm * self._directions
        # A press changes the light of all LEDs almost equally, so one lamp in their middle represents them.
        self._lamp_mm = np.average(leds_mm, axis=0, weights=powers)
        self._lamp_at_rest = _irradiance(rest_mm, _normals(rest_mm), self._lamp_mm)  # as of a press
        x, y = _coarse_pixels(part)
        theta, phi = _polar_coordinates(view, inner_mm, x, y)
        self._ring = (theta / np.radians(grid.RING_STEP_DEG)).astype(np.float32)
        self._turn = (phi % (2 * np.pi) * AZIMUTHS / (2 * np.pi) + WRAP).astype(np.float32)
        lens = _vignetting(view, sensor.camera.matrix[2:], look.vignetting, x, y)
        of_each = [
            power * _irradiance(rest_mm, rest_mm, led) for led, power in zip(leds_mm, powers, strict=True)
        ]
        leds = self._on_picture(np.sum(of_each, axis=0).astype(np.float32)[..., None]) * lens
        self._leds: Floats = leds / leds.max() * np.ones(3, dtype=np.float32)
        self._ambient: Floats = _ambient(x, y, look, rng) * lens
        self._x, self._y, self._lens = x, y, lens

    def changing(self, strength: float, rng: np.random.Generator) -> Floats:
        """Return room light through the skin that is another in every frame: patches at random places, up to
        `strength` bright."""
        light = np.zeros((*self._x.shape, 3))
        for _ in range(CHANGING_PATCHES):
            light += _patch(self._x, self._y, strength * float(rng.uniform(0, 1)), rng, tint=0.1)
        return np.asarray(light.astype(np.float32) * self._lens)

    def untouched(self, changing: Floats | float = 0.0) -> Floats:
        """Return the light without touch. changing: of this frame (:meth:`changing`)."""
        return np.asarray(self._leds + self._ambient + changing)

    def pressed(self, skin_mm: Array, changing: Floats | float = 0.0) -> Floats:
        """Return the light under a press.

        skin_mm: displacement of the polar grid (:class:`Deformation`); changing: of this frame.
        """
        moved = self._rest_mm + skin_mm
        gain = _irradiance(moved, _normals(moved), self._lamp_mm) / self._lamp_at_rest
        gain[0] = gain[1].mean()  # row 0 is the pole, where the grid has no normal
        inward_mm = np.clip(-(skin_mm * self._directions).sum(axis=2), 0, None)
        shade = 1 / (1 + (inward_mm / BLOCKING_MM) ** 2)
        both = np.stack([np.clip(gain, LEAST_GAIN, MOST_GAIN), shade], axis=2).astype(np.float32)
        picture = self._on_picture(both)
        return np.asarray(self._leds * picture[..., :1] + (self._ambient + changing) * picture[..., 1:])

    def _on_picture(self, polar: Floats) -> Floats:
        """Map values (rings, azimuths, k) of the polar grid to the image (height/8, width/8, k)."""
        wrapped = np.concatenate([polar[:, -WRAP:], polar, polar[:, : WRAP + 1]], axis=1)
        border = cv2.BORDER_REPLICATE
        mapped = cv2.remap(wrapped, self._turn, self._ring, cv2.INTER_CUBIC, borderMode=border)
        return np.asarray(mapped.reshape(*self._ring.shape, -1), dtype=np.float32)


def _irradiance(points_mm: Array, outward: Array, lamp_mm: Array) -> Array:
    """Return the irradiance (rings, azimuths) by Lambert's law; the lamp is a point that points along +z."""
    length = np.maximum(np.sqrt(np.einsum("raj,raj->ra", outward, outward)), 1e-9)
    way = points_mm - lamp_mm
    distance2 = np.einsum("raj,raj->ra", way, way)
    # cos at the skin times cos at the lamp over distance^2; the distances combine to distance2^2.
    cosine = np.einsum("raj,raj->ra", way, outward) / length
    return np.asarray(np.maximum(cosine * way[..., 2], 0.05 * distance2) / distance2**2)


def _leds(view: View, look: Look, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return positions (k, 3) in F and powers (k,) of the LEDs."""
    angle = 2 * np.pi * (np.arange(look.leds) + rng.uniform()) / look.leds
    ring = look.led_ring_mm * np.stack([np.cos(angle), np.sin(angle), np.zeros(look.leds)], axis=1)
    places = view.position_mm + ring + np.array([0.0, 0.0, look.led_ahead_mm])
    return places, 1 - look.led_unevenness * rng.uniform(0, 1, look.leds)


def _normals(points_mm: Array) -> Array:
    """Return outward normals (rings, azimuths, 3), not normalised, of a polar grid of points."""
    along = np.empty_like(points_mm)
    along[1:-1] = points_mm[2:] - points_mm[:-2]
    along[0] = along[1]
    along[-1] = points_mm[-1] - points_mm[-2]
    around = np.roll(points_mm, -1, axis=1) - np.roll(points_mm, 1, axis=1)
    return np.cross(along, around)


def _coarse_pixels(part: Part) -> tuple[Array, Array]:
    """Return x and y (height/8, width/8) of the coarse pixels, with the convention of cv2.resize."""
    x = part.left + STEP * np.arange(part.width // STEP) + (STEP - 1) / 2
    y = part.top + STEP * np.arange(part.height // STEP) + (STEP - 1) / 2
    columns, rows = np.meshgrid(x, y)
    return columns, rows


def _polar_coordinates(view: View, radius_mm: float, x: Array, y: Array) -> tuple[Array, Array]:
    """Return polar angle and azimuth of the inner skin at pixels; outside the dome, of its base edge."""
    points = view.onto_sphere(np.stack([x.ravel(), y.ravel()], axis=1), radius_mm)
    theta = polar_angle(points)
    theta = np.where(np.isnan(theta), np.pi / 2, np.minimum(theta, np.pi / 2))
    phi = np.nan_to_num(np.arctan2(points[:, 1], points[:, 0]))
    return theta.reshape(x.shape), phi.reshape(x.shape)


def _vignetting(view: View, axis_px: tuple[float, ...], power: float, x: Array, y: Array) -> Floats:
    """Return the transmission (height/8, width/8, 1) of the lens. axis_px: pixel of its optical axis."""
    pixels = np.stack([x.ravel(), y.ravel()], axis=1)
    axis = view.rays(np.array([axis_px]))[0]
    cosine = np.clip(view.rays(pixels) @ axis, 0.05, 1)
    return np.asarray(cosine**power, dtype=np.float32).reshape(*x.shape, 1)


def _ambient(x: Array, y: Array, look: Look, rng: np.random.Generator) -> Floats:
    """Return the room light through the skin: a uniform part, and coloured patches of lamps and windows."""
    light = np.full((*x.shape, 3), 0.5 * look.ambient)
    for _ in range(look.ambient_patches):
        light += _patch(x, y, look.ambient, rng, tint=0.5)
    return light.astype(np.float32)


def _patch(x: Array, y: Array, strength: float, rng: np.random.Generator, tint: float) -> Array:
    """Return a Gaussian patch of light (height/8, width/8, 3) at a random place; tint: relative deviation of
    its colours from white."""
    middle = rng.uniform([150, 60], [490, 420])
    radius = rng.uniform(*PATCH_RADIUS_PX)
    colour = strength * rng.uniform(1 - tint, 1 + tint, 3)
    distance2 = (x - middle[0]) ** 2 + (y - middle[1]) ** 2
    return np.asarray(colour * np.exp(-distance2 / (2 * radius**2))[..., None])
