"""The place between the correction model's and the fitted one: its share and its 95 % radius.

Both come from presses left out in turn: the correction model's place of a press by the other presses, and the
fit from there on with contact fields of four fifths of the presses, those without it. Both places err by the
same noise, but not alike; the share minimises the square error of the combined place, that of a faint press
counted less. Where it does not lower the mean error, the sensor goes without contact fields.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate_edge.calibration.contact_fit.contact_shapes import dome_shapes, own_shapes
from palpate_edge.calibration.training.answer_field import AnswerField
from palpate_edge.calibration.training.dome_model import DomeModel
from palpate_edge.calibration.training.kernel_ridge import Regression
from palpate_edge.calibration.training.left_out import LeftOut
from palpate_edge.calibration.training.projection import Projection
from palpate_edge.calibration.training.samples import TrainingPress
from palpate_edge.calibration.training.uncertainty.confidence_radius import combined_radius
from palpate_edge.calibration.training.uncertainty.left_out_regions import region_errors
from palpate_edge.common.arrays import Array
from palpate_edge.estimation.calibration import RegionErrors
from palpate_edge.estimation.contact_fit.contact_fields import ContactFields
from palpate_edge.estimation.contact_fit.contact_fitter import ContactFitter, FitStart
from palpate_edge.estimation.displacement_field import DisplacementReader
from palpate_edge.estimation.pose.kernel_expansion import packed
from palpate_edge.geometry.angles import rotation_about_z

PARTS = 5  # of the presses; each is left out in turn
FEWEST_PRESSES = 20
LEAST_SHARE = 0.1
CAUTION_PRESSES = 10.0  # with as many presses, half of the share that suits them best


@dataclass(frozen=True, slots=True)
class CombinedPlace:
    """Contact fields of a sensor, and the errors of its combined places of presses left out in turn."""

    fields: ContactFields
    regions: tuple[RegionErrors, ...]


def fit_combined_place(
    reader: DisplacementReader,
    noise_px: float,
    presses: Sequence[TrainingPress],
    dome: DomeModel,
    regression: Regression,
    radius_mm: float,
) -> CombinedPlace | None:
    """Return the contact fields of a sensor; None with few presses, or where they do not improve its places.

    presses: of which the regression was fitted to; dome: of the size of the sensor's; noise_px: standard
    deviation of an exact bead's place; radius_mm: of the dome.
    """
    left_out = regression.left_out
    if left_out is None or len(presses) < FEWEST_PRESSES:
        return None
    samples, projection = left_out.samples, regression.projection
    base = dome_shapes(projection, dome)
    plain = np.flatnonzero(samples.plain)
    given, fitted = np.empty((len(presses), 3)), np.empty((len(presses), 3))
    for part in range(PARTS):
        others = plain[samples.press[plain] % PARTS != part]
        fields = _packed(projection, own_shapes(projection, base, samples, others), 1.0, 1.0)
        fitter = ContactFitter(fields, reader, noise_px)
        for index in range(part, len(presses), PARTS):
            start = _start(reader, presses[index], left_out, _first(left_out, index))
            given[index] = start.direction
            fitted[index] = fitter.fit(presses[index].beads, start).direction
    truth = np.array([press.direction for press in presses])
    faintness = np.array([press.faintness for press in presses])
    share = best_share(given, fitted, truth, faintness)
    combined = given + share * (fitted - given)
    combined /= np.linalg.norm(combined, axis=1, keepdims=True)
    before_mm, after_mm = (radius_mm * np.linalg.norm(place - truth, axis=1) for place in (given, combined))
    if share < LEAST_SHARE or after_mm.mean() >= before_mm.mean():
        return None
    scale, held = combined_radius(left_out.radius, after_mm[samples.press], samples, radius_mm)
    fields = _packed(projection, own_shapes(projection, base, samples, plain), share, scale)
    return CombinedPlace(fields, region_errors(samples, after_mm[samples.press], held))


def best_share(given: Array, fitted: Array, truth: Array, faintness: Array) -> float:
    """Return the share, 0 to 1, of the fitted places in the combined ones.

    given, fitted, truth (n, 3): unit vectors; faintness (n,).
    """
    weight = 1.0 / faintness
    towards = fitted - given
    square = float(np.vecdot(towards, towards) @ weight)
    if not square:
        return 0.0
    best = float(np.vecdot(towards, truth - given) @ weight) / square
    return min(max(best, 0.0), 1.0) * len(truth) / (len(truth) + CAUTION_PRESSES)


def _first(left_out: LeftOut, press: int) -> int:
    """Return the sample that is the press as it is."""
    samples = left_out.samples
    return int(np.flatnonzero((samples.press == press) & samples.plain)[0])


def _start(reader: DisplacementReader, press: TrainingPress, left_out: LeftOut, row: int) -> FitStart:
    """Return the answer for a press of a correction model that has not seen it."""
    field = reader.read(press.beads)
    turn = rotation_about_z(field.azimuth_rad)
    x, y, z = (turn @ left_out.directions[row]).tolist()
    x_N, y_N, z_N = (turn @ left_out.forces_N[row]).tolist()
    return FitStart((x, y, z), (x_N, y_N, z_N), field, press.faintness)


def _packed(projection: Projection, shapes: AnswerField, share: float, scale: float) -> ContactFields:
    return ContactFields(
        packed(shapes.centres),
        packed(shapes.weights),
        packed(shapes.offset),
        packed(np.vstack([projection.components.T, projection.mean])),
        share,
        scale,
    )
