"""The dome model's presses as the camera and the beads of one sensor show them.

A bead that a contact pushes inwards seems to move along the dome, by more the more obliquely the camera looks
at it: the same press has another displacement field before a close fisheye lens than before a distant camera.
Beads that lie far apart smooth the field, and beads missing near the base cut it off. The fields of the dome
model are a mixture over one kind of camera. Its presses in three dimensions are projected here by the
sensor's own view, at its own beads, whose places are off as in the sensor's pictures.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from palpate_edge.calibration.bead_errors import are_harmless, bead_errors
from palpate_edge.calibration.training.dome_model import DomeModel, SolidPresses, TwistedPresses
from palpate_edge.calibration.training.samples import TrainingPress, make_samples
from palpate_edge.common.arrays import Array, Mask
from palpate_edge.estimation.displacement_field import DisplacementReader, kernel
from palpate_edge.geometry.angles import rotation_about_z
from palpate_edge.geometry.sensor import View
from palpate_edge.vision.beads import Beads

NOISE_PX = 0.02  # of the beads' places, here and in the dome model
RIDGE = 1e-6  # of the interpolation between the points
VARY_EVERY = 3  # firm presses of which one is turned and has hidden beads, as all faint ones are
ERROR_SHARE = 0.5  # of the beads' errors; all of them made forces worse with 200 presses (7202, 7207)
GOLDEN_TURN_RAD = np.pi * (3 - 5**0.5)  # from one press to the next: azimuths that repeat nowhere


def seen_by(
    reader: DisplacementReader, view: View, dome: DomeModel, own: Sequence[TrainingPress] = ()
) -> DomeModel:
    """Return the dome model with fields as the sensor shows them; unchanged without solid presses.

    reader, view: of the sensor; dome: of its size; own: presses of the sensor, which show how far its beads'
    places are off.
    """
    if dome.solid is None:
        return dome
    presses = _presses(reader, view, dome.solid, dome.markers_radius_mm)
    varied = _varied(reader, presses)
    seen = _with_presses(dome, reader, presses, varied)
    if not own:
        return seen
    errors = bead_errors(reader, own, seen.fields)
    if are_harmless(errors):
        return seen
    return _with_presses(dome, reader, _misplaced(reader, presses, ERROR_SHARE * errors), varied)


def _with_presses(
    dome: DomeModel, reader: DisplacementReader, presses: list[TrainingPress], varied: Mask
) -> DomeModel:
    samples = make_samples(reader, presses, copies=1, varied=varied)
    twisted = None
    if samples.torsions_Nmm is not None:
        twisted = TwistedPresses(samples.fields, samples.torsions_Nmm)
    return replace(
        dome,
        fields=samples.fields,
        directions=samples.directions,
        forces=samples.forces_N,
        twisted=twisted,
        plain=samples.plain,
        is_seen=True,
    )


def _varied(reader: DisplacementReader, presses: list[TrainingPress]) -> Mask:
    """Return the presses (n,) that are turned and have hidden beads: all that displace the beads by less than
    the median, and some others.

    A faint press is learned less sharply that way, as the errors of its beads ask for.
    """
    size_px = np.array([np.linalg.norm(reader.displacement_px(press.beads)) for press in presses])
    some = np.arange(len(presses)) % VARY_EVERY == 0
    return np.asarray((size_px < np.median(size_px)) | some)


def _misplaced(
    reader: DisplacementReader, presses: list[TrainingPress], errors: Array
) -> list[TrainingPress]:
    """Return the presses with errors of the beads' places: standard deviations (n,) over the displacement."""
    rng, misplaced = np.random.default_rng(1), []
    for press in presses:
        moved_px = reader.displacement_px(press.beads)
        sigma_px = np.sqrt((moved_px**2).mean()) * errors[:, None]
        place_px = press.beads.position_px + sigma_px * rng.standard_normal(moved_px.shape)
        misplaced.append(replace(press, beads=Beads.from_positions(place_px, press.beads.found)))
    return misplaced


def _presses(
    reader: DisplacementReader, view: View, solid: SolidPresses, radius_mm: float
) -> list[TrainingPress]:
    """Return the presses at azimuths all around the dome, as if tracked in pictures."""
    directions, _ = reader.geometry
    rng = np.random.default_rng(0)
    covariance = kernel(solid.points, solid.points) + RIDGE * np.eye(len(solid.points))
    to_points: Array = np.asarray(np.linalg.inv(covariance), dtype=np.float64)
    presses = []
    each = zip(solid.motions, solid.directions, solid.forces, solid.torsions.tolist(), strict=True)
    for number, (motion_mm, direction, force, torsion) in enumerate(each):
        turn = rotation_about_z(GOLDEN_TURN_RAD * number)
        moved_mm = kernel(directions @ turn, solid.points) @ (to_points @ motion_mm) @ turn.T
        beads = tracked_beads(view, radius_mm * directions + moved_mm, rng)
        presses.append(TrainingPress(beads, turn @ direction, turn @ force, torsion_Nmm=torsion))
    return presses


def tracked_beads(view: View, place_mm: Array, rng: np.random.Generator) -> Beads:
    """Return beads at these places (n, 3) as if all were tracked in a picture, with noise."""
    pixels = view.project(place_mm)
    pixels = pixels + NOISE_PX * rng.standard_normal(pixels.shape)
    return Beads.from_positions(pixels, np.ones(len(pixels), dtype=np.bool_))
