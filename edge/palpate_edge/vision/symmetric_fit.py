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

from palpate_edge.common.arrays import Array, Floats, Image, Indices
from palpate_edge.kernels.halving import HalvedImage
from palpate_edge.kernels.symmetric_steps import SymmetricLimits, SymmetricMatrices, SymmetricSteps
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
    computed once. binning: pixels of the image, along an axis, that are read as one; steps: measures them.
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
        weights = FIT_CHANNELS[channels]
        self._is_grey = channels == GREY_FIT
        self.binning = 1 if self._is_grey and diameter_px.min() < FINE_BELOW_PX else BINNING
        self._diameter = np.asarray(diameter_px, np.float64) / self.binning
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
        # Samples that are another bead's are left out; most beads have none.
        reach = np.clip(spacing_px / diameter_px - NEIGHBOUR, MIN_REACH, REACH)
        own, kind = np.unique(radius <= reach[:, None] + 1e-9, axis=0, return_inverse=True)
        rows, gram = zip(
            *(_least_squares(design * w[:, None], motion * w[:, None]) for w in own), strict=True
        )
        kind = kind.ravel()
        freedom = np.maximum(own.sum(axis=1) - design.shape[1], 1)
        matrices = SymmetricMatrices(
            grid,
            self._diameter,
            weights,
            kind,
            own,
            np.array(rows),
            1.0 / freedom[kind],
            np.array(gram)[kind],
        )
        limits = SymmetricLimits(
            ROUNDS,
            NOISE_OF_THREE if channels == BOTH_FIT else NOISE,
            LEAST_VARIATION,
            CLIPPED_GREY,
            CLIPPED_SIGMA,
            CLIPPED_SHARE,
            MAX_STEP,
            FAR_STEP,
        )
        self.steps = SymmetricSteps(matrices, limits)

    def load(self, image: Image) -> None:
        """Take the image that is measured until the next one is loaded: (height, width, 3), and for grey also
        (height, width)."""
        if self._is_grey and image.ndim == COLOUR:
            image = cast(Image, cv2.cvtColor(image, cv2.COLOR_BGR2GRAY))
        self.steps.load(image if self.binning == 1 else cast(Image, halved(image)))

    def load_halved(self, image: HalvedImage) -> None:
        """Take an image that is halved already, where this fit reads halved images."""
        if self._is_grey and image.small.ndim == COLOUR:
            self.steps.load(cast(Image, cv2.cvtColor(image.complete()[0], cv2.COLOR_BGR2GRAY)))
        else:
            self.steps.load_halved(image)

    def measure(self, start_px: Array, beads: Indices | None = None) -> Fitted:
        """Return the centres of `beads` (m,), all if None, near `start_px` (m, 2), at most `ROUNDS` steps
        away."""
        half = 0.5 * (self.binning - 1)
        found = self.steps.measure((start_px - half) / self.binning, beads)
        diameter_px = self._diameter * self.binning
        sigma_px = found.sigma * (diameter_px if beads is None else diameter_px[beads])
        return Fitted(found.position_px * self.binning + half, sigma_px, found.explained, found.clipped)


def _skin_share(radius: Array) -> Array:
    """Return the share (g,) of skin at distances (g,) from a bead's centre, in bead diameters."""
    return np.asarray(0.5 + 0.5 * np.tanh((radius - BEAD_RADIUS) / BEAD_EDGE))


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
    products with what the fit leaves, and the fit in orthonormal parts; and the products (3, p p) of the
    motion's own residuals, by two profiles, for xx, xy and yy."""
    normal = design.T @ design + 1e-9 * np.eye(design.shape[1])
    solution = np.linalg.solve(normal, design.T)
    orthonormal = np.linalg.solve(np.linalg.cholesky(normal), design.T)
    left = motion - design @ (solution @ motion)
    gram = (left.T @ left).reshape(2, PROFILES, 2, PROFILES).transpose(1, 3, 0, 2).reshape(-1, 4)
    return np.concatenate([solution[PLANE:], left.T, orthonormal]).T, gram[:, [0, 1, 3]].T
