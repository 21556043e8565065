"""Sub-pixel places by symmetry: the centre about which the colour of a bead is alike to all sides.

Glare washes out one side of a bead, and a weighted centroid moves to the other side by pixels. Here each
colour channel about a bead is a plane (the light) plus a profile of the distance from the centre (the bead
of any shade). Both are fitted by least squares; what the fit leaves on the edges of the profile
gives the step to the centre (Gauss and Newton, with plane and profile eliminated).

For most coloured beads two channels are used, in which white light is 0: the brightness of a ball depends on
where the light comes from, and moves the centre by a tenth of a pixel when the light changes. Dark beads, and
colours that haze and compression leave little of, are better on grey (calibration/fit_choice.py). The
channels are weighted by the inverse covariance of their residuals, so that the one counts that noise and
saturation leave.

The light's plane may end at the bead: some beads are lit alike on all sides where the skin about them is
brighter on one (`EVEN_LIGHT`), others as unevenly as the skin (`SLOPED_LIGHT`). The wrong one displaces the
centre by a tenth of a pixel in strong uneven light.

The same weights give the standard deviation of the place. It is proportional to the error found from clear
beads to beads in glare. Where pixels are clipped they show no noise, and the standard deviation is raised.

The share of the samples' variation that the profile explains separates beads from skin: faint beads in white
light, seen only as rings, mostly have more than 0.5, and 99 of 100 places between beads at most 0.37.
"""

from __future__ import annotations

import math
from typing import cast

import cv2
import msgspec
import numpy as np

from palpate_edge.common.arrays import Array, Floats, Indices, Plane
from palpate_edge.vision.appearance import CHANNELS
from palpate_edge.vision.beads import (
    BOTH_FIT,
    COLOUR_FIT,
    EVEN_LIGHT,
    GREY_FIT,
    SLOPED_LIGHT,
    FitChannels,
    FitLight,
)
from palpate_edge.vision.binning import halved
from palpate_edge.vision.shading import NEIGHBOUR

COLOUR = 3  # dimensions of an image with channels
BINNING = 2  # colour is coded at half resolution in JPEG and in most video formats
FINE_BELOW_PX = 12.0  # diameter of beads that are not binned on grey
# Weights of B, G, R; white light has none of the colours.
COLOURS = np.array([[1, 0, -1], [-0.6, 1.2, -0.6]], np.float32) / np.float32(math.sqrt(2))
GREY = np.array([CHANNELS["grey"]], np.float32)
FIT_CHANNELS: dict[FitChannels, Floats] = {  # the cheaper ones first
    COLOUR_FIT: COLOURS,
    GREY_FIT: GREY,
    BOTH_FIT: np.eye(3, dtype=np.float32),  # weighted by their covariance, B, G, R are as good as any mix
}
GRID_STEP = 0.15  # between samples, in bead diameters
REACH, MIN_REACH = 1.0, 0.7  # radius of the samples, in bead diameters; smaller where another bead is near
KNOT_STEP = 0.15  # of the profile's cubic splines, in bead diameters
PROFILES = 5  # splines; the last one ends at 0.9 bead diameters
PLANE = 3  # columns of the design before the profile: constant, x and y
BEAD_RADIUS, BEAD_EDGE = 0.45, 0.1  # of a bead with its blurred edge, in bead diameters
# Least variance of a channel in grey levels^2: noise and compression. Residuals of few samples tell less.
NOISE = 4.0
# The same for three channels, which light and noise of the camera change together: their covariance is nearly
# singular, and its exact inverse would weight errors of a covariance that few residuals determine.
NOISE_OF_THREE = 64.0
LEAST_VARIATION = 0.3  # of a sample in grey levels^2, of which a profile explains a share
CLIPPED_GREY = 250  # brighter samples are taken to be clipped
CLIPPED_SIGMA, CLIPPED_SHARE = 1.0, 0.5  # added to a deviation's factor, and the share of samples for that
MAX_STEP = 0.12  # of a bead diameter
FAR_STEP = 0.025  # of a bead diameter; after a longer step another one is made
ROUNDS = 2
NOT_CROWDED = -1
CYCLIC = np.array([0, 1, 2, 0, 1])  # three axes, and the two that follow each


