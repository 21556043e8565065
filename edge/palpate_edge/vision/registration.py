"""The first look at an untouched sensor: what its beads look like, and which blob is which bead."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate_edge.common.arrays import Array, Image
from palpate_edge.common.errors import CalibrationError
from palpate_edge.geometry.camera_pose import fit_pose
from palpate_edge.geometry.marker_layout import learn_layout
from palpate_edge.geometry.sensor import CameraPose, Sensor, View, bead_layout_mm
from palpate_edge.vision.blob_detection import CHANNELS, Appearance, Blobs, find_blobs, plane
from palpate_edge.vision.subpixel import Refiner
from palpate_edge.vision.tracker import NO_PARTNER, assign, spacing
from palpate_edge.vision.unknown_layout import clearness, with_alike

MIN_BEADS_SHARE = 0.9  # of the layout must be seen in a reference frame
FIT_ROUNDS = 4
GREY_PREFERENCE = 2.0  # a colour must stand out so much more: grey is cheaper to decode and has less noise
MAX_RESIDUAL_DIAMETERS = 0.3  # a blob farther from its fitted place is no bead
RIM_THETA_DEG = 95.0  # no bead lies beyond


@dataclass(frozen=True, slots=True)
class FirstSight:
    """What one reference image tells.

    position_px (n, 2): blob of each bead in the layout's order (projected place where it was not seen);
    seen (n,); diameter_px (n,): expected size of each bead; pose: the camera as fitted; layout_mm (n, 3) in F
    and ring_of (n,): as sensor.toml gives them, or as learned.
    """

    appearance: Appearance
    pose: CameraPose
    position_px: Array
    seen: NDArray[np.bool_]
    diameter_px: Array
    layout_mm: Array
    ring_of: NDArray[np.intp]


def first_sight(image: Image, sensor: Sensor) -> FirstSight:
    """Recognise the layout of `sensor` in an untouched image, or learn it where sensor.toml gives no rings.

    Every channel is tried with dark and with bright beads; the one that shows most of the layout, and shows
    it most clearly, is taken. Raises CalibrationError when none shows `MIN_BEADS_SHARE` of it.
    """
    if not sensor.markers.rings:
        return _learn(image, sensor)
    layout_mm, ring_of = bead_layout_mm(sensor.markers)
    sights = [_recognise(image, sensor, layout_mm, ring_of, looks) for looks in _appearances(image)]
    _, best = max(sights, key=lambda pair: pair[0])
    if best is None or best.seen.mean() < MIN_BEADS_SHARE:
        seen = 0 if best is None else int(best.seen.sum())
        raise CalibrationError(
            f"only {seen} of {len(layout_mm)} beads of sensor.toml's layout were recognised in the reference "
            "frame: check markers.rings, the camera's matrix and position, and the light"
        )
    return best


def bead_diameters_px(sensor: Sensor, view: View, layout_mm: Array) -> Array:
    """Diameter (n,) at which each bead appears: focal length times size over distance."""
    distance_mm = np.linalg.norm(layout_mm - view.position_mm, axis=1)
    return np.asarray(sensor.camera.matrix[0] * sensor.markers.diameter_mm / distance_mm)


def _appearances(image: Image) -> list[Appearance]:
    """Every way in which beads may stand out of an image."""
    channels = ["grey"] if image.ndim == 2 else list(CHANNELS)
    return [Appearance(channel, bright) for channel in channels for bright in (False, True)]


def _learn(image: Image, sensor: Sensor) -> FirstSight:
    """Beads of an unknown layout: the blobs on the dome down to the widest gap in strength, in rings.

    Raises CalibrationError when they are too few or do not lie on the dome.
    """
    view, radius_mm = View(sensor.camera), sensor.markers.radius_mm
    apex_mm = np.array([[0.0, 0.0, radius_mm]])
    diameter_px = float(bead_diameters_px(sensor, view, apex_mm)[0])
    best, best_score, best_blobs = Appearance(), 0.0, Blobs(np.zeros((0, 2)), np.zeros(0))
    for appearance in _appearances(image):
        blobs = _on_dome(find_blobs(plane(image, appearance), diameter_px), view, radius_mm)
        score = clearness(blobs) * (GREY_PREFERENCE if appearance.channel == "grey" else 1.0)
        if score > best_score:
            best, best_score, best_blobs = appearance, score, blobs
    dark = plane(image, best)
    beads = with_alike(dark, best_blobs, diameter_px)
    position_px = beads.position_px
    if len(position_px):
        position_px = Refiner(np.full(len(position_px), diameter_px)).refine(dark, position_px).position_px
    layout = learn_layout(sensor.camera, radius_mm, position_px)
    sizes_px = bead_diameters_px(sensor, View(sensor.camera, layout.pose), layout.position_mm)
    seen = np.ones(len(position_px), dtype=np.bool_)
    return FirstSight(
        best, layout.pose, position_px[layout.order], seen, sizes_px, layout.position_mm, layout.ring_of
    )


def _on_dome(blobs: Blobs, view: View, radius_mm: float) -> Blobs:
    """Blobs whose ray leaves the sphere of the beads on the dome's side."""
    if not len(blobs.strength):
        return blobs
    height_mm = view.onto_sphere(blobs.position_px, radius_mm)[:, 2]
    on_dome = height_mm > radius_mm * np.cos(np.radians(RIM_THETA_DEG))  # False for nan
    return Blobs(blobs.position_px[on_dome], blobs.strength[on_dome])


