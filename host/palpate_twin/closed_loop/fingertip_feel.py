"""What the simulated fingertips feel: from a tip on the object to the Contact that its node publishes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_edge.common.contact import Contact
from palpate_edge.common.frame import Frame
from palpate_edge.estimation.calibration import Calibration
from palpate_edge.estimation.displacement_field import tangent_basis
from palpate_edge.estimation.estimator import Estimator
from palpate_host.control.kinematics import HandKinematics
from palpate_twin.camera.deformation import ProbePress
from palpate_twin.camera.look import TwinSensor
from palpate_twin.camera.renderer import CameraView
from palpate_twin.dome.library import FieldLibrary
from palpate_twin.dome.probe import Probe
from palpate_twin.hand.engine import Engine

LARGEST_THETA_DEG = 74.0
"""The library's fields end at 75 degrees from the pole."""


@dataclass(frozen=True, slots=True)
class DomeTouch:
    """One dome on the object. into_mm: (3,) from the dome's centre to the contact; friction_N: (3,) the
    tangential force on the dome; both in F."""

    into_mm: Array
    normal_force_N: float
    friction_N: Array

    def on_dome_mm(self, radius_mm: float) -> Array:
        """(3,) the contact's place on the undeformed dome."""
        return np.asarray(radius_mm / np.linalg.norm(self.into_mm) * self.into_mm)


class Feel(Protocol):
    """Turns one exposure of one fingertip into a Contact."""

    def contact(self, finger: int, touch: DomeTouch | None, exposed_at_us: int, sequence: int) -> Contact:
        """touch: None where it touches nothing."""
        ...


class DirectFeel:
    """The true contact with noise, as good as the estimator is on average; no pictures."""

    def __init__(self, radius_mm: float, noise_mm: float, seed: int) -> None:
        self._radius_mm, self._noise_mm = radius_mm, noise_mm
        self._rng = np.random.default_rng(seed)

    def contact(
        self,
        finger: int,  # noqa: ARG002 - every finger has the same noise
        touch: DomeTouch | None,
        exposed_at_us: int,
        sequence: int,
    ) -> Contact:
        """See :class:`Feel`."""
        position = None
        if touch is not None:
            x, y, z = touch.on_dome_mm(self._radius_mm) + self._noise_mm * self._rng.normal(size=3)
            position = (float(x), float(y), float(z))
        return Contact(
            sequence=sequence,
            exposed_at_us=exposed_at_us,
            valid=True,
            in_contact=position is not None,
            position_mm=position,
            normal_force_N=0.0 if touch is None else touch.normal_force_N,
            force_N=None,
            torsion_Nmm=None,
            quality=1.0,
            reason="",
            beads_found=0,
            beads_expected=0,
        )


@dataclass(frozen=True, slots=True)
class Picture:
    """What was true of a rendered frame. point_mm: (3,) of the dome in F, None: no touch; force_N: (3,) on it
    in F."""

    sequence: int
    exposed_at_us: int
    point_mm: Array | None
    force_N: Array


class RenderedFeel:
    """The sensor's picture of a dome pressed by the object's face, and the fingertip's own estimator on it.

    The dome by finite elements is indented as deep as the tip and slid until its force leans as much as the
    tip's, as far as its fields go; how large the force is, is its own.
    """

    def __init__(
        self,
        sensors: Sequence[tuple[TwinSensor, Calibration]],
        library: FieldLibrary,
        seed: int,
        on_picture: Callable[[int, Picture], None] = lambda _finger, _picture: None,
    ) -> None:
        """sensors: each finger's sensor as it is, and the calibration that it runs with. on_picture: sees
        what was true of each finger's picture."""
        self._on_picture = on_picture
        self._views = [CameraView(twin, library) for twin, _ in sensors]
        self._estimators = [Estimator(calibration) for _, calibration in sensors]
        self._rng = np.random.default_rng(seed)

    def contact(self, finger: int, touch: DomeTouch | None, exposed_at_us: int, sequence: int) -> Contact:
        """See :class:`Feel`."""
        view = self._views[finger]
        press = None if touch is None else press_of(view, touch)
        image, force_N = view.frame(press, self._rng)
        radius_mm = view.twin.sensor.dome.outer_radius_mm
        point_mm = None if press is None else radius_mm * press.outward
        self._on_picture(finger, Picture(sequence, exposed_at_us, point_mm, force_N))
        return self._estimators[finger].estimate(Frame(image, exposed_at_us, sequence, f"frame {sequence}"))


def press_of(view: CameraView, touch: DomeTouch) -> ProbePress:
    """A flat face on a dome; at most as deep as the fields go."""
    x, y, z = touch.into_mm
    theta_rad = min(float(np.arctan2(np.hypot(x, y), z)), np.radians(LARGEST_THETA_DEG))
    depth_mm = view.twin.sensor.dome.outer_radius_mm - float(np.linalg.norm(touch.into_mm))
    deepest_mm = view.dome.largest_depth_mm(theta_rad, Probe.PLATE)
    press = ProbePress(theta_rad, float(np.arctan2(y, x)), min(depth_mm, deepest_mm))
    if touch.normal_force_N <= 0.0:
        return press
    along_face = np.concatenate(tangent_basis(press.outward[None]))
    return view.dome.slid(press, along_face @ touch.friction_N / touch.normal_force_N)


def touches_in_F(engine: Engine, hand: HandKinematics) -> list[DomeTouch | None]:
    """Of each tip, None where it touches nothing."""
    pose = hand.pose(engine.q_rad)
    found: list[DomeTouch | None] = []
    for touch, centre_m, F in zip(engine.touches(), pose.tip_centre_m, pose.tip_rotation, strict=True):
        if touch is None:
            found.append(None)
        else:
            into_mm = 1e3 * (touch.point_m - centre_m) @ F
            found.append(DomeTouch(into_mm, touch.normal_force_N, touch.friction_N @ F))
    return found