class Fitted(msgspec.Struct, frozen=True):
    """Centres of beads: position_px (m, 2), and their standard deviation sigma_px (m,) but for a factor;
    explained (m,): share of the variation about a centre, without the light's, that a bead's profile makes;
    clipped (m,): share of the samples about it that are white."""

    position_px: Array
    sigma_px: Array
    explained: Floats
    clipped: Floats


class SymmetricFit:
    """Measures the centres of n beads in images with three channels (BGR), or in grey ones.

    The samples lie on a grid in units of each bead's diameter, so that the matrices of the least squares are
    computed once.
    """

    def __init__(
        self,
        diameter_px: Array,
        spacing_px: Array,
        channels: FitChannels = COLOUR_FIT,
        light: FitLight = SLOPED_LIGHT,
    ) -> None:
        """diameter_px (n,); spacing_px (n,): to the nearest other bead, whose pixels are left out; channels:
        one of :data:`FIT_CHANNELS`; light: on the beads, like the skin's or even."""
        self._weights = FIT_CHANNELS[channels]
        self._is_grey = channels == GREY_FIT
        noise = NOISE_OF_THREE if channels == BOTH_FIT else NOISE
        self._noise = noise * np.eye(len(self._weights), dtype=np.float32)[..., None]
        self._binning = 1 if self._is_grey and diameter_px.min() < FINE_BELOW_PX else BINNING
        self._diameter = np.asarray(diameter_px, np.float64) / self._binning
        steps = int(REACH / GRID_STEP) * GRID_STEP
        axis = np.arange(-steps, steps + GRID_STEP / 2, GRID_STEP)
        grid = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
        grid = grid[np.hypot(*grid.T) <= REACH]
        radius = np.hypot(*grid.T)
        profile, slope = radial_splines(radius)
        lit = grid * _skin_share(radius)[:, None] if light == EVEN_LIGHT else grid
        design = np.column_stack([np.ones_like(radius), lit, profile])
        outward = grid / np.maximum(radius, 1e-6)[:, None]
        motion = np.concatenate([-slope * outward[:, :1], -slope * outward[:, 1:]], axis=1)
        steps_px = grid.T[:, None] * self._diameter[:, None]
        self._steps: Floats = np.ascontiguousarray(steps_px, np.float32)
        reach = np.clip(spacing_px / diameter_px - NEIGHBOUR, MIN_REACH, REACH)
        inside, kind, beads_of = np.unique(
            radius <= reach[:, None] + 1e-9, axis=0, return_inverse=True, return_counts=True
        )
        most_first = np.argsort(-beads_of)
        inside, kind = inside[most_first], np.argsort(most_first)[kind.ravel()]
        rows, gram = zip(
            *(_least_squares(design * w[:, None], motion * w[:, None]) for w in inside), strict=True
        )
        rows_of_kinds = np.array(rows, np.float32)
        self._rows = rows_of_kinds[0]  # of most beads; the others leave out samples that are another bead's
        self._crowded_beads = kind.nonzero()[0]
        self._own_samples = inside[kind[self._crowded_beads], None].astype(np.float32)
        self._rows_of_crowded = rows_of_kinds[kind[self._crowded_beads]]
        self._index_of_crowded = np.full(len(kind), NOT_CROWDED)
        self._index_of_crowded[self._crowded_beads] = np.arange(len(self._crowded_beads))
        freedom = np.maximum(inside.sum(axis=1) - design.shape[1], 1)
        self._per_freedom = (1.0 / freedom[kind]).astype(np.float32)
        self._motion_gram: Floats = np.array(gram, np.float32)[kind].transpose(2, 1, 0).copy()

    def load(self, image: Plane, *, binned: bool = False) -> None:
        """Take the image that is measured until the next one is loaded: (height, width, 3), and for grey also
        (height, width). binned: halved already, where this fit reads halved images."""
        if self._is_grey and image.ndim == COLOUR:
            image = cast(Plane, cv2.cvtColor(image, cv2.COLOR_BGR2GRAY))
        if self._binning > 1 and not binned:
            image = halved(image)
        self._image: Floats = image.astype(np.float32, copy=False)

    def measure(self, start_px: Array, beads: Indices | None = None) -> Fitted:
        """Return the centres of `beads` (m,), all if None, near `start_px` (m, 2), at most `ROUNDS` steps
        away."""
        half = 0.5 * (self._binning - 1)
        some = slice(None) if beads is None else beads
        centre, diameter = (start_px - half) / self._binning, self._diameter[some]
        step, sigma, explained, clipped = self._step(centre, some)
        centre += step * diameter[:, None]
        for _ in range(ROUNDS - 1):
            far = (np.vecdot(step, step) > FAR_STEP**2).nonzero()[0]
            if not len(far):
                break
            which = far if beads is None else beads[far]
            step[far], sigma[far], explained[far], clipped[far] = self._step(centre[far], which)
            centre[far] += step[far] * diameter[far, None]
        return Fitted(centre * self._binning + half, sigma * diameter * self._binning, explained, clipped)

    def _step(self, centre: Array, beads: slice | Indices) -> tuple[Array, Array, Floats, Floats]:
        """Return the steps (m, 2) to the beads' centres and their standard deviations (m,), in bead
        diameters, and explained and clipped (m,) of Fitted."""
        column, row = self._steps[:, beads] + centre.T.astype(np.float32)[..., None]
        edge = cv2.BORDER_REPLICATE
        samples = cast(Floats, cv2.remap(self._image, column, row, cv2.INTER_LINEAR, borderMode=edge))
        pixels, clipped = self._channels_of(samples)
        products = (pixels.reshape(-1, pixels.shape[2]) @ self._rows).reshape(*pixels.shape[:2], -1)
        others, inside, rows = self._crowded(beads)
        if len(others):
            seen = pixels[others]
            products[others] = seen @ rows  # 0 where another bead is near
            pixels[others] = seen * inside
        covariance = np.vecdot(pixels[:, :, None], pixels[:, None])
        parts = products.transpose(1, 2, 0).copy()  # beads last: sums of few numbers for many beads at once
        per_freedom = self._per_freedom[beads]
        profile, fitted = parts[:, :PROFILES], parts[:, 3 * PROFILES :]
        left = parts[:, PROFILES : 3 * PROFILES].reshape(len(parts), 2, PROFILES, -1)
        unexplained: Floats = covariance.transpose(1, 2, 0) - np.einsum("ikm,jkm->ijm", fitted, fitted)
        by_profile = np.einsum(
            "ikm,ikm->m", fitted[:, PLANE:], fitted[:, PLANE:]
        )  # orthogonal to the light's
        left_over = np.einsum("iim->m", unexplained) + LEAST_VARIATION * len(parts) / per_freedom
        unexplained *= per_freedom
        unexplained += self._noise
        weighted = np.einsum("ijm,jpm->ipm", _inverse(unexplained), profile)
        force_x, force_y = np.einsum("iapm,ipm->am", left, weighted)
        contrast = np.einsum("ipm,iqm->pqm", weighted, profile).reshape(-1, len(centre))
        xx, xy, yy = np.einsum("akm,km->am", self._motion_gram[..., beads], contrast).astype(np.float64)
        determinant = np.maximum(xx * yy - xy * xy, 1e-12)
        step = np.empty((len(centre), 2))
        np.divide(yy * force_x - xy * force_y, determinant, out=step[:, 0])
        np.divide(xx * force_y - xy * force_x, determinant, out=step[:, 1])
        np.minimum(np.maximum(step, -MAX_STEP, out=step), MAX_STEP, out=step)
        raised = 1.0 + CLIPPED_SIGMA * np.minimum(clipped / CLIPPED_SHARE, 1.0)
        explained = by_profile / (by_profile + np.maximum(left_over, 0.0))
        return step, np.sqrt((xx + yy) / determinant) * raised, explained, clipped

    def _crowded(self, beads: slice | Indices) -> tuple[Indices, Floats, Floats]:
        """Return which of the `beads` (m,) have another bead within their samples, (k,), which samples are
        their own (k, 1, g), and their matrices of least squares."""
        if isinstance(beads, slice):
            return self._crowded_beads, self._own_samples, self._rows_of_crowded
        index = self._index_of_crowded[beads]
        others = (index != NOT_CROWDED).nonzero()[0]
        return others, self._own_samples[index[others]], self._rows_of_crowded[index[others]]

    def _channels_of(self, samples: Floats) -> tuple[Floats, Floats]:
        """Return the channels (m, c, g) of samples (m, g, 3), or of grey ones (m, g), and the share (m,)
        of clipped samples."""
        if self._is_grey:
            return samples[:, None], _clipped_share(samples)
        pixels = samples.transpose(0, 2, 1).copy()
        clipped = _clipped_share(pixels.reshape(len(pixels), -1))
        if len(self._weights) < COLOUR:
            pixels = self._weights @ pixels
        return pixels, clipped


