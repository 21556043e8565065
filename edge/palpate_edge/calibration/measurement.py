"""A press dataset as the camera saw it: the sensor's rest, and the beads of every press."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec
import numpy as np

from palpate_edge.calibration.fit_choice import choose_fit
from palpate_edge.calibration.reference_frames import compare_references
from palpate_edge.common.arrays import Array, Image
from palpate_edge.common.errors import CalibrationError
from palpate_edge.datasets.images import read_sized_image
from palpate_edge.datasets.pose_dataset import PosePress
from palpate_edge.datasets.press_dataset import Press, PressDataset
from palpate_edge.estimation.calibration import DroppedPresses
from palpate_edge.estimation.displacement_field import DisplacementReader
from palpate_edge.estimation.field_smoothing.typical_fields import TypicalFields
from palpate_edge.estimation.plausibility import MAX_DOUBT
from palpate_edge.estimation.skin_motion import MAX_ROUGHNESS, SkinMotion
from palpate_edge.geometry.points import repeated, spacing
from palpate_edge.geometry.sensor import View
from palpate_edge.vision.appearance import plane, unlit_grey
from palpate_edge.vision.beads import Beads, Reference
from palpate_edge.vision.registration import Registration, register_best
from palpate_edge.vision.shading import Shading, skin_slope
from palpate_edge.vision.subpixel import Refined, Refiner
from palpate_edge.vision.tracker import Tracker

# Contact threshold over the motion that most frames without contact stay below, and over the largest: that is
# of the worst light, which the noise of its beads mostly tells (skin_motion.Motion).
OVER_MOST, MOST, OVER_LARGEST = 2.0, 0.75, 1.25
THRESHOLD_FLOOR_PX = 0.025
STIFFEST_PERCENTILE = 5  # of the skin's motion a newton, of the lightest third of the presses
LIGHT_SHARE = 1 / 3
CLEAR = 0.8  # of a bead's median contrast over the reference frames
OUTLYING = 2.0  # median distances of a bead from its place; farther places count less
NAMED_FRAMES = 3  # of those dropped for one reason
MIN_UNTOUCHED, MAX_JUDGED = 4, 16  # frames by which it is chosen how places are measured
INEXACT_NOISE_PX = 0.05  # of an exact bead; with less noise displacements as measured are as good as smoothed
NOT_ONE_SKIN = "the beads do not move as one skin (hidden, or taken for their neighbours)"
DOUBTFUL = "beads and blobs are left over side by side (the labels may be one row off)"
NOT_MOVED = "the skin moves less than the contact threshold"


@dataclass(frozen=True, slots=True)
class Measured:
    """Measurement of a dataset's reference frames and presses.

    view: the camera as fitted; touches: presses that moved the skin as one skin moves, with their beads;
    threshold_px: skin motion above which something touches; threshold_N: the normal force that makes it where
    the dome is stiffest, None where no press's force is known; dropped: the frames left out, by reason;
    bead_noise_px: standard deviation of an exact bead's place along an axis; touched_references,
    moved_references: names of reference frames that differ from the others.
    """

    registration: Registration
    reference: Reference
    view: View
    touches: tuple[tuple[Press, Beads], ...]
    threshold_px: float
    threshold_N: float | None
    dropped: tuple[DroppedPresses, ...] = ()
    bead_noise_px: float = 0.0
    touched_references: tuple[str, ...] = ()
    moved_references: tuple[str, ...] = ()

    @property
    def is_inexact(self) -> bool:
        """True in hard light: the beads' places are too noisy to be used as measured."""
        return self.bead_noise_px >= INEXACT_NOISE_PX

    def reader(self, radius_mm: float, typical: TypicalFields | None = None) -> DisplacementReader:
        """Return the reader of these beads' displacement; radius_mm: of the sphere that they are on."""
        rest_px = self.reference.position_px
        return DisplacementReader(rest_px, self.view, radius_mm, self.bead_noise_px, typical)


