"""Beads of a sensor with exact centroids that the symmetric fit places better, chosen by presses.

The dark edge of the opening, or the reflection of an LED, is a part of the windows about the beads beside it.
Frames without contact do not show the error: it is the same in all of them, and changes as the bead moves.
Therefore all beads are measured by their symmetry in all presses as well, and each is measured so from then
on whose error (bead_errors.py) is smaller.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec
import numpy as np

from palpate_edge.calibration.bead_errors import HARMLESS, are_harmless, bead_errors
from palpate_edge.calibration.measurement import Measured
from palpate_edge.calibration.seen_presses import seen_by
from palpate_edge.calibration.training.dome_model import DomeModel
from palpate_edge.calibration.training.samples import training_presses
from palpate_edge.common.arrays import Array, Image, Mask
from palpate_edge.common.errors import CalibrationError
from palpate_edge.datasets.images import read_sized_image
from palpate_edge.datasets.press_dataset import PressDataset
from palpate_edge.vision.bead_fit import ChosenFit
from palpate_edge.vision.beads import EVEN_LIGHT, GREY_FIT, SLOPED_LIGHT, Beads, Reference
from palpate_edge.vision.symmetric_fit import FIT_CHANNELS

FEWEST_PRESSES = 10  # by which beads are chosen
BETTER = 0.9  # of a centroid's error
LEAST_GAIN = 0.2  # of the squared errors of all beads; with less all beads stay centroids
LEAST_SEEN = 0.95  # of the presses in which a centroid was found
REST_ROUNDS = 4  # of the fit in reference frames, whose centroids may be far off


@dataclass(frozen=True, slots=True)
class _Way:
    """One way to fit the beads: the reference with fitted places of all, how far they are from the centroids
    (n, 2), and the presses' beads so."""

    reference: Reference
    offset_px: Array
    touches: tuple[Beads, ...]


def with_fitted_beads(dataset: PressDataset, dome: DomeModel, measured: Measured) -> Measured:
    """Return the measurement with the places of some beads by symmetry, where that is better.

    dome: of the sensor's size. Unchanged where all places are fitted already, with few presses, and where the
    errors of all beads together do no harm or hardly become smaller.
    """
    if measured.reference.fit_sigma_px is not None or len(training_presses(measured)) < FEWEST_PRESSES:
        return measured
    radius_mm = dataset.sensor.markers.radius_mm
    fields = seen_by(measured.reader(radius_mm), measured.view, dome).fields
    error = bead_errors(measured.reader(radius_mm), training_presses(measured), fields)
    if are_harmless(error):
        return measured
    every, ways = np.ones(len(error), np.bool_), []
    for way in _ways(dataset, measured):
        fitted = _merged(measured, way, every)
        ways.append((way, bead_errors(fitted.reader(radius_mm), training_presses(fitted), fields)))
    best, fitted_error = min(ways, key=lambda way: float(np.minimum(way[1], error).sum()))
    chosen = (error > HARMLESS) & (fitted_error < BETTER * error)
    chosen &= _times_found(best.touches) > LEAST_SEEN * _times_found([beads for _, beads in measured.touches])
    left = np.where(chosen, fitted_error, error)
    gains = left @ left <= (1.0 - LEAST_GAIN) * (error @ error)
    return _merged(measured, best, chosen) if gains else measured


def _ways(dataset: PressDataset, measured: Measured) -> list[_Way]:
    """Return the ways to fit all beads; each image is read once."""
    is_grey = measured.registration.appearance.channel == "grey"
    references = [
        replace(measured.reference, fit_channels=channels, fit_light=light)
        for channels in ((GREY_FIT,) if is_grey else FIT_CHANNELS)
        for light in (SLOPED_LIGHT, EVEN_LIGHT)
    ]
    no_offset_px = np.zeros_like(measured.reference.position_px)
    at_rest = [ChosenFit(reference, no_offset_px) for reference in references]
    rest_px = np.median(
        [
            [_settled(fit, image, measured.reference.position_px) for fit in at_rest]
            for image in _images(dataset, dataset.reference)
        ],
        axis=0,
    )
    offsets_px = rest_px - measured.reference.position_px
    fits = [
        ChosenFit(reference, offset_px) for reference, offset_px in zip(references, offsets_px, strict=True)
    ]
    paths = [dataset.path(press) for press, _ in measured.touches]
    touches = [
        [_moved(fit, image, beads) for fit in fits]
        for image, (_, beads) in zip(_images(dataset, paths), measured.touches, strict=True)
    ]
    return [
        _Way(replace(reference, position_px=place_px), offset_px, tuple(beads))
        for reference, place_px, offset_px, beads in zip(
            references, rest_px, offsets_px, zip(*touches, strict=True), strict=True
        )
    ]


def _images(dataset: PressDataset, paths: Iterable[Path]) -> Iterable[Image]:
    return (read_sized_image(path, dataset.sensor.image_size_px, error=CalibrationError) for path in paths)


def _settled(fit: ChosenFit, image: Image, place_px: Array) -> Array:
    """Return the fitted places (n, 2) from centroids (n, 2) that may be far off."""
    fit.load(image)
    for _ in range(REST_ROUNDS):
        place_px, _ = fit.fit(place_px, np.ones(len(place_px), np.bool_))
    return place_px


def _moved(fit: ChosenFit, image: Image, beads: Beads) -> Beads:
    fit.load(image)
    position_px, found = fit.fit(beads.position_px, beads.found)
    return Beads.from_positions(position_px, found)


def _merged(measured: Measured, way: _Way, chosen: Mask) -> Measured:
    """Return the measurement with the places of the `chosen` beads (n,) as fitted."""
    place_px = np.where(chosen[:, None], way.reference.position_px, measured.reference.position_px)
    offset_px = np.where(chosen[:, None], way.offset_px, np.nan)
    touches = []
    for (press, beads), fitted in zip(measured.touches, way.touches, strict=True):
        position_px = np.where(chosen[:, None], fitted.position_px, beads.position_px)
        found = np.where(chosen, fitted.found, beads.found)
        lost = (~found).nonzero()[0]
        changed = msgspec.structs.replace(beads, position_px=position_px, found=found, lost=lost)
        touches.append((press, changed))
    reference = replace(way.reference, position_px=place_px, fit_offset_px=offset_px)
    return replace(measured, reference=reference, touches=tuple(touches))


def _times_found(touches: Sequence[Beads]) -> Array:
    """Return in how many presses each bead (n,) was found."""
    return np.asarray(np.sum([beads.found for beads in touches], axis=0), np.float64)
