"""Pairing: which marker of a single frame is which marker at rest, from where each is expected.

Expected places come from the marker density, to a few hundredths of the spacing. A marker is the detected
spot that is nearest to its place when its place is also the nearest to the spot. What the pairs have left
over is averaged over neighbours and added to the places, and pairs are formed again.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate_edge.common.arrays import Array, Floats, Mask
from palpate_edge.geometry.points import distances, spacing

GATE = 0.45  # of the spacing: a spot farther from a marker's place is another one
AVERAGING_LENGTH = 1.5  # spacings
ROUNDS = 1  # for places that are expected to a few hundredths of the spacing


@dataclass(frozen=True, slots=True)
class PairedMarkers:
    """Markers of one frame: position_px (n, 2), by their neighbours where not found (n,); roughness: root
    mean square distance of the found ones from where their neighbours have them, in spacings."""

    position_px: Array
    found: Mask
    roughness: float


class Pairing:
    """Pairs spots with the markers of one sensor, at rest at (n, 2) px."""

    def __init__(self, rest_px: Array) -> None:
        self.pitch_px = float(np.median(spacing(rest_px)))
        near = distances(rest_px, rest_px) / (AVERAGING_LENGTH * self.pitch_px)
        self._weights = np.exp(-0.5 * near**2).astype(np.float32)
        self._count = len(rest_px)

    def match(self, expected_px: Array, spots_px: Array, rounds: int = ROUNDS) -> PairedMarkers:
        """Return the markers that are expected at (n, 2) among spots (m, 2), in any order."""
        nothing = np.zeros(self._count, dtype=np.bool_)
        if not len(spots_px):
            return PairedMarkers(expected_px, nothing, 0.0)
        place, spots = expected_px.astype(np.float32), spots_px.astype(np.float32)
        partner, found = self._pair(place, spots)
        for _ in range(rounds):
            left = np.where(found[:, None], spots[partner] - place, 0)
            smooth = self._averaged(left, found)
            rough = left[found] - smooth[found]
            place = place + smooth
            partner, found = self._pair(place, spots)
        position = np.where(found[:, None], spots[partner], place)
        roughness = float(np.sqrt(np.square(rough).sum() / max(1, len(rough)))) / self.pitch_px
        return PairedMarkers(position.astype(np.float64), found, roughness)

    def _pair(self, place: Floats, spots: Floats) -> tuple[Array, Mask]:
        """Return the spot (n,) nearest to each place, and whether each is the nearest both ways and near."""
        squared = np.square(place[:, :1] - spots[:, 0]) + np.square(place[:, 1:] - spots[:, 1])
        partner = squared.argmin(axis=1)
        markers = np.arange(self._count)
        found = (squared.argmin(axis=0)[partner] == markers) & (
            squared[markers, partner] < (GATE * self.pitch_px) ** 2
        )
        return partner, found

    def _averaged(self, left: Floats, found: Mask) -> Floats:
        sums = self._weights @ np.column_stack([left, found.astype(np.float32)])
        return np.asarray(sums[:, :2] / np.maximum(sums[:, 2:], 1e-6), dtype=np.float32)
