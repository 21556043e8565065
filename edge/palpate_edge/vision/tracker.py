"""Tracking: every bead keeps its number, in a video as in single frames.

A frame is read in small windows around the last places, the missing beads once more where their neighbours
predict them. Such labels are accepted when no bead jumped and hardly more are missing than before, or when
no more are missing than in the last search and all move as one skin. Otherwise the blobs of the whole image
are matched with the beads by topology (correspondence.py).

Where the first windows show that the beads jumped away, the windows about the reference's places are read
next: they show light touches. They are not read where they would not have shown the last frame that was
searched. After a search that showed a jump no windows are read about the last places, since single frames in
a row jump every time. The search happens at most once for any frame: no frame costs much more than most do.
A bead that stays hidden causes no search: only the loss of further beads does.

Doubtful labels of beads that jumped are never the start of the next frame, since a skin that stands still
would confirm labels a row off. Frames start from the reference until one is without doubt.
"""

from __future__ import annotations

from typing import cast

import msgspec
import numpy as np

from palpate_edge.common.arrays import Array, Image, Plane, median
from palpate_edge.kernels.halving import HalvedImage
from palpate_edge.vision.appearance import Appearance, colour_weights, plane
from palpate_edge.vision.bead_fit import BeadFit, ChosenFit
from palpate_edge.vision.beads import Beads, Reference
from palpate_edge.vision.blob_detection import BlobDetector
from palpate_edge.vision.correspondence import Correspondence
from palpate_edge.vision.labels import LabelCheck, Labelling
from palpate_edge.vision.symmetric_fit import COLOUR
from palpate_edge.vision.window_search import WindowSearch

MAX_LOST_SHARE = 0.1  # of the beads, beyond those lost in the last search; with more the image is searched
MAX_RETRIED_SHARE = 0.3  # of the beads; with more lost their neighbours predict none
MAX_FAINT_AT_REST = 0.05  # of the beads, at their places in the reference; with more the press is deep
MAX_LOST_AFTER_JUMP = 0.02  # a shift by one row loses the beads of one side
MAX_DOUBT = 0.25  # Match.doubt of a frame that the next one may start from
MAX_DOUBT_AFTER_JUMP = 0.03  # the same where beads jumped: labels a row off would become the history
MIN_STRENGTH_SHARE = 0.025  # of the beads' contrast; blobs of dim and of overexposed beads are that weak
MIN_STRENGTH = 0.7  # grey levels
BLOBS_PER_BEAD = 2.5  # of the strongest that are matched


