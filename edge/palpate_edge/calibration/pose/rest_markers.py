"""Markers at rest: which spots of the reference frames are markers, how they look, and how still they are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate_edge.common.arrays import Array, Image, Mask
from palpate_edge.common.errors import CalibrationError
from palpate_edge.datasets.pose_dataset import PoseDataset
from palpate_edge.estimation.pose.pairing import Pairing
from palpate_edge.estimation.pose.spot_detection import SpotDetector
from palpate_edge.geometry.points import spacing
from palpate_edge.vision.appearance import Appearance, plane
from palpate_edge.vision.blob_detection import Blobs, find_blobs
from palpate_edge.vision.neighbourhood import rms
from palpate_edge.vision.subpixel import Refiner
from palpate_edge.vision.unknown_layout import beads_without_layout

FEWEST_MARKERS = 7
MIN_CLEAR_SHARE = 0.9  # of a declared count; the others touch a neighbour or lie in bad light
NEAREST_RANGE = (0.6, 1.6)  # distance of such a marker to the nearest one, in spacings
WEAKEST_SHARE = 0.35  # of the median marker's strength at rest
THRESHOLD_OVER_NOISE = 2.0  # contact threshold over the largest motion between reference frames
THRESHOLD_FLOOR_PX = 0.1
QUIET = 0.1  # spacings; reference frames may be the lightest presses, and differ by more


@dataclass(frozen=True, slots=True)
class RestMarkers:
    """Markers at rest, (n, 2) px, their appearance and size, the weakest strength of a spot that may be one,
    and the motion above which something touches."""

    position_px: Array
    appearance: Appearance
    diameter_px: float
    weakest_strength: float
    contact_threshold_px: float


def find_rest_markers(dataset: PoseDataset) -> RestMarkers:
    """Learn the markers from the first reference frame; the others give their mean place and their noise.

    Raises CalibrationError when there are too few, or fewer than ``markers.count``.
    """
    markers = dataset.sensor.markers
    image = _grey_if_grey(dataset.read(dataset.reference[0]))
    blobs, appearance, diameter_px = _clear_markers(image, dataset)
    dark = plane(image, appearance)
    if markers.count and MIN_CLEAR_SHARE * markers.count <= len(blobs.strength) < markers.count:
        others = find_blobs(dark, diameter_px)
        blobs = _completed(blobs, others, _inside(others.position_px, dataset.mask), markers.count)
    needed = markers.count or FEWEST_MARKERS
    if len(blobs.strength) < needed:
        raise CalibrationError(
            f"{dataset.reference[0]}: {len(blobs.strength)} markers were found, "
            f"{needed} are {'declared' if markers.count else 'needed'}: check markers.diameter_px, "
            "markers.count and mask.png, or use a sharper frame"
        )
    blobs = blobs.strongest(markers.count or len(blobs.strength))
    refiner = Refiner(np.full(len(blobs.strength), diameter_px))
    place_px = refiner.refine(dark, blobs.position_px).position_px
    weakest = WEAKEST_SHARE * float(np.median(find_blobs(dark, diameter_px).strength[: len(place_px)]))
    return _steady(dataset, place_px, appearance, diameter_px, weakest)


def _clear_markers(image: Image, dataset: PoseDataset) -> tuple[Blobs, Appearance, float]:
    """Return the markers of an image, how they look and their diameter, about the declared one if it fits."""
    declared_px = dataset.sensor.markers.diameter_px
    found = Blobs(np.zeros((0, 2)), np.zeros(0)), Appearance(), 0.0
    for diameter_px in dict.fromkeys([declared_px, None]):
        found = beads_without_layout(image, diameter_px, lambda places_px: _inside(places_px, dataset.mask))
        if len(found[0].strength):
            break
    return found


def _completed(clear: Blobs, others: Blobs, allowed: Mask, count: int) -> Blobs:
    """Return `count` markers if there are as many: the clear ones, then the strongest others that fit."""
    place, strength = clear.position_px.tolist(), clear.strength.tolist()
    pitch_px = float(np.median(spacing(clear.position_px)))
    for at_px, strong in zip(others.position_px[allowed], others.strength[allowed], strict=True):
        if len(place) == count:
            break
        nearest = np.linalg.norm(np.array(place) - at_px, axis=1).min() / pitch_px
        if NEAREST_RANGE[0] < nearest < NEAREST_RANGE[1]:
            place.append(at_px.tolist())
            strength.append(float(strong))
    return Blobs(np.array(place), np.array(strength))


def _grey_if_grey(image: Image) -> Image:
    """Return an image without colours as one channel, so that no other channel is searched."""
    is_grey = image.ndim == 3 and bool((image == image[..., :1]).all())
    return np.ascontiguousarray(image[..., 0]) if is_grey else image


def _inside(places_px: Array, mask: Image | None) -> Mask:
    """Return which places (n, 2) the mask allows, all without one."""
    if mask is None:
        return np.ones(len(places_px), dtype=np.bool_)
    column, row = np.clip(np.rint(places_px).astype(np.intp), 0, np.array(mask.shape[::-1]) - 1).T
    return np.asarray(mask[row, column] > 0)


def _steady(
    dataset: PoseDataset, place_px: Array, appearance: Appearance, diameter_px: float, weakest: float
) -> RestMarkers:
    """The markers' median places over the reference frames that touch as little as the first one, and twice
    the largest motion about them."""
    detector = SpotDetector(diameter_px, weakest, len(place_px))
    pairing = Pairing(place_px)
    places = [place_px]
    for path in dataset.reference:
        paired = pairing.match(place_px, detector.find(plane(dataset.read(path), appearance)))
        if (
            paired.found.any()
            and rms((paired.position_px - place_px)[paired.found]) < QUIET * pairing.pitch_px
        ):
            places.append(np.where(paired.found[:, None], paired.position_px, place_px))
    rest_px = np.asarray(np.median(places, axis=0))
    noise_px = max(rms(place - rest_px) for place in places)
    return RestMarkers(
        rest_px, appearance, diameter_px, weakest, max(THRESHOLD_FLOOR_PX, THRESHOLD_OVER_NOISE * noise_px)
    )
