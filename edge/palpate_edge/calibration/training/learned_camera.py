"""Roll and magnification of the camera from presses of known place, for a learned layout.

Beads of a known layout determine both. Beads of a learned one do not: the layout is turned with the camera,
and all contacts with it, by up to a millimetre on the paper's dome; and it is as wide as the nominal focal
length and distance make it, up to 3 deg wrong near the base, where the skin then seems to move less, or more,
than it does. What the sensor itself learns mends little of that: its presses are taken with their mirror
images, and are few. A press of known place gives both: the dome model estimates where it is, and what is
between the two along a parallel is the roll, and along a meridian the magnification, and the model's error.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import msgspec
import numpy as np

from palpate_edge.calibration.measurement import Measured
from palpate_edge.calibration.seen_presses import seen_by
from palpate_edge.calibration.training.dome_model import DomeModel
from palpate_edge.calibration.training.kernel_ridge import fit
from palpate_edge.calibration.training.samples import TrainingPress, training_presses
from palpate_edge.common.arrays import Array
from palpate_edge.estimation.displacement_field import DisplacementReader
from palpate_edge.geometry.angles import rotation_about_z
from palpate_edge.geometry.camera_pose import PRIOR_SIGMA
from palpate_edge.geometry.sensor import CameraPose, Sensor, View
from palpate_edge.vision.beads import Beads

ROLL_SIGMA_RAD, MAGNIFICATION_SIGMA = map(float, PRIOR_SIGMA[5:])  # of assembly
MODEL_SIGMA = 0.03  # of the dome model's error for a press, over the dome's radius
MODEL_MAGNIFICATION_SIGMA = 0.01  # of its error common to all presses of a sensor (twins 7401 to 7405)
OUTLYING = 2.0  # standard deviations; presses farther off count less (Huber's estimate)
STEPS = 5
THINNED = (3, 1)  # of the dome model's presses every third in a first round, all in the last
STEP = 0.005  # of the magnification, between which its effect is measured


@dataclass(frozen=True, slots=True)
class CameraRoll:
    """Angle about z from the view to the truth, and its standard deviation."""

    angle_rad: float
    sigma_rad: float


@dataclass(frozen=True, slots=True)
class Magnification:
    """The true focal length over that of the view, and its standard deviation."""

    factor: float
    sigma: float


def with_camera_of_presses(measured: Measured, sensor: Sensor, dome: DomeModel) -> tuple[Measured, float]:
    """Return the measurement with roll and magnification of its presses, and the standard deviation, rad, of
    the angles that stay open: both in quadrature.

    dome: of any size.
    """
    presses, of_size = training_presses(measured), dome.for_markers(sensor.markers.radius_mm)
    total = Magnification(1.0, MAGNIFICATION_SIGMA)
    for step in THINNED if presses else ():
        found = camera_magnification(measured, sensor, presses, _thinned(of_size, step), total.factor)
        measured = magnified(measured, sensor, found.factor)
        total = Magnification(total.factor * found.factor, found.sigma)
    roll = camera_roll(measured.reader(sensor.markers.radius_mm), presses, of_size)
    open_rad = math.hypot(roll.sigma_rad, total.sigma)
    return turned(measured, sensor, rotation_about_z(roll.angle_rad)), open_rad


def camera_magnification(
    measured: Measured,
    sensor: Sensor,
    presses: Sequence[TrainingPress],
    dome: DomeModel,
    so_far: float = 1.0,
) -> Magnification:
    """Return the likeliest factor of the view's magnification.

    presses: one or more; dome: of the size of the sphere of beads; so_far: factor that the view already has
    over what the reference frames gave it.
    """
    radius_mm, reader = sensor.markers.radius_mm, measured.reader(sensor.markers.radius_mm)
    given = estimated_directions(
        reader, [press.beads for press in presses], seen_by(reader, measured.view, dome)
    )
    places_px = measured.view.project(radius_mm * given)
    larger, smaller = (
        View(sensor.camera, _scaled(measured.registration.pose, factor)).onto_sphere(places_px, radius_mm)
        for factor in (1 + STEP, 1 - STEP)
    )
    change = (larger - smaller) / (2 * STEP * radius_mm)
    seen = np.isfinite(change).all(axis=1)  # a ray at the dome's outline may miss it
    change[~seen] = 0.0
    off = np.array([press.direction for press in presses]) - given
    sigma = MODEL_SIGMA * np.array([press.faintness for press in presses])
    weight, prior = seen / sigma**2, MAGNIFICATION_SIGMA**-2
    step, known = 0.0, prior
    for _ in range(STEPS):
        told = float(weight @ (change**2).sum(axis=1))
        if told > 0:
            best = float(weight @ (change * off).sum(axis=1)) / told
            told = 1 / (1 / told + MODEL_MAGNIFICATION_SIGMA**2)
            known = told + prior
            step = (told * best - prior * (so_far - 1)) / known
        missed = np.linalg.norm(off - step * change, axis=1) / sigma
        weight = seen * np.minimum(1.0, OUTLYING / np.maximum(missed, 1e-9)) / sigma**2
    return Magnification(1 + step, known**-0.5)


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
    return _with_camera(measured, sensor, pose, measured.registration.layout_mm @ turn.T)


def magnified(measured: Measured, sensor: Sensor, factor: float) -> Measured:
    """Return the same pictures with a camera of another focal length, and the layout where it shows them."""
    pose, layout_mm = _scaled(measured.registration.pose, factor), measured.registration.layout_mm
    places_px = measured.view.project(layout_mm)
    lifted_mm = View(sensor.camera, pose).onto_sphere(places_px, sensor.markers.radius_mm)
    lifted_mm = np.where(np.isnan(lifted_mm), layout_mm, lifted_mm)  # at the dome's outline
    return _with_camera(measured, sensor, pose, lifted_mm)


def _with_camera(measured: Measured, sensor: Sensor, pose: CameraPose, layout_mm: Array) -> Measured:
    registration = replace(measured.registration, pose=pose, layout_mm=layout_mm)
    return replace(measured, registration=registration, view=View(sensor.camera, pose))


def _scaled(pose: CameraPose, factor: float) -> CameraPose:
    return msgspec.structs.replace(pose, focal_scale=pose.focal_scale * factor)


def _thinned(dome: DomeModel, step: int) -> DomeModel:
    """Return the dome model with one of `step` of its presses in three dimensions."""
    if dome.solid is None:
        return dome
    return replace(dome, solid=dome.solid.every(step))
