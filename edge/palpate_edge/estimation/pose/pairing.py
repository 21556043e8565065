"""Pairing: which marker of a single frame is which marker at rest, from where each may be.

Places where the markers may be come from the marker density, or from a press that looks alike. From there
labels spread along the skin (vision/correspondence.py), so a few wrong places do not tear it.
"""

from __future__ import annotations

import msgspec
import numpy as np

from palpate_edge.common.arrays import Array, Mask
from palpate_edge.geometry.points import spacing
from palpate_edge.vision.blob_detection import Blobs
from palpate_edge.vision.correspondence import Correspondence
from palpate_edge.vision.neighbourhood import Neighbourhood


class PairedMarkers(msgspec.Struct, frozen=True):
    """Markers of one frame: position_px (n, 2), by their neighbours where not found (n,).

    roughness: root mean square distance of the found ones from where their neighbours have them, in spacings;
    doubt: see correspondence.Match.
    """

    position_px: Array
    found: Mask
    roughness: float
    doubt: float


class Pairing:
    """Pairs spots with the markers of one sensor."""

    def __init__(self, rest_px: Array) -> None:
        """rest_px (n, 2): markers at rest."""
        self.pitch_px = float(np.median(spacing(rest_px)))
        self._correspondence = Correspondence(Neighbourhood(rest_px))

    def match(self, expected_px: Array, spots: Blobs) -> PairedMarkers:
        """Return the markers, expected at (n, 2), among spots in any order."""
        match = self._correspondence.match(spots, expected_px[None])
        found, predicted_px = match.found, match.predicted_px
        if not found.any():
            return PairedMarkers(predicted_px, found, 0.0, match.doubt)
        position_px = np.where(found[:, None], spots.position_px[match.blob], predicted_px)
        apart = (position_px - predicted_px)[found]
        roughness = float(np.sqrt(np.vecdot(apart, apart).mean())) / self.pitch_px
        return PairedMarkers(position_px, found, roughness, match.doubt)
