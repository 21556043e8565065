"""Beads at their centres of symmetry (symmetric_fit.py); those without a clear one are lost.

Beads that were not found are looked for where their neighbours predict them: in white light a bead is no
blob, only a faint ring.
"""

from __future__ import annotations

import numpy as np

from palpate_edge.common.arrays import Array, Floats, Image, Mask, median
from palpate_edge.kernels.fitted_beads import FittedBeads, FittedLimits
from palpate_edge.kernels.halving import HalvedImage
from palpate_edge.vision.beads import GREY_FIT, Reference
from palpate_edge.vision.symmetric_fit import COLOUR, SymmetricFit
from palpate_edge.vision.window_search import MAX_NOISE

MAX_FIT_STEP = 0.25  # of a bead diameter, from the centroid to the centre of symmetry
# Of a bead that only the symmetric fit finds, near its prediction: its place is certain, or it looks like
# a bead in white light. Of places between beads, 99 of 100 have a noise above 4 and at most 0.37 explained;
# of those in white light, 2 of 3,378 pass as beads (train presses of the hard sensor).
SURE_NOISE, MAX_FAINT_NOISE, MIN_EXPLAINED, MIN_WHITE = 2.0, 30.0, 0.5, 0.75
MAX_PREDICTED_STEP = (
    0.2  # of a bead diameter; of the places between beads as many pass in white light as with 0.15
)
MIN_APART = 0.6  # of a bead diameter, from any other bead


class BeadFit:
    """Measures the beads of one reference by their symmetry.

    fits_grey: whether grey images will do.
    """

    def __init__(self, reference: Reference, sigma_px: float) -> None:
        """sigma_px: Reference.fit_sigma_px."""
        neighbourhood = reference.neighbourhood
        self.fits_grey = reference.fit_channels == GREY_FIT
        self._fit = SymmetricFit(
            reference.diameter_px, neighbourhood.spacing_px, reference.fit_channels, reference.fit_light
        )
        squared = median(reference.diameter_px) ** 2
        limits = FittedLimits(
            MAX_NOISE,
            MAX_FAINT_NOISE,
            SURE_NOISE,
            MIN_EXPLAINED,
            MIN_WHITE,
            sigma_px,
            MAX_FIT_STEP**2 * squared,
            MAX_PREDICTED_STEP**2 * squared,
            MIN_APART**2 * squared,
        )
        self._beads = FittedBeads(
            self._fit.steps, neighbourhood.means, reference.diameter_px, limits, binning=self._fit.binning
        )

    def reads(self, image: Image) -> bool:
        """Return whether the image has the channels that the calibration chose for the fit."""
        return self.fits_grey or image.ndim == COLOUR

    def load(self, image: Image) -> None:
        """Take the image that is measured until the next one is loaded."""
        self._fit.load(image)

    def load_halved(self, image: HalvedImage) -> None:
        """Take an image that is halved already."""
        self._fit.load_halved(image)

    def fit(self, position_px: Array, found: Mask, *, accepts_lost: bool) -> tuple[Array, Mask, Floats]:
        """Return places (n, 2) of all beads, which (n,) were found, and their noise (n,), see Beads.

        position_px (n, 2): of the beads that were found (n,) in windows; accepts_lost: whether others may be
        found.
        """
        return self._beads.fit(position_px, found, accepts_lost=accepts_lost)


class ChosenFit:
    """Measures those beads of one reference by their symmetry that the calibration chose for it; the others'
    places are centroids."""

    def __init__(self, reference: Reference, offset_px: Array) -> None:
        """offset_px (n, 2): Reference.fit_offset_px."""
        self._beads = np.flatnonzero(np.isfinite(offset_px[:, 0]))
        self._offset_px = offset_px[self._beads]
        diameter_px, spacing_px = reference.diameter_px, reference.neighbourhood.spacing_px
        self._fit = SymmetricFit(diameter_px, spacing_px, reference.fit_channels, reference.fit_light)
        self._max_step_px = MAX_FIT_STEP * diameter_px[self._beads]

    def load(self, image: Image) -> None:
        """Take the image that is measured until the next one is loaded."""
        self._fit.load(image)

    def load_halved(self, image: HalvedImage) -> None:
        """Take an image that is halved already."""
        self._fit.load_halved(image)

    def fit(self, position_px: Array, found: Mask) -> tuple[Array, Mask]:
        """Return the places (n, 2) of beads at centroids (n, 2), and which (n,) of the `found` are clear."""
        position_px, found = position_px.copy(), found.copy()
        start_px = position_px[self._beads] + self._offset_px
        fitted_px = self._fit.measure(start_px, self._beads).position_px
        step = fitted_px - start_px
        position_px[self._beads] = fitted_px
        found[self._beads] &= np.vecdot(step, step) < self._max_step_px**2
        return position_px, found
