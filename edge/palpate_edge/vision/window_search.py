"""Search of beads in small windows around the places where they are expected.

Each search measures every bead once, and again, four times at most, where its window was off its centre. What
a window showed is kept until the next plane is loaded: nothing is measured twice at the same place.
"""

from __future__ import annotations

import numpy as np

from palpate_edge.common.arrays import Array, Floats, Indices, Mask, Plane
from palpate_edge.kernels.halving import HalvedImage
from palpate_edge.kernels.window_search import SearchedBeads, SearchLimits, WindowSearchKernel
from palpate_edge.vision.beads import Reference
from palpate_edge.vision.subpixel import CONVERGED_STEP, Refiner

MIN_CONTRAST_SHARE = 0.35  # of the bead's contrast in the reference frames
AREA_RANGE = (0.45, 1.9)  # of the bead's area in the reference frames
MAX_ADDED_UNEVENNESS = 0.08  # of the contrast, over the reference frames'; JPEG and blur add less than 0.06
# Of the contrast, in the reference frames: places of more uneven beads, as at the edge, are off there too.
MAX_LEVELLED = 0.2
MAX_STEP = 0.45  # of the spacing, from the expected place
MAX_WINDOW_STEP = 0.5  # of the bead's diameter, from one window to the next
JUMP, MAX_JUMPED_SHARE = 0.2, 0.05  # of the spacing in the first window, and of the beads
MAX_WINDOWS = 3  # of one bead in one search
SAME_WINDOW = 0.15  # of the bead's diameter: a window so near to another one shows the same
# Of a bead whose place its neighbours predict: light may be dim, and beside glare.
MIN_PREDICTED_CONTRAST_SHARE, MAX_PREDICTED_STEP = 0.2, 0.45
# Of a bead whose blob was matched with it.
MIN_BLOB_CONTRAST_SHARE, MAX_BLOB_STEP = 0.1, 0.35
BLOB_STEP = 0.1  # of its diameter; centroids of the press sample are then right to 0.01 px (95 of 100)
MAX_FAINT_STEP = 0.2  # of a bead below MIN_CONTRAST_SHARE, from its prediction; a speck may be anywhere
# Places of dim beads and of beads beside glare are less exact: on a sensor in strong room light the error is
# 0.2 px over the contrast's share, 0.5 px with an unevenness at its limit and 1 px with 0.1 more.
DIM = 0.7  # of the contrast; lighter beads are exact
GLARE_NOISE, GLARE_NOISE_PER_UNEVENNESS = 2.5, 25.0  # at the limit, and beyond
MAX_NOISE = 10.0
MAX_GLARE = 0.05  # of the contrast, beyond the limit; a light's edge displaces such a bead by pixels
# The same where the slope of the skin's grey is subtracted, or symmetric_fit.py measures the bead again.
MAX_LEVELLED_GLARE = 0.3


