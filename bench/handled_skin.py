"""The beads of a dome under the contacts of a simulated hand, for detectors that read the skin.

The field library has the beads of a press, and those of a slide by a tenth of its depth. Between the two the
skin is taken as linear in the ratio of tangential to normal force: a dome that sticks. The library's own
slides end at its friction, that of the hand may be higher.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_edge.estimation.displacement_field import DisplacementReader, MeanMotion, tangent_basis
from palpate_edge.geometry.angles import azimuth, polar_angle
from palpate_edge.geometry.sensor import Dome, Markers, Ring, View, bead_layout_mm
from palpate_twin.camera.deformation import DeformableDome, Deformation, ProbePress
from palpate_twin.closed_loop.tactile_rendering import LARGEST_THETA_DEG, DomeContact
from palpate_twin.dome.dome_samples import CAMERA, LAYOUTS
from palpate_twin.dome.library import load_library
from palpate_twin.dome.probe import Probe

BEAD_RADIUS_MM = 26.5
NOISE_PX = 0.02
SLIDE = 0.1
LEAST_DEPTH_MM = 1e-3


class HandledSkin:
    """Mean motion of the beads of one fingertip, with the noise of the recorded sensors."""

    def __init__(self, radius_mm: float, seed: int) -> None:
        """radius_mm: of the dome."""
        rings = tuple(Ring(theta, count) for theta, count in LAYOUTS[0])
        self._beads_mm = bead_layout_mm(Markers(BEAD_RADIUS_MM, 3.0, rings))[0]
        self._view = View(CAMERA)
        self._rest_px = self._view.project(self._beads_mm)
        self._reader = DisplacementReader(self._rest_px, self._view, BEAD_RADIUS_MM)
        library = load_library()
        wall_mm = library.wall_mm * radius_mm / library.outer_radius_mm
        self._dome = DeformableDome(library, Dome(radius_mm, wall_mm), self._beads_mm / BEAD_RADIUS_MM)
        self._radius_mm = radius_mm
        self._random = np.random.default_rng(seed)

    def mean_motion_mm(self, contact: DomeContact) -> MeanMotion:
        """Return the mean motion of the beads under a contact."""
        place_px = self._view.project(self._beads_mm + self._displacement_mm(contact))
        place_px = place_px + NOISE_PX * self._random.standard_normal(place_px.shape)
        return self._reader.mean_motion_mm(place_px - self._rest_px)

    def _displacement_mm(self, contact: DomeContact) -> Array:
        """Return the beads' displacement (n, 3)."""
        direction = contact.centre_to_contact_mm[None]
        theta_rad = min(float(polar_angle(direction)[0]), np.radians(LARGEST_THETA_DEG))
        deepest_mm = self._dome.largest_depth_mm(theta_rad, Probe.PLATE)
        depth_mm = min(self._radius_mm - float(np.linalg.norm(direction)), deepest_mm)
        press = ProbePress(theta_rad, float(azimuth(direction)[0]), max(depth_mm, LEAST_DEPTH_MM))
        along_face = np.concatenate(tangent_basis(press.outward[None]))
        pressed = self._dome.press(press)
        start = _ratio(pressed, press.outward, along_face)
        missing = along_face @ contact.friction_N / max(contact.normal_force_N, 1e-9) - start
        size = float(np.linalg.norm(missing))
        if size == 0.0:
            return pressed.bead_mm
        slide_mm = SLIDE * press.depth_mm * missing / size
        slid = self._dome.press(replace(press, shear_mm=(float(slide_mm[0]), float(slide_mm[1]))))
        gained = float(np.linalg.norm(_ratio(slid, press.outward, along_face) - start))
        return pressed.bead_mm + (slid.bead_mm - pressed.bead_mm) * (size / gained)


def _ratio(deformation: Deformation, outward: Array, along_face: Array) -> Array:
    """Return the forces (2,) along the face, a matrix (2, 3), over the normal force."""
    force = deformation.force_per_mu_mm2
    return np.asarray(along_face @ force / -float(force @ outward))
