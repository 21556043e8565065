"""Render the frames of a sensor's camera: skin, light, beads, reflections and noise."""

from __future__ import annotations

from collections.abc import Collection

import cv2
import numpy as np

from palpate_edge.common.arrays import Array, Image
from palpate_edge.common.errors import ConfigError
from palpate_edge.geometry.sensor import View
from palpate_twin.camera.bead_ellipse import BeadProjector
from palpate_twin.camera.bead_layer import WHOLE, BeadLayer
from palpate_twin.camera.deformation import DeformableDome, Deformation, ProbePress
from palpate_twin.camera.light import STEP, LightField
from palpate_twin.camera.look import TwinSensor
from palpate_twin.camera.noise import NoiseField
from palpate_twin.camera.still import dome_mask, overlay, part_with_dome, skin_picture, veil_picture
from palpate_twin.dome.library import MAKE_TWISTS, FieldLibrary
from palpate_twin.dome.uneven_wall import random_stiffness

FULL_LIGHT = 128  # value of full light in a light image; 255 is twice as bright


class CameraView:
    """Renderer of one sensor. The same sensor, press and generator state give the same bytes.

    Beads keep size and orientation, as 3 mm glass beads in soft silicone do. Print, dust and the LEDs'
    reflections do not move with the skin, and silicone does not refract.
    """

    def __init__(self, twin: TwinSensor, library: FieldLibrary) -> None:
        """Prepare all that is the same in every frame. Raises ConfigError if the library lacks the dome."""
        camera, look = twin.sensor.camera, twin.look
        self.twin = twin
        self._bead_mm = np.array(twin.bead_mm)
        self._normal = self._bead_mm / np.linalg.norm(self._bead_mm, axis=1, keepdims=True)
        self._across_mm = 0.5 * twin.sensor.markers.diameter_mm * np.array(twin.bead_size)
        uneven = random_stiffness(twin.wall_unevenness, look.seed) if twin.wall_unevenness else None
        self.dome = DeformableDome(library, twin.sensor.dome, self._normal, uneven)
        view = View(camera, twin.pose)
        self._projector = BeadProjector(camera, twin.pose)
        opening = np.asarray(np.rint(255 * dome_mask(twin.sensor, view, look)), dtype=np.uint8)
        part = self._part = part_with_dome(opening, STEP)  # beads and skin are drawn only there
        self._light = LightField(twin.sensor, view, look, part)
        self._layer = BeadLayer(part.width, part.height, look.softness_px, look.highlight)
        self._opening = part.of(opening).copy()
        self._skin = part.of(skin_picture(twin.sensor, view, look)).copy()
        self._over = overlay(twin.sensor, view, look)
        self._veil = part.of(veil_picture(twin.sensor, view, look)).copy() if look.veil else None
        self._noise = NoiseField(camera.height, camera.width, look.noise_grey, look.seed)
        self._bead_colour = _colour_table(look.bead_bgr)
        # Allocated once: new memory pages cost more than the computation.
        self._fine_light, self._beads, self._dome = (np.empty_like(self._skin) for _ in range(3))

    def frame(
        self,
        press: ProbePress | None,
        rng: np.random.Generator,
        *,
        hidden: Collection[int] = (),
        exposure: float = 1.0,
    ) -> tuple[Image, Array]:
        """Return a new image (height, width, 3) and the force (3,) on the dome in F, in N.

        press: None without contact; hidden: indices of invisible beads; exposure: factor of the light; rng:
        for flicker and noise.
        """
        if press is None or press.depth_mm <= 0:
            return self.render(None, rng, hidden=hidden, exposure=exposure), np.zeros(3)
        deformation = self.dome.press(press)
        image = self.render(deformation, rng, hidden=hidden, exposure=exposure)
        return image, deformation.force_per_mu_mm2 * self.twin.shear_modulus_N_mm2

    def torsion_Nmm(self, press: ProbePress | None) -> float:
        """Return the moment of a press about the inward normal at its place; 0 without contact.

        Raises ConfigError without a twist library.
        """
        if press is None or press.depth_mm <= 0:
            return 0.0
        torsion = self.dome.press(press).torsion_per_mu_mm3
        if torsion is None:
            raise ConfigError(f"the field library has no torsion: {MAKE_TWISTS}")
        return torsion * self.twin.shear_modulus_N_mm2

    def outlines(self, deformation: Deformation | None) -> tuple[Array, Array]:
        """Return centres (n, 2) in pixels and shapes (n, 2, 2) of the beads' ellipses, ordered as bead_mm."""
        moved = self._bead_mm if deformation is None else self._bead_mm + deformation.bead_mm
        return self._projector.outlines(moved, self._normal, self._across_mm, self.twin.look.bead_flatness)

    def render(
        self,
        deformation: Deformation | None,
        rng: np.random.Generator,
        *,
        hidden: Collection[int] = (),
        exposure: float = 1.0,
    ) -> Image:
        """Return the image of a deformation; arguments as in :meth:`frame`."""
        look = self.twin.look
        changing = self._light.changing(look.changing_light, rng) if look.changing_light else 0.0
        if deformation is None:
            light = self._light.untouched(changing)
        else:
            light = self._light.pressed(deformation.skin_mm, changing)
        flicker = max(0.0, 1 + look.flicker * float(rng.standard_normal()))
        coarse = cv2.convertScaleAbs(light, alpha=FULL_LIGHT * exposure * flicker)
        size = (self._part.width, self._part.height)
        cv2.resize(coarse, size, self._fine_light, interpolation=cv2.INTER_LINEAR)
        centre_px, shape = self.outlines(deformation)
        if hidden:
            shown = np.setdiff1d(np.arange(len(centre_px)), np.fromiter(hidden, dtype=np.intp))
            centre_px, shape = centre_px[shown], shape[shown]
        beads = self._layer.draw(centre_px - [self._part.left, self._part.top], shape)
        covered = cv2.multiply(beads, self._opening, scale=1 / 255)
        dome, bare = self._dome, cv2.bitwise_not(cv2.convertScaleAbs(covered, alpha=255 / WHOLE))
        cv2.cvtColor(bare, cv2.COLOR_GRAY2BGR, dome)
        cv2.multiply(self._skin, dome, dome, scale=1 / 255)
        cv2.add(dome, cv2.applyColorMap(covered, self._bead_colour, self._beads), dome)
        if self._veil is not None:
            cv2.addWeighted(dome, 1 - look.veil, self._veil, 1.0, 0.0, dome)
        cv2.multiply(dome, self._fine_light, dome, scale=look.exposure / FULL_LIGHT)
        image = self._over.copy()
        inside = self._part.of(image)
        cv2.add(inside, dome, inside)
        self._noise.add(image, rng)
        return image


def _colour_table(bead_bgr: tuple[float, float, float]) -> Image:
    """Return the table (256, 1, 3) of a bead's contribution to a pixel, by the value in the bead plane."""
    value = np.arange(256.0)[:, None, None]
    spot = np.clip((value - WHOLE) / (255 - WHOLE), 0, 1)
    colour = np.minimum(value / WHOLE, 1.0) * np.asarray(bead_bgr) * (1 - spot) + 255 * spot
    return np.asarray(np.rint(colour), dtype=np.uint8)
