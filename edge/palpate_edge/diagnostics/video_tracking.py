"""Following the markers of a video of any skin forwards and backwards, to see whether labels hold.

Truth is not needed: a marker that is followed to the video's end and back must return to where it began,
and must be where it was on the way there. One that took its neighbour's place does not.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate_edge.common.arrays import Array, Image, Mask
from palpate_edge.common.errors import DatasetError
from palpate_edge.datasets.recording import Recording
from palpate_edge.geometry.points import distances, repeated, spacing
from palpate_edge.vision.appearance import Appearance, plane
from palpate_edge.vision.beads import Reference
from palpate_edge.vision.disk_profile import disk_profile
from palpate_edge.vision.subpixel import Refiner
from palpate_edge.vision.tracker import Tracker
from palpate_edge.vision.unknown_layout import beads_without_layout

REFERENCE_FRAMES = 15  # the median of the first frames: what moves behind a clear skin fades
FEWEST_MARKERS = 6
HOME_PX = 2.0  # a marker this near to where it was is the same one; less motion is none
NEIGHBOURS = 8  # markers whose motion one is compared with
MAX_APART = (
    0.5  # of the neighbours' motion: a marker farther from it in half of the frames is none of the skin's
)
MAX_SCATTER = 0.25  # of the neighbours' motion: one that bulges or tears says nothing about the marker
MIN_FOUND_SHARE = 0.5  # of the frames
CHUNK = 500  # frames held while going backwards


@dataclass(frozen=True, slots=True)
class Followed:
    """A video followed to its end and back, f frames of n markers.

    first: the picture in which the markers were found; forth_px, back_px (f, n, 2): places on the two ways,
    frame 0 first; forth_found, back_found (f, n); searches: whole-image searches on both ways.
    """

    first: Image
    appearance: Appearance
    forth_px: Array
    forth_found: Mask
    back_px: Array
    back_found: Mask
    searches: int

    @property
    def start_px(self) -> Array:
        """(n, 2): where the markers began."""
        return np.asarray(self.forth_px[0])

    @property
    def home(self) -> Mask:
        """(n,): markers that returned to within `HOME_PX` of where they began."""
        return np.asarray(np.linalg.norm(self.back_px[0] - self.start_px, axis=1) < HOME_PX)

    @property
    def swapped(self) -> Mask:
        """(n,): markers that returned to another one's place."""
        apart = np.linalg.norm(self.back_px[0][:, None] - self.start_px[None], axis=2)
        return np.asarray(apart.argmin(axis=1) != np.arange(len(self.start_px)))

    @property
    def moved(self) -> Mask:
        """(n,): markers whose neighbours moved; for the others a return to the start proves nothing."""
        motion_px, _, _ = self._compared_with_neighbours()
        return np.asarray((motion_px > HOME_PX).any(axis=0))

    @property
    def doubtful(self) -> Mask:
        """(n,): what is probably no marker: it stays where the skin around it moves, or is rarely found."""
        motion_px, apart_px, scatter_px = self._compared_with_neighbours()
        moving = (motion_px > HOME_PX) & (scatter_px < MAX_SCATTER * motion_px)
        alien = moving & (apart_px > MAX_APART * motion_px)
        found_share = 0.5 * (self.forth_found.mean(axis=0) + self.back_found.mean(axis=0))
        return np.asarray((alien.sum(axis=0) > 0.5 * moving.sum(axis=0)) | (found_share < MIN_FOUND_SHARE))

    def _compared_with_neighbours(self) -> tuple[Array, Array, Array]:
        """Return, (f, n) each: the motion of the neighbours, how far the marker is from it, and they are."""
        nearest = np.argsort(distances(self.start_px, self.start_px), axis=1)[:, 1 : NEIGHBOURS + 1]
        motion = self.forth_px - self.start_px
        around = np.stack([np.median(frame[nearest], axis=1) for frame in motion])
        scatter = [
            np.median(np.linalg.norm(frame[nearest] - mean[:, None], axis=2), axis=1)
            for frame, mean in zip(motion, around, strict=True)
        ]
        return np.linalg.norm(around, axis=2), np.linalg.norm(motion - around, axis=2), np.array(scatter)

    @property
    def agreement(self) -> float:
        """Share of all places, of markers found on both ways, that are the same within `HOME_PX`."""
        both = self.forth_found & self.back_found
        apart = np.linalg.norm(self.forth_px - self.back_px, axis=2)
        return float((apart[both] < HOME_PX).mean()) if both.any() else 0.0

    @property
    def lost(self) -> NDArray[np.intp]:
        """(f,): markers not found, on the way forth."""
        return np.asarray((~self.forth_found).sum(axis=1), dtype=np.intp)


def follow_video(
    recording: Recording,
    progress: Callable[[int, int], None] = lambda _done, _total: None,
    diameter_px: float | None = None,
) -> Followed:
    """Find the markers in the first frames and follow them to the end and back.

    Raises DatasetError when the first frames show no markers or a frame cannot be read.
    """
    count = recording.count
    beginning = [recording.read(index)[0] for index in range(min(REFERENCE_FRAMES, count))]
    first = np.median(np.stack(beginning), axis=0).astype(np.uint8)
    reference, appearance = reference_from(first, diameter_px)
    tracker = Tracker(reference)
    shape = (count, len(reference.position_px))
    places, founds = np.zeros((2, *shape, 2)), np.zeros((2, *shape), dtype=np.bool_)
    done = 0
    for way, frames in enumerate((_forwards(recording), _backwards(recording))):
        for index, image in frames:
            beads = tracker.follow(plane(image, appearance))
            places[way, index], founds[way, index] = beads.position_px, beads.found
            done += 1
            progress(done, 2 * count)
    return Followed(
        first,
        appearance,
        places[0],
        founds[0],
        places[1],
        founds[1],
        tracker.counters.searches,
    )


def reference_from(image: Image, diameter_px: float | None = None) -> tuple[Reference, Appearance]:
    """The markers that one picture shows, as a tracker wants them.

    Raises DatasetError when there are none.
    """
    blobs, appearance, size_px = beads_without_layout(image, diameter_px)
    _check_count(len(blobs.strength))
    dark = plane(image, appearance)
    sizes_px = size_px * disk_profile(dark, blobs.position_px, size_px).diameter
    refined = Refiner(sizes_px, spacing(blobs.position_px)).refine(dark, blobs.position_px)
    held = (refined.contrast > 0) & (refined.area > 0)
    held &= ~repeated(refined.position_px, 0.5 * size_px)  # two blobs of one marker
    _check_count(int(held.sum()))
    contrast, area = (part.astype(np.float64) for part in (refined.contrast, refined.area))
    return Reference(refined.position_px[held], sizes_px[held], contrast[held], area[held]), appearance


def _check_count(count: int) -> None:
    if count < FEWEST_MARKERS:
        raise DatasetError(
            f"no beads found: only {count} markers stand out in the first frames; start the video with the "
            "skin untouched and in view, or give --diameter"
        )


def _forwards(recording: Recording) -> Iterator[tuple[int, Image]]:
    for index in range(recording.count):
        yield index, recording.read(index)[0]


def _backwards(recording: Recording) -> Iterator[tuple[int, Image]]:
    """The last frame first; a chunk is read forwards, as videos must be, and held."""
    for start in range((recording.count - 1) // CHUNK * CHUNK, -1, -CHUNK):
        chunk = [recording.read(index)[0] for index in range(start, min(start + CHUNK, recording.count))]
        for offset in range(len(chunk) - 1, -1, -1):
            yield start + offset, chunk.pop()
