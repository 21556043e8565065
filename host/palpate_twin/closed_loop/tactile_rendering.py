"""Simulated fingertips: from the engine's contact of a tip to the Contact that the tip's node publishes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from palpate_edge.common.arrays import Array, Image
from palpate_edge.common.contact import Contact, Vector3
from palpate_edge.common.frame import Frame
from palpate_edge.estimation.calibration import Calibration
from palpate_edge.estimation.displacement_field import tangent_basis
from palpate_edge.estimation.estimator import Estimator
from palpate_edge.geometry.angles import azimuth, polar_angle
from palpate_host.control.kinematics import HandKinematics
from palpate_twin.camera.deformation import ProbePress
from palpate_twin.camera.frame_truth import FrameTruth
from palpate_twin.camera.look import TwinSensor
from palpate_twin.camera.renderer import CameraView
from palpate_twin.dome.library import FieldLibrary
from palpate_twin.dome.probe import Probe
from palpate_twin.hand.engine import Engine

SLIP_SEEN_MM = 0.1
LARGEST_THETA_DEG = 74.0
"""Limit of rendered contacts; the field library ends at 75 degrees from the pole."""


@dataclass(frozen=True, slots=True)
class DomeContact:
    """True contact of one dome with the object, in frame F.

    centre_to_contact_mm: (3,) vector from the dome's centre to the contact; friction_N: (3,) tangential force
    on the dome. slip_mm: path that the dome has slid on the object since the start.
    """

    centre_to_contact_mm: Array
    normal_force_N: float
    friction_N: Array
    slip_mm: float = 0.0

    def on_dome_mm(self, radius_mm: float) -> Array:
        """Return the contact's position (3,) on the undeformed dome."""
        return np.asarray(radius_mm / np.linalg.norm(self.centre_to_contact_mm) * self.centre_to_contact_mm)

    def force_N(self) -> Array:
        """Return the whole force (3,) on the dome."""
        inward = -self.centre_to_contact_mm / np.linalg.norm(self.centre_to_contact_mm)
        return np.asarray(self.normal_force_N * inward + self.friction_N)


class ContactSource(Protocol):
    """Source of the contacts that the simulated fingertips publish."""

    def contact(self, finger: int, truth: DomeContact | None, exposed_at_us: int, sequence: int) -> Contact:
        """Return the contact of one exposure of one fingertip. truth: None if the dome touches nothing."""
        ...


class TrueContactSource:
    """Publishes the true contact and force plus noise of the estimator's size; renders no frame.

    The slip flag is set when the dome has slid by `SLIP_SEEN_MM` since the fingertip's last frame. A real
    fingertip sees less: slip.py does not detect a flat face that slides.
    """

    def __init__(
        self,
        radius_mm: float,
        noise_mm: float,
        seed: int,
        force_noise: float = 0.0,
        *,
        sees_slip: bool = True,
    ) -> None:
        """noise_mm, force_noise: standard deviations of the position and, relative, of the force along each
        axis. sees_slip: set the slip flag."""
        self._radius_mm, self._noise_mm, self._force_noise = radius_mm, noise_mm, force_noise
        self._rng = np.random.default_rng(seed)
        self._sees_slip = sees_slip
        self._slipped_mm: dict[int, float] = {}

    def contact(
        self,
        finger: int,
        truth: DomeContact | None,
        exposed_at_us: int,
        sequence: int,
    ) -> Contact:
        """See :class:`ContactSource`."""
        position = force = None
        normal_N, slips = 0.0, False
        if truth is not None:
            position = _vector(truth.on_dome_mm(self._radius_mm) + self._noise_mm * self._rng.normal(size=3))
            force_N, normal_N = truth.force_N(), truth.normal_force_N
            if self._force_noise > 0.0:
                force_N = force_N * (1.0 + self._force_noise * self._rng.normal(size=3))
                normal_N = max(-float(force_N @ position) / self._radius_mm, 0.0)
            force = _vector(force_N)
            slips = truth.slip_mm - self._slipped_mm.get(finger, truth.slip_mm) >= SLIP_SEEN_MM
            self._slipped_mm[finger] = truth.slip_mm
        return Contact(
            sequence=sequence,
            exposed_at_us=exposed_at_us,
            valid=True,
            in_contact=position is not None,
            position_mm=position,
            normal_force_N=normal_N,
            force_N=force,
            torsion_Nmm=None,
            quality=1.0,
            reason="",
            beads_found=0,
            beads_expected=0,
            slip=slips and self._sees_slip,
        )