def _recognise(
    image: Image, sensor: Sensor, layout_mm: Array, ring_of: NDArray[np.intp], appearance: Appearance
) -> tuple[float, FirstSight | None]:
    """Score and sight with one appearance; the score is beads seen, then how far they stand out."""
    view = View(sensor.camera)
    expected_px = view.project(layout_mm)
    diameter_px = bead_diameters_px(sensor, view, layout_mm)
    blobs = find_blobs(plane(image, appearance), float(np.median(diameter_px)))
    count = len(layout_mm)
    if len(blobs.strength) < MIN_BEADS_SHARE * count:
        return 0.0, None
    near = _near_layout(blobs, expected_px)
    start_px = _align(expected_px, blobs.position_px[near][:count])
    spacing_px = spacing(expected_px)
    pose = CameraPose()
    for _ in range(FIT_ROUNDS):
        partner = assign(start_px, blobs.position_px, spacing_px)
        seen = partner != NO_PARTNER
        if seen.sum() < 6:
            return 0.0, None
        pose = fit_pose(sensor.camera, layout_mm[seen], blobs.position_px[partner[seen]])
        start_px = View(sensor.camera, pose).project(layout_mm)
    residual_px = np.linalg.norm(blobs.position_px[partner] - start_px, axis=1)
    seen = seen & (residual_px < MAX_RESIDUAL_DIAMETERS * diameter_px)  # else skin between beads would do
    if not seen.any():
        return 0.0, None
    position_px = np.where(seen[:, None], blobs.position_px[partner], start_px)
    clearness = float(np.median(blobs.strength[partner[seen]])) / _noise_strength(blobs, partner[seen])
    if appearance.channel == "grey":
        clearness *= GREY_PREFERENCE
    fitted = View(sensor.camera, pose)
    sizes_px = bead_diameters_px(sensor, fitted, layout_mm)
    sight = FirstSight(appearance, pose, position_px, seen, sizes_px, layout_mm, ring_of)
    return float(seen.sum()) + 1.0 - 1.0 / (1.0 + clearness), sight


def _near_layout(blobs: Blobs, expected_px: Array) -> NDArray[np.bool_]:
    """Blobs (n,) no farther out than the layout can be."""
    centre = expected_px.mean(axis=0)
    reach = np.linalg.norm(expected_px - centre, axis=1).max()
    return np.asarray(np.linalg.norm(blobs.position_px - centre, axis=1) < 1.25 * reach)


def _align(expected_px: Array, strongest_px: Array) -> Array:
    """The expected places shifted and scaled to the cloud of the strongest blobs."""
    from_centre, to_centre = expected_px.mean(axis=0), np.median(strongest_px, axis=0)
    from_radius = np.median(np.linalg.norm(expected_px - from_centre, axis=1))
    to_radius = np.median(np.linalg.norm(strongest_px - to_centre, axis=1))
    scale = float(np.clip(to_radius / from_radius, 0.85, 1.15))
    return np.asarray(to_centre + scale * (expected_px - from_centre))


def _noise_strength(blobs: Blobs, taken: NDArray[np.intp]) -> float:
    """Strength of the strongest blob that is no bead."""
    others = np.delete(blobs.strength, taken)
    return float(others.max()) if len(others) else 1.0
