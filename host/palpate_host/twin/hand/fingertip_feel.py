"""What the simulated fingertips feel: from a tip on the object to the Contact that its node publishes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from palpate_edge.calibration import Calibration
from palpate_edge.capture.frame import Frame
from palpate_edge.contact_type import Contact
from palpate_edge.estimator import Estimator
from palpate_host.hand import Hand
from palpate_host.rotation import Array
from palpate_host.twin.camera.deformation import ProbePress
from palpate_host.twin.camera.look import TwinSensor
from palpate_host.twin.camera.renderer import CameraView
from palpate_host.twin.dome.library import FieldLibrary
from palpate_host.twin.dome.probe import Probe
from palpate_host.twin.hand.engine import Engine

LARGEST_THETA_DEG = 74.0
"""The library's fields end at 75 degrees from the pole."""


class Feel(Protocol):
    """Turns one exposure of one fingertip into a Contact."""

    def contact(
        self, finger: int, into_F_mm: Array | None, normal_force_N: float, exposed_at_us: int, sequence: int
    ) -> Contact:
        """into_F_mm: (3,) from the dome's centre to the contact on the object, in F; None: no touch."""
        ...


class DirectFeel:
    """The true contact with noise, as good as the estimator is on average; no pictures."""

    def __init__(self, radius_mm: float, noise_mm: float, seed: int) -> None:
        self._radius_mm, self._noise_mm = radius_mm, noise_mm
        self._rng = np.random.default_rng(seed)

    def contact(
        self,
        finger: int,  # noqa: ARG002 - every finger has the same noise
        into_F_mm: Array | None,
        normal_force_N: float,
        exposed_at_us: int,
        sequence: int,
    ) -> Contact:
        """See :class:`Feel`."""
        position = None
        if into_F_mm is not None:
            on_dome = self._radius_mm / np.linalg.norm(into_F_mm) * into_F_mm
            x, y, z = on_dome + self._noise_mm * self._rng.normal(size=3)
            position = (float(x), float(y), float(z))
        return Contact(
            sequence=sequence,
            exposed_at_us=exposed_at_us,
            valid=True,
            in_contact=position is not None,
            position_mm=position,
            normal_force_N=normal_force_N,
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

    The dome by finite elements is indented as deep as the tip; its force is its own. Tangential forces do not
    show in the picture.
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

    def contact(
        self,
        finger: int,
        into_F_mm: Array | None,
        normal_force_N: float,  # noqa: ARG002 - the picture tells
        exposed_at_us: int,
        sequence: int,
    ) -> Contact:
        """See :class:`Feel`."""
        view = self._views[finger]
        press = None if into_F_mm is None else press_of(view, into_F_mm)
        image, force_N = view.frame(press, self._rng)
        radius_mm = view.twin.sensor.dome.outer_radius_mm
        point_mm = None if press is None else radius_mm * press.outward
        self._on_picture(finger, Picture(sequence, exposed_at_us, point_mm, force_N))
        return self._estimators[finger].estimate(Frame(image, exposed_at_us, sequence, f"frame {sequence}"))


def press_of(view: CameraView, into_F_mm: Array) -> ProbePress:
    """A flat face that meets a dome into_F_mm (3,), F, from its centre; at most as deep as the fields go."""
    x, y, z = into_F_mm
    theta_rad = min(float(np.arctan2(np.hypot(x, y), z)), np.radians(LARGEST_THETA_DEG))
    depth_mm = view.twin.sensor.dome.outer_radius_mm - float(np.linalg.norm(into_F_mm))
    deepest_mm = view.dome.largest_depth_mm(theta_rad, Probe.PLATE)
    return ProbePress(theta_rad, float(np.arctan2(y, x)), min(depth_mm, deepest_mm))


def touches_in_F(engine: Engine, hand: Hand) -> list[tuple[Array | None, float]]:
    """Of each tip: from its dome's centre to the contact on the object (3,) in mm in F, None without one, and
    the normal force in N."""
    pose = hand.pose(engine.q_rad)
    found: list[tuple[Array | None, float]] = []
    for finger, touch in enumerate(engine.touches()):
        if touch is None:
            found.append((None, 0.0))
            continue
        arm_m = touch.point_m - pose.tip_centre_m[finger]
        found.append((np.asarray(1e3 * pose.tip_rotation[finger].T @ arm_m), touch.normal_force_N))
    return found