def _skin_share(radius: Array) -> Array:
    """Return the share (g,) of skin at distances (g,) from a bead's centre, in bead diameters."""
    return np.asarray(0.5 + 0.5 * np.tanh((radius - BEAD_RADIUS) / BEAD_EDGE))


def _clipped_share(values: Floats) -> Floats:
    """Return the share (m,) of clipped samples (m, s)."""
    _, clipped = cv2.threshold(values, CLIPPED_GREY, 1.0, cv2.THRESH_BINARY)
    return np.asarray(clipped @ np.full(values.shape[1], 1.0 / values.shape[1], np.float32))


def _inverse(matrices: Floats) -> Floats:
    """Return the inverses of symmetric matrices (k, k, m), k at most 3, by their cofactors."""
    size = len(matrices)
    if size == 1:
        return np.asarray(1.0 / matrices)
    if size == 2:
        (xx, xy), (_, yy) = matrices
        return np.asarray(np.stack([yy, -xy, -xy, xx]).reshape(matrices.shape) / (xx * yy - xy * xy))
    twice = matrices.take(CYCLIC, axis=0).take(CYCLIC, axis=1)
    cofactors = twice[1:4, 1:4] * twice[2:5, 2:5] - twice[1:4, 2:5] * twice[2:5, 1:4]
    return np.asarray(cofactors / np.einsum("im,im->m", cofactors[0], matrices[0]))


