"""Printer, scale and dome together in virtual time, and the placement of the fingertip."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from palpate_edge.common.arrays import Array, Image
from palpate_edge.common.contact import Vector3
from palpate_twin.camera.renderer import CameraView
from palpate_twin.press_rig.dome_on_scale import DomeOnScale
from palpate_twin.press_rig.simulated_printer import PLAY_MM, SimulatedPrinter
from palpate_twin.press_rig.simulated_scale import NOISE_N, SimulatedScale

PARKED_MM = 15.0  # height of the ball over the apex at the start


@dataclass(frozen=True, slots=True)
class Placement:
    """Pose of the fingertip under the printer: offset of its centre from the expected one, lean about x and
    y, and turn about z."""

    offset_mm: Vector3 = (1.0, 0.0, 0.0)
    lean_deg: tuple[float, float] = (2.0, 0.0)
    turn_deg: float = 2.0

    @property
    def to_printer(self) -> Array:
        """Return the rotation (3, 3) from F to the printer's axes."""
        lean, _ = cv2.Rodrigues(np.radians([*self.lean_deg, 0.0]))
        turn, _ = cv2.Rodrigues(np.array([0.0, 0.0, math.radians(self.turn_deg)]))
        return np.asarray(turn @ lean, dtype=np.float64)


class VirtualRig:
    """The simulated parts on one clock.

    apex_mm: printer position at which the ball would just touch the apex, were the fingertip mounted exactly.
    """

    def __init__(
        self,
        view: CameraView,
        apex_mm: Vector3,
        mounting: Placement,
        seed: int,
        *,
        play_mm: float = PLAY_MM,
        noise_N: float = NOISE_N,
    ) -> None:
        self.view = view
        x, y, z = apex_mm
        self.printer = SimulatedPrinter(np.array([x, y, z + PARKED_MM]), play_mm)
        self.scale = SimulatedScale(seed, noise_N=noise_N)
        reach_mm = view.twin.sensor.dome.outer_radius_mm + 5.0
        self.centre_mm = np.array(apex_mm) - [0.0, 0.0, reach_mm] + mounting.offset_mm
        self.dome = DomeOnScale(view, self.centre_mm, mounting.to_printer)
        self.has_probe = True
        self._position_mm, self._load_N = np.full(3, np.nan), 0.0
        self._rng = np.random.default_rng([seed, 13])

    def advance(self, now_us: int, to_printer: bytes) -> tuple[bytes, bytes]:
        """Return the bytes of printer and scale at a time; steps of some milliseconds follow the contact."""
        self.printer.receive(to_printer)
        from_printer = self.printer.advance(now_us)
        position_mm = self.printer.position_mm(now_us)
        if self.has_probe and not np.array_equal(position_mm, self._position_mm):
            self.dome.move(position_mm)
            self._load_N = -float(self.dome.force_N[2])
            self._position_mm = position_mm.copy()
        return from_printer, self.scale.advance(now_us, self._load_N)

    def remove_probe(self) -> None:
        """Take the ball off the head, or let it fall."""
        self.has_probe = False
        self.dome.press, self._load_N = None, 0.0

    def picture(self) -> Image:
        """Return a new image of the camera (height, width, 3)."""
        image, _ = self.view.frame(self.dome.press, self._rng)
        return image