def measure(
    dataset: PressDataset, presses: tuple[Press, ...], progress: Callable[[int], None] = lambda _done: None
) -> Measured:
    """Look at the reference frames and at `presses`; `progress` counts images.

    Raises CalibrationError where the reference frames do not show the layout, DatasetError for bad files.
    """
    images = []
    for number, path in enumerate(dataset.reference, start=1):
        images.append(_read(dataset, path))
        progress(number)
    registration = register_best(images, dataset.sensor)
    reference, rest = _measure_reference(images, registration, *_judged(dataset, presses, images))
    faults = compare_references(np.array([beads.position_px for beads in rest]))
    names = [path.name for path in dataset.reference]
    tracker, skin = Tracker(reference), SkinMotion(reference)
    pressed: list[tuple[Press, Beads]] = []
    torn: list[Press] = []
    doubtful: list[Press] = []
    for number, press in enumerate(presses, start=1):
        tracker.reset()  # presses of a dataset are no video
        image = _read(dataset, dataset.path(press))
        beads = tracker.follow_image(image, registration.appearance)
        # The estimator refuses such frames; here they would teach nonsense.
        if skin.measure(beads).roughness > MAX_ROUGHNESS:
            torn.append(press)
        elif beads.doubt > MAX_DOUBT:
            doubtful.append(press)
        elif not press.touches:
            rest.append(beads)
        else:
            pressed.append((press, beads))
        progress(len(dataset.reference) + number)
    if reference.fit_sigma_px is not None:
        typical = typical_noise([beads for _, beads in pressed])
        reference = replace(reference, fit_sigma_px=reference.fit_sigma_px * typical)
        rest = [with_less_noise(beads, typical) for beads in rest]
        pressed = [(press, with_less_noise(beads, typical)) for press, beads in pressed]
    reference = replace(reference, position_px=rest_places(rest, reference.position_px))
    skin = SkinMotion(reference)
    rest_motion = [_motion_px(skin, beads) for beads in rest]
    touches, motion_px = pressed, [_motion_px(skin, beads) for _, beads in pressed]
    threshold_px = threshold_above(np.array(rest_motion))
    faint = [
        press for (press, _), moved_px in zip(touches, motion_px, strict=True) if moved_px <= threshold_px
    ]
    return Measured(
        registration,
        reference,
        View(dataset.sensor.camera, registration.pose),
        tuple(touch for touch, moved_px in zip(touches, motion_px, strict=True) if moved_px > threshold_px),
        threshold_px,
        force_that_moves(
            threshold_px, np.array([press.normal_force_N or 0.0 for press, _ in touches]), np.array(motion_px)
        ),
        (
            *dropped_presses(NOT_ONE_SKIN, torn),
            *dropped_presses(DOUBTFUL, doubtful),
            *dropped_presses(NOT_MOVED, faint),
        ),
        bead_noise_px(rest, reference.position_px),
        tuple(names[index] for index in faults.touched),
        tuple(names[index] for index in faults.moved),
    )


def _motion_px(skin: SkinMotion, beads: Beads) -> float:
    """Return the skin's motion over its Motion.noise."""
    moved = skin.measure(beads)
    return moved.size_px / moved.noise


def rest_places(rest: Sequence[Beads], expected_px: Array) -> Array:
    """Return the beads' places (n, 2) on the untouched sensor: the means over its frames.

    Each frame counts by its noise, and places far from the median count less (Huber's estimate). A bead that
    no frame shows stays at `expected_px` (n, 2).
    """
    found = np.array([beads.found for beads in rest])
    noise = np.array([np.ones(len(expected_px)) if b.noise is None else b.noise for b in rest])
    places = np.where(found[..., None], np.array([beads.position_px for beads in rest]), np.nan)
    seen = found.any(axis=0)
    median = expected_px.copy()
    median[seen] = np.nanmedian(places[:, seen], axis=0)
    off = np.linalg.norm(places - median, axis=2) / noise
    limit = OUTLYING * np.median(off[found]) if found.any() else 0.0
    weight = np.where(found, np.minimum(1.0, limit / np.maximum(off, 1e-9)) / noise**2, 0.0)
    total = np.maximum(weight.sum(axis=0), 1e-12)
    mean = (np.where(found[..., None], places - median, 0.0) * weight[..., None]).sum(axis=0) / total[:, None]
    return np.asarray(median + mean)


def typical_noise(frames: Sequence[Beads]) -> float:
    """Return the median of Beads.noise over all found beads of the frames, 1 without frames.

    Reference frames may be better pictures than the sensor's others, for example not compressed.
    """
    each = [
        np.ones(beads.found_count) if beads.noise is None else beads.noise[beads.found] for beads in frames
    ]
    return float(np.median(np.concatenate(each))) if each else 1.0


def with_less_noise(beads: Beads, typical: float) -> Beads:
    """Return the beads with their noise over the `typical` one."""
    if beads.noise is None:
        return beads
    noise = np.maximum(1.0, beads.noise / typical).astype(np.float32)
    return msgspec.structs.replace(beads, noise=noise if (noise > 1.0).any() else None)


def bead_noise_px(rest: Sequence[Beads], place_px: Array) -> float:
    """Return the standard deviation along an axis of an exact bead's place, px: the median over the frames of
    the untouched sensor, whose beads stand at `place_px` (n, 2)."""
    squares = []
    for beads in rest:
        if beads.found_count:
            off_px = beads.position_px - place_px
            squares.append(float(np.vecdot(off_px, off_px) @ beads.weight) / beads.found_count)
    return float(np.sqrt(np.median(squares) / 2)) if squares else 0.0


def dropped_presses(reason: str, presses: Sequence[Press | PosePress]) -> tuple[DroppedPresses, ...]:
    """Return the presses that were left out for one reason as one entry; none where there are none."""
    if not presses:
        return ()
    names = tuple(press.frame for press in presses[:NAMED_FRAMES])
    return (DroppedPresses(reason, len(presses), names),)