def _vector(v: Array) -> Vector3:
    return float(v[0]), float(v[1]), float(v[2])


class RenderedContactSource:
    """Renders the dome pressed by the object's face and runs the fingertip's estimator on the frame.

    The finite-element dome gets the indentation of the tip in the engine and is slid until its ratio of
    tangential to normal force equals the tip's, within the limits of the field library. The magnitude of the
    force follows from the dome's stiffness.
    """

    def __init__(
        self,
        sensors: Sequence[tuple[TwinSensor, Calibration]],
        library: FieldLibrary,
        seed: int,
        on_frame: Callable[[int, FrameTruth, Image], None] = lambda _finger, _truth, _image: None,
    ) -> None:
        """Prepare renderer and estimator of each finger.

        sensors: each finger's true sensor and the calibration of its estimator. on_frame: called with the
        finger, the true contact and the image of each rendered frame.
        """
        self._on_frame = on_frame
        self._views = [CameraView(twin, library) for twin, _ in sensors]
        self._estimators = [Estimator(calibration) for _, calibration in sensors]
        self._rng = np.random.default_rng(seed)

    def contact(self, finger: int, truth: DomeContact | None, exposed_at_us: int, sequence: int) -> Contact:
        """See :class:`ContactSource`."""
        view = self._views[finger]
        press = None if truth is None else press_for(view, truth)
        image, force_N = view.frame(press, self._rng)
        radius_mm = view.twin.sensor.dome.outer_radius_mm
        point_mm = None if press is None else radius_mm * press.outward
        self._on_frame(finger, FrameTruth(sequence, exposed_at_us, point_mm, force_N), image)
        return self._estimators[finger].estimate(Frame(image, exposed_at_us, sequence, f"frame {sequence}"))


def press_for(view: CameraView, contact: DomeContact) -> ProbePress:
    """Return the press of a plate that reproduces a contact, within the limits of the field library."""
    direction = contact.centre_to_contact_mm[None]
    theta_rad = min(float(polar_angle(direction)[0]), np.radians(LARGEST_THETA_DEG))
    depth_mm = view.twin.sensor.dome.outer_radius_mm - float(np.linalg.norm(contact.centre_to_contact_mm))
    deepest_mm = view.dome.largest_depth_mm(theta_rad, Probe.PLATE)
    press = ProbePress(theta_rad, float(azimuth(direction)[0]), min(depth_mm, deepest_mm))
    if contact.normal_force_N <= 0.0:
        return press
    along_face = np.concatenate(tangent_basis(press.outward[None]))
    return view.dome.slid(press, along_face @ contact.friction_N / contact.normal_force_N)


def dome_contacts(engine: Engine, hand: HandKinematics) -> list[DomeContact | None]:
    """Return the true contact of each tip in its frame F, None for a tip that touches nothing."""
    pose = hand.pose(engine.q_rad)
    found: list[DomeContact | None] = []
    tips = zip(engine.tip_contacts(), pose.tip_centre_m, pose.tip_rotation, 1e3 * engine.slip_m, strict=True)
    for contact, centre_m, F, slip_mm in tips:
        if contact is None:
            found.append(None)
        else:
            centre_to_contact_mm = 1e3 * (contact.point_m - centre_m) @ F
            friction_N = contact.friction_N @ F
            found.append(
                DomeContact(centre_to_contact_mm, contact.normal_force_N, friction_N, float(slip_mm))
            )
    return found
