"""Correspondence: which blob of an image is which bead, by topology and not by nearness.

A hard press displaces beads by more than half their spacing; the blob nearest to a bead's old place is then
its neighbour's, and whole regions are labelled one row off, each of them smooth in itself. Therefore labels
spread along the skin from where they are right:

1. *Hypotheses*: places where the beads may be (the last frame's, the reference's). The one whose places lie
   nearest to blobs is taken, and each bead is given the blob next to its place.
2. *Patches*: neighbours whose displacements differ by a fraction of the spacing belong to one patch. Between
   the right patch and one that is a row off runs a tear. The largest patch is the seed.
3. *Growth*: every bead is predicted from its labelled neighbours by a local affine map (local_warp.py) and
   given the blob there, or none. Each round adds about two rows, and takes back labels that the others
   contradict.
4. *Check*: the right labels leave over neither beads nor blobs. Labels a row off leave over both, beads on
   one side of the dome and blobs on the other. Then the next largest patch is tried, and the labelling with
   the most beads taken. What is still left over on both sides is the doubt.

Nothing here depends on a layout of rings or rows, nor on a frame before. docs/matching.md shows the steps in
pictures.
"""

from __future__ import annotations

from collections.abc import Iterator

import msgspec
import numpy as np

from palpate_edge.common.arrays import Array, Indices, Mask, median
from palpate_edge.geometry.points import as_complex, distances
from palpate_edge.vision.blob_detection import Blobs
from palpate_edge.vision.local_warp import LocalWarp
from palpate_edge.vision.nearest_blob import NO_BLOB, KnownBlobs, NearestBlob
from palpate_edge.vision.neighbourhood import Neighbourhood

START_GATE = 0.5  # local spacings, from the hypothesis to a blob
GROWTH_GATE = 0.36  # from the prediction; it is right to about 0.1
NEAR = 0.12  # from the prediction; half the least distance between blobs is more, so no other one is nearer
PATCH_NEIGHBOURS, PATCH_REACH = 6, 1.7  # of a bead: count, and local spacings
PATCH_STEP = 0.25  # local spacings, between the displacements of neighbours in one patch
SMOOTH = 0.25  # local spacings; a bead farther from its prediction may be another one
MIN_SUPPORT = 0.25  # of a bead's neighbours have to be labelled before it is
MIN_PATCH = 8  # beads; fewer determine no affine map and its error
MAX_HYPOTHESES, MAX_PATCHES = 2, 4  # tried, and of each the patches tried as seeds
MAX_ROUNDS = 24  # of growth a frame, over all seeds
RANKING_BEADS = 64  # about that many beads rank the hypotheses
ENOUGH_LEFT = 0.02  # of the beads; with fewer left over the labels are right, and no other seed is tried
CAP_SQUARED = 0.16  # squared spacings, from a hypothesis to the nearest blob; farther is no nearer to right
STRONG = 0.5  # of the labelled blobs' strength; specks and reflections are mostly weaker
AT_LATTICE = 1.3  # local spacings; a blob nearer to a bead's place stands in the lattice or one row beside it


class Match(msgspec.Struct, frozen=True):
    """Labels of one frame's blobs.

    blob (n,): each bead's blob, or NO_BLOB; predicted_px (n, 2): each bead's place as its neighbours predict
    it; doubt: share of the beads left over on both sides, 1 without labels; 0 where they can only be right.
    """

    blob: Indices
    predicted_px: Array
    doubt: float

    @property
    def found(self) -> Mask:
        """Which beads (n,) have a blob."""
        return np.asarray(self.blob != NO_BLOB)


