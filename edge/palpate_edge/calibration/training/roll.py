"""Roll of the camera about its axis from presses of known place, for a learned layout.

Beads of a known layout determine the camera's roll. Beads of a learned one do not: the layout is turned with
the camera, and all contacts with it, by up to a millimetre on the paper's dome. What the sensor itself learns
cannot mend that, as its presses are taken with their mirror images. A press of known place gives the roll:
the dome model estimates where it is, and the azimuth between the two is the roll and the model's error.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import msgspec
import numpy as np

from palpate_edge.calibration.measurement import Measured
from palpate_edge.calibration.training.dome_model import DomeModel
from palpate_edge.calibration.training.kernel_ridge import fit
from palpate_edge.calibration.training.samples import TrainingPress
from palpate_edge.common.arrays import Array
from palpate_edge.estimation.displacement_field import DisplacementReader
from palpate_edge.geometry.angles import rotation_about_z
from palpate_edge.geometry.sensor import Sensor, View
from palpate_edge.vision.beads import Beads

ROLL_SIGMA_RAD = 0.02  # of assembly, as in camera_fit.PRIOR_SIGMA
MODEL_SIGMA = 0.03  # of the dome model's error across the meridian, over the dome's radius


@dataclass(frozen=True, slots=True)
class CameraRoll:
    """Angle about z from the view to the truth, and its standard deviation."""

    angle_rad: float
    sigma_rad: float


def camera_roll(reader: DisplacementReader, presses: Sequence[TrainingPress], dome: DomeModel) -> CameraRoll:
    """Return the likeliest roll; 0 and the tolerance of assembly without presses.

    dome: of the size of the reader's sphere of beads.
    """
    if not presses:
        return CameraRoll(0.0, ROLL_SIGMA_RAD)
    given = estimated_directions(reader, [press.beads for press in presses], dome)
    along = across = 0.0
    for (x, y, _), press in zip(given, presses, strict=True):
        along += float(x * press.direction[0] + y * press.direction[1])
        across += float(x * press.direction[1] - y * press.direction[0])
    told = max(0.0, along) / MODEL_SIGMA**2
    known = told + ROLL_SIGMA_RAD**-2
    return CameraRoll(math.atan2(across, along) * told / known, known**-0.5)


def estimated_directions(reader: DisplacementReader, touches: Sequence[Beads], dome: DomeModel) -> Array:
    """Return the unit vectors (n, 3) in F from the dome's centre to the contacts, by the dome model alone."""
    fields = [reader.read(beads) for beads in touches]
    given, _, _ = fit(None, dome, 1.0).predict(
        np.array([field.values for field in fields]), np.zeros(len(fields))
    )
    turns = [rotation_about_z(field.azimuth_rad) for field in fields]
    return np.array([turn @ direction for turn, direction in zip(turns, given, strict=True)])


def turned(measured: Measured, sensor: Sensor, turn: Array) -> Measured:
    """Return the same pictures with camera and layout turned by a rotation matrix (3, 3) in F."""
    pose = measured.registration.pose
    rotation, _ = cv2.Rodrigues(np.asarray(pose.rotation_rad, dtype=np.float64))
    rodrigues, _ = cv2.Rodrigues(turn @ rotation)
    nominal_mm = np.asarray(sensor.camera.position_mm)
    x, y, z = (turn @ (nominal_mm + pose.offset_mm) - nominal_mm).tolist()
    a, b, c = rodrigues.ravel().tolist()
    pose = msgspec.structs.replace(pose, offset_mm=(x, y, z), rotation_rad=(a, b, c))
    registration = replace(
        measured.registration, pose=pose, layout_mm=measured.registration.layout_mm @ turn.T
    )
    return replace(measured, registration=registration, view=View(sensor.camera, pose))
