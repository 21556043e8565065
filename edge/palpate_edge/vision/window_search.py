"""Search of beads in small windows around the places where they are expected.

Each search measures every bead once, and again, four times at most, where its window was off its centre. What
a window showed is kept until the next plane is loaded: nothing is measured twice at the same place.
"""

from __future__ import annotations

import numpy as np

from palpate_edge.common.arrays import Array, Floats, Indices, Mask, Plane
from palpate_edge.vision.beads import Reference
from palpate_edge.vision.neighbourhood import upper_median
from palpate_edge.vision.subpixel import CONVERGED_STEP, Refined, Refiner

MIN_CONTRAST_SHARE = 0.35  # of the bead's contrast in the reference frames
AREA_RANGE = (0.45, 1.9)  # of the bead's area in the reference frames
MAX_ADDED_UNEVENNESS = 0.08  # of the contrast, over the reference frames'; JPEG and blur add less than 0.06
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
MAX_FITTED_GLARE = 0.3  # of beads that are measured again by symmetric_fit.py


class WindowSearch:
    """Measures one reference's beads near expected places and accepts those that look as in the reference."""

    def __init__(self, reference: Reference) -> None:
        self._neighbourhood = reference.neighbourhood
        spacing_px = self._neighbourhood.spacing_px
        self._refiner = Refiner(reference.diameter_px, spacing_px, reference.shading)
        self._spacing_squared = spacing_px**2
        self._contrast = np.maximum(reference.contrast, 1e-3).astype(np.float32)
        self._min_contrast = MIN_CONTRAST_SHARE * self._contrast
        self._min_area, self._max_area = ((share * reference.area).astype(np.float32) for share in AREA_RANGE)
        unevenness = np.inf if reference.unevenness is None else reference.unevenness
        self._max_unevenness = np.full(spacing_px.shape, unevenness + MAX_ADDED_UNEVENNESS, np.float32)
        self._noise_unevenness = 0.0
        self._max_glare, self._windows_of_blob = MAX_GLARE, MAX_WINDOWS
        self._contrast_share = np.ones_like(self._contrast)
        self._excess = np.zeros_like(self._contrast)
        self._jump_squared = (JUMP * spacing_px) ** 2
        self._max_step_squared = (MAX_WINDOW_STEP * reference.diameter_px) ** 2
        self._same_squared = (SAME_WINDOW * reference.diameter_px) ** 2

    @property
    def binning(self) -> int:
        """Pixels of the plane, along an axis, that are measured as one."""
        return self._refiner.binning

    def load(self, dark: Plane, *, binned: bool = False) -> None:
        """Take the plane, `binned` already or not, that is measured until the next one is loaded."""
        self._refiner.load(dark, binned=binned)

    def allow_glare(self, *, allowed: bool) -> None:
        """Accept beads in strong glare, and one window at a blob, since places are measured again by their
        symmetry."""
        self._max_glare = MAX_FITTED_GLARE if allowed else MAX_GLARE
        self._windows_of_blob = 1 if allowed else MAX_WINDOWS

    def find_beads(
        self, expected_px: Array, max_faint: int, max_faint_after_jump: int
    ) -> tuple[Array, Mask] | None:
        """Return places (n, 2) of all beads near `expected_px` (n, 2), and which (n,) look like beads.

        Return None where the first windows show more than `max_faint` faint places, or more than
        `max_faint_after_jump` beside beads that jumped: the beads are not there.
        """
        refined = self._refiner.centroids(expected_px, None, 1, self._min_contrast, max_faint)
        self._last, self._last_start_px = refined, expected_px
        self._contrast_share = refined.contrast / self._contrast
        there = self._contrast_share > MIN_CONTRAST_SHARE
        faint = len(there) - np.count_nonzero(there)
        if faint > max_faint:
            return None
        step = refined.position_px - expected_px
        step_squared = np.vecdot(step, step)
        if faint > max_faint_after_jump:
            jumped = np.count_nonzero((step_squared > self._jump_squared) & there)
            if jumped > MAX_JUMPED_SHARE * len(there):
                return None
        moving = (there & ~refined.converged).nonzero()[0]
        if len(moving):
            reach = np.minimum(1.0, np.sqrt(self._max_step_squared[moving] / step_squared[moving]))
            self._go_on(expected_px[moving] + reach[:, None] * step[moving], moving, there)
        found = self._contrast_share > MIN_CONTRAST_SHARE
        found &= refined.converged
        found &= refined.area > self._min_area
        found &= refined.area < self._max_area
        found &= self.reaches(expected_px, refined.position_px)
        self._excess = self._excess_of(refined.unevenness)
        found &= self._excess < 0
        return refined.position_px, found

    def reaches(self, expected_px: Array, position_px: Array) -> Mask:
        """Return which beads (n,) expected at `expected_px` (n, 2) may be found at `position_px` (n, 2)."""
        step = position_px - expected_px
        return np.asarray(np.vecdot(step, step) < MAX_STEP**2 * self._spacing_squared)

    def _go_on(self, start_px: Array, moving: Indices, there: Mask) -> None:
        """Measure the `moving` beads (m,), which were off the centres of their first windows, again.

        start_px (m, 2): centres of the next windows; there (n,): which first windows showed a bead. The other
        beads are looked for where their neighbours predict them, together with the beads that are still off.
        """
        last = self._last
        if there.all():
            self._measure_again(start_px, moving, MAX_WINDOWS - 1)
            return
        self._measure_again(start_px, moving, 1)
        off, faint = moving[~last.converged[moving]], (~there).nonzero()[0]
        predicted_px = self._neighbourhood.predict(last.position_px, there, faint)
        self._last_start_px = self._last_start_px.copy()
        self._last_start_px[faint] = predicted_px
        start_px = np.concatenate((last.position_px[off], predicted_px))
        self._measure_again(start_px, np.concatenate((off, faint)), MAX_WINDOWS)

    def _measure_again(self, start_px: Array, beads: Indices, max_windows: int) -> None:
        """Measure `beads` (m,) about `start_px` (m, 2) and keep the result in place of their last one."""
        last, again = self._last, self._refiner.centroids(start_px, beads, max_windows)
        last.position_px[beads], last.contrast[beads] = again.position_px, again.contrast
        last.area[beads], last.unevenness[beads] = again.area, again.unevenness
        last.converged[beads] = again.converged
        self._contrast_share[beads] = again.contrast / self._contrast[beads]

    def find_predicted(self, expected_px: Array, beads: Indices) -> tuple[Array, Mask]:
        """Return places (m, 2) of `beads` (m,) near `expected_px` (m, 2), as their neighbours predict them,
        and which (m,) were found; find_beads was called for this plane before."""
        self._look_again(expected_px, beads)
        last = self._last
        found = last.converged[beads] & (self._contrast_share[beads] > MIN_PREDICTED_CONTRAST_SHARE)
        found &= last.area[beads] > self._min_area[beads]
        found &= last.area[beads] < self._max_area[beads]
        step = last.position_px[beads] - expected_px
        found &= np.vecdot(step, step) < MAX_PREDICTED_STEP**2 * self._spacing_squared[beads]
        found &= self._not_faint_and_off(last.position_px[beads], expected_px, beads)
        found &= self._excess[beads] < self._max_glare
        return last.position_px[beads], found

    def _look_again(self, expected_px: Array, beads: Indices) -> None:
        """Measure the `beads` (m,) about `expected_px` (m, 2) whose last window did not show them."""
        last = self._last
        apart = self._last_start_px[beads] - expected_px
        far = np.vecdot(apart, apart) > self._same_squared[beads]
        far &= ~last.converged[beads]
        if not far.any():
            return
        beads, expected_px = beads[far], expected_px[far]
        refined, _ = self._measure(expected_px, beads, MAX_WINDOWS)
        last.position_px[beads], last.area[beads] = refined.position_px, refined.area
        last.converged[beads] = refined.converged

    def find_matched(self, blob_px: Array, beads: Indices, predicted_px: Array) -> tuple[Array, Mask]:
        """Return places (m, 2) of `beads` (m,) at their blobs (m, 2), and which (m,) can be measured.

        predicted_px (m, 2): where their neighbours predict them.
        """
        refined, step_squared = self._measure(blob_px, beads, self._windows_of_blob, BLOB_STEP)
        self._excess[beads] = self._excess_of(refined.unevenness, beads)
        found = self._contrast_share[beads] > MIN_BLOB_CONTRAST_SHARE
        found &= refined.area < self._max_area[beads]
        found &= step_squared < MAX_BLOB_STEP**2
        found &= self._not_faint_and_off(refined.position_px, predicted_px, beads)
        found &= self._excess[beads] < self._max_glare
        return refined.position_px, found

    def _not_faint_and_off(self, position_px: Array, predicted_px: Array, beads: Indices) -> Mask:
        """Return which `beads` (m,) are not both faint and off their predicted places (m, 2)."""
        faint = self._contrast_share[beads] < MIN_CONTRAST_SHARE
        apart = position_px - predicted_px
        return np.asarray(
            ~faint | (np.vecdot(apart, apart) < MAX_FAINT_STEP**2 * self._spacing_squared[beads])
        )

    def noise(self, found: Mask) -> Floats | None:
        """Return the standard deviation (n,) of each found bead's place over that in the reference frames;
        None where it is 1 for all."""
        dim = self._contrast_share < DIM
        glare = self._excess > 0
        inexact = (dim | glare) & found
        if not inexact.any():
            return None
        noise = np.where(dim, 1.0 / np.maximum(self._contrast_share, 1e-3), 1.0)
        by_glare = GLARE_NOISE + GLARE_NOISE_PER_UNEVENNESS * self._excess
        noise = np.where(glare, np.maximum(noise, by_glare), noise)
        return np.where(inexact, np.minimum(noise, MAX_NOISE), 1.0).astype(np.float32)

    def _measure(
        self, start_px: Array, beads: Indices, max_windows: int, converged_step: float = CONVERGED_STEP
    ) -> tuple[Refined, Array]:
        """Measure `beads` (m,) and return also the squared steps (m,) from their starts, squared spacings."""
        which = None if len(beads) == len(self._contrast) else beads  # all beads in order: nothing to select
        refined = self._refiner.centroids(start_px, which, max_windows, converged_step=converged_step)
        self._contrast_share[beads] = refined.contrast / self._contrast[beads]
        self._excess[beads] = refined.unevenness - self._max_unevenness[beads] - self._noise_unevenness
        step = refined.position_px - start_px
        return refined, np.asarray(np.vecdot(step, step) / self._spacing_squared[beads])

    def _excess_of(self, unevenness: Floats, beads: slice | Indices = slice(None)) -> Floats:
        """Return by how much the unevenness (m,) about the `beads` (m,) is above its limit; glare beside a
        bead, whose edge would displace the centroid, makes it positive.

        Unevenness that most beads share is camera noise: it is added to the limit until the next call.
        """
        excess: Floats = unevenness - self._max_unevenness[beads]
        self._noise_unevenness = 0.0
        if (excess >= 0).any():
            self._noise_unevenness = max(0.0, upper_median(excess) + MAX_ADDED_UNEVENNESS)
            excess -= self._noise_unevenness
        return excess
