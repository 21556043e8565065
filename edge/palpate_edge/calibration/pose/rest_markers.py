"""Markers at rest: which spots of the reference frames are markers, how they look, and how still they are."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from palpate_edge.common.arrays import Array, Image, Mask, Plane
from palpate_edge.common.errors import CalibrationError
from palpate_edge.datasets.pose_dataset import PoseDataset
from palpate_edge.estimation.pose.pairing import Pairing
from palpate_edge.estimation.pose.spot_detection import SpotDetector
from palpate_edge.geometry.lattice_growth import NO_SPOT, hexagon_spots
from palpate_edge.geometry.picture_sensor import PictureMarkers
from palpate_edge.geometry.points import spacing
from palpate_edge.vision.appearance import Appearance, plane
from palpate_edge.vision.blob_detection import Blobs, find_blobs
from palpate_edge.vision.neighbourhood import rms
from palpate_edge.vision.subpixel import refined_places
from palpate_edge.vision.unknown_layout import beads_without_layout

FEWEST_MARKERS = 7
MIN_CLEAR_SHARE = 0.9  # of a declared count; the others touch a neighbour or lie in bad light
NEAREST_RANGE = (0.6, 1.6)  # distance of such a marker to the nearest one, in spacings
WEAKEST_SHARE = 0.35  # of the median marker's strength at rest
THRESHOLD_OVER_NOISE = 2.0  # contact threshold over the largest motion between reference frames
THRESHOLD_FLOOR_PX = 0.1
WAY_OUT = "check markers.diameter_px, markers.count and mask.png, or use a sharper frame"
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
    path = dataset.reference[0]
    image = _grey_if_grey(dataset.read(path))
    clear, appearance, diameter_px = _clear_markers(image, dataset)
    dark = plane(image, appearance)
    spots = find_blobs(dark, diameter_px) if len(clear.strength) else clear
    inside = spots.chosen(_inside(spots.position_px, dataset.mask))
    if dataset.sensor.markers.layout == "hexagonal":
        place_px = _hexagon(dark, inside, dataset.sensor.markers, diameter_px, path)
    else:
        place_px = _any_layout(dark, clear, inside, dataset.sensor.markers, diameter_px, path)
    weakest = WEAKEST_SHARE * float(np.median(spots.strength[: len(place_px)]))
    return _steady(dataset, place_px, appearance, diameter_px, weakest)


def _any_layout(
    dark: Plane, clear: Blobs, others: Blobs, markers: PictureMarkers, diameter_px: float, path: Path
) -> Array:
    """Return the places (n, 2) of the clear markers, completed by the others to the declared count."""
    if markers.count and MIN_CLEAR_SHARE * markers.count <= len(clear.strength) < markers.count:
        clear = _completed(clear, others, markers.count)
    needed = markers.count or FEWEST_MARKERS
    if len(clear.strength) < needed:
        raise CalibrationError(
            f"{path}: {len(clear.strength)} markers were found, "
            f"{needed} are {'declared' if markers.count else 'needed'}: {WAY_OUT}"
        )
    return refined_places(dark, clear.position_px[: markers.count], diameter_px)


def _hexagon(dark: Plane, spots: Blobs, markers: PictureMarkers, diameter_px: float, path: Path) -> Array:
    """Return the places (n, 2) of a hexagon's markers; those that are not seen are where the others show."""
    assert markers.count is not None
    found = hexagon_spots(spots.position_px, spots.strength, markers.count)
    seen = 0 if found is None else found.seen
    if found is None or seen < MIN_CLEAR_SHARE * markers.count:
        raise CalibrationError(
            f"{path}: {seen} of the {markers.count} markers of a hexagonal layout were found, at least "
            f"{MIN_CLEAR_SHARE:.0%} are needed: {WAY_OUT}, or leave markers.layout out"
        )
    place_px, is_seen = found.position_px, found.spot != NO_SPOT
    place_px[is_seen] = refined_places(dark, place_px[is_seen], diameter_px)
    return place_px


def _clear_markers(image: Image, dataset: PoseDataset) -> tuple[Blobs, Appearance, float]:
    """Return the markers of an image, how they look and their diameter, about the declared one if it fits."""
    declared_px = dataset.sensor.markers.diameter_px
    found = Blobs(np.zeros((0, 2)), np.zeros(0)), Appearance(), 0.0
    for diameter_px in dict.fromkeys([declared_px, None]):
        found = beads_without_layout(image, diameter_px, lambda places_px: _inside(places_px, dataset.mask))
        if len(found[0].strength):
            break
    return found


def _completed(clear: Blobs, others: Blobs, count: int) -> Blobs:
    """Return `count` markers if there are as many: the clear ones, then the strongest others that fit."""
    place, strength = clear.position_px.tolist(), clear.strength.tolist()
    pitch_px = float(np.median(spacing(clear.position_px)))
    for at_px, strong in zip(others.position_px, others.strength, strict=True):
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
