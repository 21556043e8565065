"""Numbered beads: those of the untouched sensor, and those of one frame."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import msgspec
import numpy as np

from palpate_edge.common.arrays import Array, Floats, Indices, Mask
from palpate_edge.vision.neighbourhood import Neighbourhood
from palpate_edge.vision.shading import Shading

NO_BEADS: Indices = np.empty(0, np.intp)
FitChannels = Literal["colour", "grey", "colour and grey"]
FitLight = Literal["sloped", "even"]
SLOPED_LIGHT: FitLight = "sloped"
EVEN_LIGHT: FitLight = "even"
COLOUR_FIT: FitChannels = "colour"
GREY_FIT: FitChannels = "grey"
BOTH_FIT: FitChannels = "colour and grey"


@dataclass(frozen=True)
class Reference:
    """The n beads of the untouched sensor as its camera sees them.

    position_px (n, 2); diameter_px, contrast, area (n,); shading: of the skin about the beads; unevenness
    (n,): see subpixel.Refined. The last two are None where only one frame is known. fit_sigma_px: median
    of symmetric_fit.Fitted.sigma_px; None where places are centroids; fit_channels, fit_light: of the
    symmetric fit; fit_offset_px (n, 2): of the fitted place from the centroid, for beads that have a fitted
    place though the others' are centroids, nan for the others; None without any.
    """

    position_px: Array
    diameter_px: Array
    contrast: Array
    area: Array
    shading: Shading | None = None
    unevenness: Array | None = None
    fit_sigma_px: float | None = None
    fit_channels: FitChannels = COLOUR_FIT
    fit_light: FitLight = SLOPED_LIGHT
    fit_offset_px: Array | None = None

    @cached_property
    def neighbourhood(self) -> Neighbourhood:
        """Distances and weights between the beads, computed once."""
        return Neighbourhood(self.position_px)


class Beads(msgspec.Struct, frozen=True, dict=True):
    """The beads of one frame, in the reference's order.

    position_px (n, 2): measured where `found` (n,), else predicted from the found neighbours; lost (m,):
    the beads that were not found; searched: the whole image had to be searched; doubt: Match.doubt of that
    search, 0 without one; noise (n,): standard deviation of each place over that in the reference frames,
    None where it is 1 for all.
    """

    position_px: Array
    found: Mask
    lost: Indices
    searched: bool
    doubt: float = 0.0
    noise: Floats | None = None

    @classmethod
    def from_positions(
        cls,
        position_px: Array,
        found: Mask,
        *,
        searched: bool = False,
        doubt: float = 0.0,
        noise: Floats | None = None,
    ) -> Beads:
        """Return the beads at `position_px` (n, 2), of which `found` (n,) were measured."""
        lost = NO_BEADS if found.all() else (~found).nonzero()[0]
        return cls(position_px, found, lost, searched, doubt, noise)

    def moved_to(self, position_px: Array) -> Beads:
        """Return the same beads at other places (n, 2)."""
        beads = msgspec.structs.replace(self, position_px=position_px)
        beads.__dict__.update(self.__dict__)  # the weights do not depend on the places
        return beads

    @property
    def found_count(self) -> int:
        """Number of beads that were found."""
        return len(self.found) - len(self.lost)

    @property
    def all_exact(self) -> bool:
        """Return whether all beads were found, each as exactly as in the reference frames."""
        return self.noise is None and not len(self.lost)

    @cached_property
    def weight(self) -> Array:
        """Weight (n,) of each bead in a mean over beads: 0 where it was not found, 1 where it is exact."""
        if self.noise is None:
            return self.found.astype(np.float64)
        return np.asarray(self.found / np.square(self.noise, dtype=np.float64))
