"""Tracking: every bead keeps its number from frame to frame.

A frame is read in small windows around the last places. Where beads jumped, the windows also start from the
reference, and from the skin around a dent; the labelling with the lower disorder is taken. Only when too many
beads are lost, the whole image is searched and its candidates are assigned one to one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate_edge.common.arrays import Array, Mask, Plane
from palpate_edge.vision.assignment import NO_PARTNER, assign
from palpate_edge.vision.beads import Beads, Reference
from palpate_edge.vision.blob_detection import find_blobs
from palpate_edge.vision.labels import LabelCheck, Labelling
from palpate_edge.vision.region_growing import RegionGrowing
from palpate_edge.vision.window_search import WindowSearch

MAX_RETRIES = 3
MAX_LOST_SHARE = 0.1  # of the beads, in windows; with more lost the whole image is searched


@dataclass(slots=True)
class TrackingCounters:
    """Counters since the start: frames, beads lost (summed over frames), whole-image searches."""

    frames: int = 0
    beads_lost: int = 0
    searches: int = 0


class Tracker:
    """Follows the beads of one reference through a stream of planes (see appearance.plane)."""

    def __init__(self, reference: Reference) -> None:
        self._reference = reference
        self._neighbourhood = reference.neighbourhood
        self._windows = WindowSearch(reference)
        self._labels = LabelCheck(reference)
        self._region_growing = RegionGrowing(reference.neighbourhood)
        self._last_px = reference.position_px.copy()
        self.counters = TrackingCounters()

    def reset(self) -> None:
        """Forget the last frame: the next one starts from the reference."""
        self._last_px = self._reference.position_px.copy()

    def follow(self, dark: Plane) -> Beads:
        """Return the beads of the next frame."""
        self._windows.load(dark)
        labelling = self._in_windows(self._last_px)
        if self._labels.has_jumped(labelling, self._last_px):
            labelling = self._relabel(labelling)
        beads = Beads.from_positions(*labelling)
        if len(beads.lost) > MAX_LOST_SHARE * len(beads.found):
            self.counters.searches += 1
            beads = Beads.from_positions(*self._in_whole_image(dark), searched=True)
        self.counters.frames += 1
        if len(beads.lost):
            self.counters.beads_lost += len(beads.lost)
            predicted_px = self._neighbourhood.predict(beads.position_px, beads.found, beads.lost)
            beads.position_px[beads.lost] = predicted_px
        self._last_px = beads.position_px
        return beads

    def _in_windows(self, expected_px: Array) -> Labelling:
        """Find every bead near `expected_px` (n, 2), the missing ones again near their neighbours."""
        return self._complete(self._windows.find_beads(expected_px))

    def _relabel(self, labelling: Labelling) -> Labelling:
        """Return the most ordered of this labelling and those from the reference and from the quiet skin."""
        from_reference = self._in_windows(self._reference.position_px)
        labelling = self._labels.more_ordered(labelling, from_reference)
        if self._region_growing.is_torn(*labelling):
            grown = self._complete(self._region_growing.grow(*labelling, self._windows.find_beads))
            labelling = self._labels.more_ordered(labelling, grown)
        return labelling

    def _in_whole_image(self, dark: Plane) -> Labelling:
        """Find every blob of the image and assign at most one to each bead."""
        reference = self._reference
        blobs = find_blobs(dark, float(np.median(reference.diameter_px)))
        if not len(blobs.strength):
            return reference.position_px.copy(), np.zeros(len(reference.position_px), dtype=np.bool_)
        partner = assign(reference.position_px, blobs.position_px, self._neighbourhood.spacing_px)
        assigned = partner != NO_PARTNER
        expected_px = np.where(assigned[:, None], blobs.position_px[partner], reference.position_px)
        position_px, found = self._windows.find_beads(expected_px)
        return self._labels.drop_doubles((position_px, found & assigned), self._last_px)

    def _complete(self, labelling: Labelling) -> Labelling:
        """Retry the missing beads and drop doubles; changes both arrays in place."""
        position_px, found = labelling
        if not found.all():
            self._retry(position_px, found)
        return self._labels.drop_doubles(labelling, self._last_px)

    def _retry(self, position_px: Array, found: Mask) -> None:
        """Search the missing beads again where their neighbours' displacement predicts them."""
        for _ in range(MAX_RETRIES):
            missing = np.flatnonzero(~found)
            if not len(missing) or len(missing) == len(found):
                return
            expected_px = self._neighbourhood.predict(position_px, found, missing)
            position_px[missing], found[missing] = self._windows.find_beads(expected_px, missing)
            if not found[missing].any():
                return