class TrackingCounters(msgspec.Struct):
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
        self._halved = HalvedImage()
        self._labels = LabelCheck(reference)
        self._correspondence = Correspondence(reference.neighbourhood)
        min_strength = max(MIN_STRENGTH, MIN_STRENGTH_SHARE * median(reference.contrast))
        most = int(BLOBS_PER_BEAD * len(reference.position_px))
        self._blobs = BlobDetector(median(reference.diameter_px), min_strength, most, coarse=True)
        sigma_px = reference.fit_sigma_px
        self._fit = None if sigma_px is None else BeadFit(reference, sigma_px)
        offset_px = reference.fit_offset_px
        self._chosen_fit = None if offset_px is None else ChosenFit(reference, offset_px)
        self.counters = TrackingCounters()
        self.reset()

    def reset(self) -> None:
        """Forget the last frame: the next one starts from the reference."""
        self._last_px = self._reference.position_px.copy()
        self._last_lost, self._accepted_lost, self._is_reference = 0, 0, True
        self._jumped, self._rest_shows = False, True

    def follow_image(self, image: Image, appearance: Appearance) -> Beads:
        """Return the beads of the next frame, (height, width, 3) or a grey one.

        Where beads are large and differ from the skin by colour, all stages read the same halved image.
        """
        if image.ndim != COLOUR or appearance.channel == "grey" or self._windows.binning == 1:
            return self.follow(plane(image, appearance), image)
        self._halved.begin(image, colour_weights(appearance))
        for fit in (self._fit, self._chosen_fit):
            if fit is not None:
                fit.load_halved(self._halved)
        self._windows.load_halved(self._halved)
        return self._follow(self._fit, self._chosen_fit, None)

    def follow(self, dark: Plane, image: Image | None = None) -> Beads:
        """Return the beads of the next frame.

        image: the frame that the plane is of, (height, width, 3) or a grey one. Where given, places come from
        the channels that the calibration chose for the symmetric fit.
        """
        fit = self._fit if self._fit is not None and image is not None and self._fit.reads(image) else None
        if fit is not None and image is not None:
            fit.load(image)
        is_grey = dark.dtype == np.uint8
        chosen = self._chosen_fit if image is not None else None
        if self._windows.binning == 1 or not is_grey:
            self._windows.load(dark)
            if chosen is not None and image is not None:
                chosen.load(cast(Image, dark) if is_grey else image)
            return self._follow(fit, chosen, dark)
        self._halved.begin(cast(Image, dark))
        self._windows.load_halved(self._halved)
        if chosen is not None:
            chosen.load_halved(self._halved)
        return self._follow(fit, chosen, None)

    def _follow(self, fit: BeadFit | None, chosen: ChosenFit | None, dark: Plane | None) -> Beads:
        """Return the beads of the next frame, which fits and windows have; dark: None where it is halved."""
        self._windows.allow_glare(allowed=fit is not None)
        labelling = self._in_windows()
        if labelling is None:
            beads = self._in_whole_image(dark)
            self._accepted_lost = len(beads.lost)
            is_near = self._windows.reaches(self._reference.position_px, beads.position_px)
            self._rest_shows = bool(is_near.all()) and len(beads.lost) <= MAX_LOST_AFTER_JUMP * len(is_near)
        else:
            self._jumped, self._rest_shows = False, True
            beads = Beads.from_positions(*labelling)
            self._accepted_lost = min(self._accepted_lost, len(beads.lost))
        if chosen is not None:
            position_px, found = chosen.fit(beads.position_px, beads.found)
            beads = Beads.from_positions(position_px, found, searched=beads.searched, doubt=beads.doubt)
        if fit is None:
            if (noise := self._windows.noise(beads.found)) is not None:
                beads = msgspec.structs.replace(beads, noise=noise)
        else:
            beads = self._by_symmetry(fit, beads)
        self.counters.frames += 1
        if len(beads.lost):
            self.counters.beads_lost += len(beads.lost)
            predicted_px = self._neighbourhood.predict(beads.position_px, beads.found, beads.lost)
            beads.position_px[beads.lost] = predicted_px
        max_doubt = MAX_DOUBT_AFTER_JUMP if self._jumped else MAX_DOUBT
        if beads.doubt > max_doubt or beads.found_count < len(beads.lost):
            self.reset()
        else:
            self._last_px, self._last_lost = beads.position_px, len(beads.lost)
            self._is_reference = False
        return beads

    def _by_symmetry(self, fit: BeadFit, beads: Beads) -> Beads:
        """Return the beads at their centres of symmetry; those without a clear one are lost."""
        if not beads.found_count:
            return beads
        accepts_lost = beads.doubt <= MAX_DOUBT
        position_px, found, noise = fit.fit(beads.position_px, beads.found, accepts_lost=accepts_lost)
        return Beads.from_positions(
            position_px, found, searched=beads.searched, doubt=beads.doubt, noise=noise
        )

    def _in_windows(self) -> Labelling | None:
        """Find every bead near its last place or, after a jump, near its place in the reference; None where
        the labels may be wrong or many are missing."""
        count = len(self._last_px)
        max_lost = int(self._accepted_lost + MAX_LOST_SHARE * count)
        max_faint = int(MAX_FAINT_AT_REST * count)
        max_faint_after_jump = int(MAX_LOST_AFTER_JUMP * count)
        if not self._jumped:
            labelling = self._windows.find_beads(
                self._last_px, max_faint if self._is_reference else max_lost, max_faint_after_jump
            )
            if labelling is not None or self._is_reference:
                return self._accepted(labelling, self._last_px, max_lost)
        if not self._rest_shows:
            return None
        rest_px = self._reference.position_px
        labelling = self._windows.find_beads(rest_px, max_faint, max_faint_after_jump)
        return self._accepted(labelling, rest_px, max_lost)

    def _accepted(self, labelling: Labelling | None, start_px: Array, max_lost: int) -> Labelling | None:
        """Return the labelling of windows about `start_px` (n, 2), completed; None where it may be wrong."""
        if labelling is None:
            return None
        count = len(start_px)
        missing = count - np.count_nonzero(labelling[1])
        if missing > self._accepted_lost + MAX_RETRIED_SHARE * count:
            return None
        if missing:
            labelling = self._windows.find_missing()
        lost, has_jumped = self._labels.check(labelling, start_px)
        if lost > max_lost:
            return None
        if lost <= self._last_lost + MAX_LOST_AFTER_JUMP * count and not has_jumped:
            return labelling
        # After a jump no further beads may be missing, and all have to be displaced like their neighbours.
        is_whole = lost <= self._accepted_lost and self._correspondence.is_smooth(*labelling)
        return labelling if is_whole else None

    def _in_whole_image(self, dark: Plane | None) -> Beads:
        """Match the blobs of the whole image with the beads."""
        self.counters.searches += 1
        blobs = self._blobs.find(self._halved.complete()[1], 1) if dark is None else self._blobs.find(dark)
        hypotheses = (
            [self._reference.position_px]
            if self._is_reference
            else [self._last_px, self._reference.position_px]
        )
        match = self._correspondence.match(blobs, hypotheses)
        matched = match.found
        blob_px = blobs.position_px[match.blob] if len(blobs.strength) else match.predicted_px
        expected_px = np.where(matched[:, None], blob_px, match.predicted_px)
        position_px, found = expected_px, np.zeros_like(matched)
        beads = matched.nonzero()[0]
        if len(beads):
            position_px[beads], found[beads] = self._windows.find_matched(
                expected_px[beads], beads, match.predicted_px[beads]
            )
        _, self._jumped = self._labels.check((position_px, found), self._last_px)
        return Beads.from_positions(position_px, found, searched=True, doubt=match.doubt)