class Correspondence:
    """Matches blobs with the beads of one layout."""

    def __init__(self, neighbourhood: Neighbourhood) -> None:
        """neighbourhood: of the reference's beads."""
        self._reference_px = neighbourhood.position_px
        self._warp = LocalWarp(neighbourhood)
        spacing_px = self._warp.spacing_px
        self._spacing_squared = median(spacing_px) ** 2
        self._start_gate, self._growth_gate = ((gate * spacing_px) ** 2 for gate in (START_GATE, GROWTH_GATE))
        self._near_squared = (NEAR * spacing_px) ** 2
        self._smooth_squared = (SMOOTH * spacing_px) ** 2
        self._some = slice(None, None, max(1, len(spacing_px) // RANKING_BEADS))
        self._near = neighbourhood.nearest(PATCH_NEIGHBOURS)
        distance_px = np.take_along_axis(neighbourhood.distance_px, self._near, axis=1)
        self._joined = distance_px < PATCH_REACH * spacing_px[:, None]
        self._patch_step = ((PATCH_STEP * spacing_px) ** 2).astype(np.float32)[:, None]

    def match(self, blobs: Blobs, hypotheses_px: Array) -> Match:
        """Return the labels of one image's blobs.

        hypotheses_px (h, n, 2): where the beads may be, at least one; ties go to the first.
        """
        if len(blobs.strength) < MIN_PATCH:
            return self._no_match(hypotheses_px[0])
        nearest = NearestBlob(blobs.position_px)
        order = self._best_first(nearest, hypotheses_px)
        best, rounds = self._no_match(hypotheses_px[order[0]]), MAX_ROUNDS
        for expected_px in hypotheses_px[order]:
            blob = nearest.assign(expected_px, self._start_gate)
            displacement_px = blobs.position_px[blob] - self._reference_px
            for patch in self.patches(displacement_px, blob != NO_BLOB):
                seed = np.where(patch, blob, NO_BLOB)
                match, rounds = self._grow(nearest, blobs, displacement_px, seed, rounds)
                if np.count_nonzero(match.found) > np.count_nonzero(best.found):
                    best = match
                if best.doubt <= ENOUGH_LEFT or not rounds:
                    return best
        return best

    def is_smooth(self, position_px: Array, found: Mask) -> bool:
        """Return whether each found bead at position_px (n, 2) is displaced as its neighbours predict."""
        displacement_px = position_px - self._reference_px
        predicted, _ = self._warp.predict(displacement_px, found)
        apart = displacement_px - predicted
        return bool((np.vecdot(apart, apart) < self._smooth_squared)[found].all())

    def _no_match(self, expected_px: Array) -> Match:
        return Match(np.full(len(self._reference_px), NO_BLOB), expected_px, 1.0)

    def _best_first(self, nearest: NearestBlob, hypotheses_px: Array) -> Indices:
        """Return the hypotheses whose places lie nearest to blobs."""
        if len(hypotheses_px) == 1:
            return np.zeros(1, np.intp)
        some_px = hypotheses_px[:, self._some]
        _, squared = nearest.look_up(some_px.reshape(-1, 2))
        squared = np.minimum(squared, CAP_SQUARED * self._spacing_squared)
        distance = squared.reshape(len(some_px), -1).mean(axis=1)
        return np.asarray(np.argsort(distance, kind="stable")[:MAX_HYPOTHESES])

    def patches(self, displacement_px: Array, known: Mask) -> Iterator[Mask]:
        """Yield the patches (n,) of the known beads, the largest first."""
        moved = as_complex(displacement_px)
        apart = moved[:, None] - moved.take(self._near)
        joined = self._joined & known[:, None] & known.take(self._near)
        joined &= apart.real**2 + apart.imag**2 < self._patch_step
        none = len(known)
        label = np.arange(none)
        joined_to = np.where(joined, self._near, label[:, None]).T.copy()  # minima along short rows are slow
        while True:  # a patch's smallest number spreads; every bead takes its label's label, twice
            lower = np.minimum(label, label[joined_to].min(axis=0))
            lower = lower[lower]
            lower = lower[lower]
            if (lower == label).all():
                break
            label = lower
        size = np.bincount(label[known], minlength=none)
        for patch in np.argsort(-size, kind="stable")[:MAX_PATCHES]:
            if size[patch] < MIN_PATCH:
                return
            yield (label == patch) & known

    def _grow(
        self, nearest: NearestBlob, blobs: Blobs, displacement_px: Array, seed: Indices, rounds: int
    ) -> tuple[Match, int]:
        """Spread the labels `seed` (n,) over the skin in at most `rounds`; return also how many are left."""
        last, known = seed, seed != NO_BLOB
        while rounds:
            rounds -= 1
            predicted, support = self._warp.predict(displacement_px, known)
            place_px = self._reference_px + predicted
            gate = np.where(support >= MIN_SUPPORT, self._growth_gate, 0.0)
            blob = nearest.assign(place_px, gate, KnownBlobs(last, self._near_squared))
            if (blob == last).all():
                break
            known, last = blob != NO_BLOB, blob
            displacement_px = blobs.position_px[blob] - self._reference_px
        return Match(last, place_px, self._doubt(blobs, last, place_px)), rounds

    def _doubt(self, blobs: Blobs, blob: Indices, place_px: Array) -> float:
        """Return the share of the beads left over on both sides: beads without blob, and blobs without bead.

        Blobs count when they are as strong as beads and lie in the lattice or one row beside it.
        """
        found = blob != NO_BLOB
        missing = len(found) - np.count_nonzero(found)
        if not missing or missing == len(found):
            return float(missing > 0)
        labelled = np.sort(blob[found])  # the strongest first, as the blobs are
        spare = blobs.strength > STRONG * blobs.strength[labelled[len(labelled) // 2]]
        spare[labelled] = False
        if np.count_nonzero(spare) == 0:
            return 0.0
        apart = distances(blobs.position_px[spare], place_px)
        inside = (apart < AT_LATTICE * self._warp.spacing_px).any(axis=1)
        return min(missing, np.count_nonzero(inside)) / len(found)