def radial_splines(radius: Array) -> tuple[Array, Array]:
    """Return values and slopes (g, PROFILES) of even cubic splines at distances (g,) in bead diameters."""
    knots = KNOT_STEP * np.arange(PROFILES)
    value, slope = _cubic((radius[:, None] - knots) / KNOT_STEP)
    mirrored_value, mirrored_slope = _cubic((radius[:, None] + knots) / KNOT_STEP)
    mirrored_value[:, 0] = mirrored_slope[:, 0] = 0.0
    return value + mirrored_value, (slope + mirrored_slope) / KNOT_STEP


def _cubic(distance: Array) -> tuple[Array, Array]:
    """Return value and slope of the cubic B-spline at distances from its middle, in knots."""
    size = np.abs(distance)
    outer, inner = np.maximum(2.0 - size, 0.0), np.maximum(1.0 - size, 0.0)
    value = (outer**3 - 4.0 * inner**3) / 6.0
    slope = (-3.0 * outer**2 + 12.0 * inner**2) / 6.0 * np.sign(distance)
    return value, slope


def _least_squares(design: Array, motion: Array) -> tuple[Array, Array]:
    """Return the columns (g, 3 p + k) whose products with a bead's samples are its profile, the motion's
    products with what the fit leaves, and the fit in orthonormal parts; and the products (p p, 3) of the
    motion's own residuals, by two profiles, for xx, xy and yy."""
    normal = design.T @ design + 1e-9 * np.eye(design.shape[1])
    solution = np.linalg.solve(normal, design.T)
    orthonormal = np.linalg.solve(np.linalg.cholesky(normal), design.T)
    left = motion - design @ (solution @ motion)
    gram = (left.T @ left).reshape(2, PROFILES, 2, PROFILES).transpose(1, 3, 0, 2).reshape(-1, 4)
    return np.concatenate([solution[PLANE:], left.T, orthonormal]).T, gram[:, [0, 1, 3]]