class WindowSearch:
    """Measures one reference's beads near expected places and accepts those that look as in the reference."""

    def __init__(self, reference: Reference) -> None:
        spacing_px, diameter_px = reference.neighbourhood.spacing_px, reference.diameter_px
        uneven = reference.unevenness
        unevenness = np.full(spacing_px.shape, np.inf) if uneven is None else uneven
        max_unevenness = unevenness + MAX_ADDED_UNEVENNESS
        levelled_from = np.where(unevenness < MAX_LEVELLED, max_unevenness, np.inf)
        self._refiner = Refiner(diameter_px, spacing_px, reference.shading, levelled_from)
        self._max_step_px = MAX_STEP * spacing_px
        self.allow_glare(allowed=False)
        contrast = np.maximum(reference.contrast, 1e-3)
        min_area, max_area = AREA_RANGE
        beads = SearchedBeads(
            contrast,
            MIN_CONTRAST_SHARE * contrast,
            min_area * reference.area,
            max_area * reference.area,
            max_unevenness,
            spacing_px**2,
            (JUMP * spacing_px) ** 2,
            (MAX_WINDOW_STEP * diameter_px) ** 2,
            (SAME_WINDOW * diameter_px) ** 2,
        )
        limits = SearchLimits(
            MIN_CONTRAST_SHARE,
            MIN_PREDICTED_CONTRAST_SHARE,
            MIN_BLOB_CONTRAST_SHARE,
            MAX_ADDED_UNEVENNESS,
            MAX_LEVELLED_GLARE,
            DIM,
            GLARE_NOISE,
            GLARE_NOISE_PER_UNEVENNESS,
            MAX_NOISE,
            MAX_STEP**2,
            MAX_PREDICTED_STEP**2,
            MAX_BLOB_STEP**2,
            MAX_FAINT_STEP**2,
            MAX_JUMPED_SHARE * len(contrast),
            CONVERGED_STEP,
            BLOB_STEP,
        )
        self._kernel = WindowSearchKernel(
            self._refiner.finder,
            reference.neighbourhood.means,
            beads,
            limits,
            binning=self.binning,
            max_windows=MAX_WINDOWS,
        )

    @property
    def binning(self) -> int:
        """Pixels of the plane, along an axis, that are measured as one."""
        return self._refiner.binning

    @property
    def excess(self) -> Floats:
        """By how much the unevenness (n,) about the beads of the last plane is above its limit; glare beside
        a bead, whose edge would displace the centroid, makes it positive.

        Unevenness that most beads share is camera noise and is not counted.
        """
        return self._kernel.excess

    @property
    def windows(self) -> Indices:
        """Windows that were measured of each bead (n,) since the start."""
        return self._kernel.windows

    def load(self, dark: Plane) -> None:
        """Take the plane that is measured until the next one is loaded."""
        self._refiner.load(dark)

    def load_halved(self, image: HalvedImage) -> None:
        """Take the plane of an image that is halved already, where `binning` is 2."""
        self._refiner.load_halved(image)

    def allow_glare(self, *, allowed: bool) -> None:
        """Accept beads in strong glare, and one window at a blob, since places are measured again by their
        symmetry."""
        self._max_glare = MAX_LEVELLED_GLARE if allowed else MAX_GLARE
        self._windows_of_blob = 1 if allowed else MAX_WINDOWS

    def find_beads(
        self, expected_px: Array, max_faint: int, max_faint_after_jump: int
    ) -> tuple[Array, Mask] | None:
        """Return places (n, 2) of all beads near `expected_px` (n, 2), and which (n,) look like beads.

        Beads that were off the centres of their first windows are measured again, and faint ones where the
        others predict them. Return None where the first windows show more than `max_faint` faint places, or
        more than `max_faint_after_jump` beside beads that jumped: the beads are not there.
        """
        return self._kernel.find_beads(expected_px, max_faint, max_faint_after_jump)

    def reaches(self, expected_px: Array, position_px: Array) -> Mask:
        """Return which beads (n,) expected at `expected_px` (n, 2) may be found at `position_px` (n, 2)."""
        step = position_px - expected_px
        return np.asarray(np.vecdot(step, step) < self._max_step_px**2)

    def find_missing(self) -> tuple[Array, Mask]:
        """Return the result of find_beads, with beads that are near where the others predict them.

        Only beads are measured again whose last window was elsewhere and did not show them.
        """
        return self._kernel.find_missing(self._max_glare)

    def find_matched(self, blob_px: Array, beads: Indices, predicted_px: Array) -> tuple[Array, Mask]:
        """Return places (m, 2) of `beads` (m,) at their blobs (m, 2), and which (m,) can be measured.

        predicted_px (m, 2): where their neighbours predict them.
        """
        return self._kernel.find_matched(blob_px, beads, predicted_px, self._windows_of_blob, self._max_glare)

    def noise(self, found: Mask) -> Floats | None:
        """Return the standard deviation (n,) of each found bead's place over that in the reference frames;
        None where it is 1 for all."""
        return self._kernel.noise(found)