def threshold_above(rest_px: Array) -> float:
    """Return the contact threshold, px, from the skin motions (n,) of frames without contact, px; each over
    its Motion.noise."""
    most_px, largest_px = float(np.quantile(rest_px, MOST)), float(rest_px.max())
    return max(THRESHOLD_FLOOR_PX, OVER_MOST * most_px, OVER_LARGEST * largest_px)


def force_that_moves(size_px: float, force_N: Array, motion_px: Array) -> float | None:
    """The normal force that moves the skin by `size_px` where the dome is stiffest, from presses of force_N
    (n,) that moved it by motion_px (n,): motion is proportional to a light force. None without any force."""
    pressed = force_N > 0
    if not pressed.any():
        return None
    force_N, motion_px = force_N[pressed], motion_px[pressed]
    light = force_N <= np.quantile(force_N, LIGHT_SHARE)
    return float(size_px / np.percentile(motion_px[light] / force_N[light], STIFFEST_PERCENTILE))


def _read(dataset: PressDataset, path: Path) -> Image:
    """Read an image; its size has to be that of the dataset's description."""
    return read_sized_image(path, dataset.sensor.image_size_px, error=CalibrationError)


def _judged(
    dataset: PressDataset, presses: Sequence[Press], references: list[Image]
) -> tuple[list[Image], list[Image]]:
    """Return the frames without contact, and others, by which it is chosen how places are measured."""
    untouched = [press for press in presses if not press.touches]
    enough = len(untouched) >= MIN_UNTOUCHED
    chosen = untouched if enough else presses
    step = max(1, -(-len(chosen) // MAX_JUDGED))
    images = [_read(dataset, dataset.path(press)) for press in chosen[::step]]
    return (images, []) if enough else (references, images)


def _measure_reference(
    images: list[Image], registration: Registration, untouched: list[Image], others: list[Image]
) -> tuple[Reference, list[Beads]]:
    """Median looks of each bead over the reference frames, and the beads of each frame.

    untouched, others: see fit_choice.choose_fit.
    """
    spacing_px = spacing(registration.position_px)
    refiner = Refiner(registration.diameter_px, spacing_px)
    planes = [plane(image, registration.appearance) for image in images]
    rough = [refiner.refine(dark, registration.position_px) for dark in planes]
    slopes = [
        skin_slope(dark, beads.position_px, registration.diameter_px, spacing_px)
        / np.maximum(beads.contrast, 1.0)[:, None]
        for dark, beads in zip(planes, rough, strict=True)
    ]
    shading = Shading(np.asarray(np.median(slopes, axis=0)), unlit_grey(registration.appearance))
    refiner = Refiner(registration.diameter_px, spacing_px, shading)
    frames = [refiner.refine(dark, registration.position_px) for dark in planes]
    reference = choose_fit(
        _reference(registration, frames, shading), registration.appearance, images, untouched, others
    )
    tracker = Tracker(reference)
    rest = []
    for image in images:
        tracker.reset()
        rest.append(tracker.follow_image(image, registration.appearance))
    return reference, rest


def _reference(registration: Registration, frames: list[Refined], shading: Shading) -> Reference:
    """Return the medians over the frames; of the places, over the frames that show the bead clearly.

    A bead that the first frame does not show stands where the layout has it and is given the others' looks,
    so that it counts as lost until a bead appears there.
    """
    contrast = np.median([frame.contrast for frame in frames], axis=0)
    area = np.median([frame.area for frame in frames], axis=0)
    unevenness = np.median([frame.unevenness for frame in frames], axis=0)
    measured = np.asarray(registration.seen & (contrast > 0) & (area > 0))
    if not measured.any():
        raise CalibrationError("no bead lies wholly inside the reference frames: check camera.matrix")
    place = _median_place(frames, contrast)
    measured &= ~repeated(place, 0.5 * float(registration.diameter_px.min()))  # refined onto another bead
    place = np.where(measured[:, None], place, registration.position_px)
    contrast, area, unevenness = (
        np.where(measured, value, np.median(value[measured])) for value in (contrast, area, unevenness)
    )
    shading = Shading(np.where(measured[:, None], shading.slope, 0.0), shading.unlit)
    return Reference(place, registration.diameter_px, contrast, area, shading, unevenness)


def _median_place(frames: list[Refined], contrast: Array) -> Array:
    """Return the median places (n, 2) over the frames that show the bead with `CLEAR` of its contrast (n,).

    Room light washes beads out in some frames; half of the frames or more show each clearly.
    """
    places = np.array([frame.position_px for frame in frames])
    clear = np.array([frame.contrast for frame in frames]) >= np.minimum(CLEAR * contrast, contrast)
    return np.asarray(np.nanmedian(np.where(clear[..., None], places, np.nan), axis=0))
