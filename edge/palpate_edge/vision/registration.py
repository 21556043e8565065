"""Registration: which blob of an untouched image is which bead of the layout, and how beads look."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from palpate_edge.common.arrays import Array, Image, Indices, Mask
from palpate_edge.common.errors import CalibrationError
from palpate_edge.geometry.camera_pose import fit_pose
from palpate_edge.geometry.lattice_growth import NO_SPOT, HexagonSpots, hexagon_spots
from palpate_edge.geometry.marker_layout import REMEDY, learn_layout
from palpate_edge.geometry.points import distances, repeated, spacing
from palpate_edge.geometry.sensor import CameraPose, Sensor, View, bead_layout_mm
from palpate_edge.vision.appearance import GREY_PREFERENCE, Appearance, appearances, plane
from palpate_edge.vision.assignment import NO_PARTNER, assign
from palpate_edge.vision.blob_detection import Blobs, find_blobs, strongest_other
from palpate_edge.vision.subpixel import refined_places
from palpate_edge.vision.unknown_layout import beads_without_layout

MIN_BEADS_SHARE = 0.9  # of the layout that a reference frame must show
FIT_ROUNDS = 4
MAX_RESIDUAL_DIAMETERS = 0.3  # bead diameters; a blob farther from its fitted place is no bead
MAX_THETA_DEG = 95.0  # polar angle beyond which no bead lies
MAX_SPARE_SHARE = 0.1  # of a learned layout's beads: other spots at a bead's distance, and as strong
STRONG = 0.5  # of the beads' median strength
NEXT_TO_A_BEAD = (0.85, 1.1)  # spacings from the nearest bead to one that was missed; light lies anywhere


@dataclass(frozen=True, slots=True)
class Registration:
    """Beads, camera and appearance as one reference image shows them.

    position_px (n, 2): each bead in the layout's order, projected where it was not seen; seen (n,);
    diameter_px (n,): expected size of each bead; pose: the fitted camera; layout_mm (n, 3) in F and ring_of
    (n,): from sensor.toml, or learned.
    """

    appearance: Appearance
    pose: CameraPose
    position_px: Array
    seen: Mask
    diameter_px: Array
    layout_mm: Array
    ring_of: Indices


def register(image: Image, sensor: Sensor) -> Registration:
    """Recognise the layout of `sensor` in an untouched image, or learn it where sensor.toml gives no rings.

    Every channel is tried with dark and with bright beads. The one that shows most of the layout is taken;
    ties go to the one with the higher contrast. Raises CalibrationError when none shows `MIN_BEADS_SHARE`.
    """
    if not sensor.markers.rings:
        return _learn(image, sensor)
    layout_mm, ring_of = bead_layout_mm(sensor.markers)
    tried = [_recognise(image, sensor, layout_mm, ring_of, looks) for looks in appearances(image)]
    _, best = max(tried, key=lambda pair: pair[0])
    if best is None or best.seen.mean() < MIN_BEADS_SHARE:
        seen = 0 if best is None else int(best.seen.sum())
        raise CalibrationError(
            f"only {seen} of {len(layout_mm)} beads of sensor.toml's layout were recognised in the reference "
            f"frame, at least {MIN_BEADS_SHARE:.0%} are needed: check markers.rings, camera.matrix, "
            "camera.position_mm and the light"
        )
    return best


def register_best(images: Sequence[Image], sensor: Sensor) -> Registration:
    """Register the untouched image that shows most beads, of `images` and their median; ties go to the first.

    Light that changes hides beads in some images only. Where the median shows no more than the first image,
    the others are left out. Raises CalibrationError, that of the first image, when none can be registered.
    """
    best, fault = None, None
    for number, image in enumerate(_first_and_median(images)):
        try:
            tried = register(image, sensor)
        except CalibrationError as error:
            fault = fault or error
            continue
        if best is None or tried.seen.sum() > best.seen.sum():
            best = tried
        elif number == 1:
            break
        if sensor.markers.rings and best.seen.all():
            break
    if best is None:
        assert fault is not None
        raise fault
    return best


def _first_and_median(images: Sequence[Image]) -> Iterator[Image]:
    """Yield the first image, the median of all, and the others."""
    yield images[0]
    if len(images) > 1:
        yield np.asarray(np.median(images, axis=0), np.uint8)
    yield from images[1:]


def bead_diameters_px(sensor: Sensor, view: View, layout_mm: Array) -> Array:
    """Return the diameter (n,) of each bead in the image: focal length times size over distance."""
    distance_mm = np.linalg.norm(layout_mm - view.position_mm, axis=1)
    return np.asarray(sensor.camera.matrix[0] * sensor.markers.diameter_mm / distance_mm)


def _learn(image: Image, sensor: Sensor) -> Registration:
    """Learn a layout from the beads that stand out on the dome.

    Raises CalibrationError when they are too few or not all, do not lie on the dome, or make no layout.
    """
    view, radius_mm = View(sensor.camera), sensor.markers.radius_mm
    apex_mm = np.array([[0.0, 0.0, radius_mm]])
    diameter_px = float(bead_diameters_px(sensor, view, apex_mm)[0])
    beads, best, _ = beads_without_layout(
        image, diameter_px, lambda places: _on_dome(places, view, radius_mm)
    )
    dark = plane(image, best)
    blobs = find_blobs(dark, diameter_px)
    hexagon = _hexagon(blobs, sensor, view)
    if hexagon is not None:
        position_px, seen = hexagon.position_px, hexagon.spot != NO_SPOT
        position_px[seen] = refined_places(dark, position_px[seen], diameter_px)
    else:
        position_px = refined_places(dark, beads.position_px, diameter_px)
        position_px = position_px[~repeated(position_px, 0.5 * diameter_px)]  # two blobs of one bead
        seen = np.ones(len(position_px), dtype=np.bool_)
    _check_declared_count(sensor, len(position_px))
    _check_complete(blobs, position_px)
    layout = learn_layout(sensor.camera, radius_mm, position_px)
    if sensor.markers.layout == "hexagonal" and not layout.hexagonal:
        raise CalibrationError(
            f"the {len(position_px)} beads found in the reference frame make no hexagonal lattice as "
            "sensor.toml's markers.layout has it: correct it, or take reference frames that show all beads"
        )
    sizes_px = bead_diameters_px(sensor, View(sensor.camera, layout.pose), layout.position_mm)
    return Registration(
        best,
        layout.pose,
        position_px[layout.order],
        seen[layout.order],
        sizes_px,
        layout.position_mm,
        layout.ring_of,
    )


def _hexagon(blobs: Blobs, sensor: Sensor, view: View) -> HexagonSpots | None:
    """Return the declared hexagon where the blobs show enough of it; its other beads are predicted."""
    markers = sensor.markers
    if markers.layout != "hexagonal" or not isinstance(markers.count, int):
        return None
    on_dome = blobs.chosen(_on_dome(blobs.position_px, view, markers.radius_mm))
    found = hexagon_spots(on_dome.position_px, on_dome.strength, markers.count)
    return None if found is None or found.seen < MIN_BEADS_SHARE * markers.count else found


def _check_declared_count(sensor: Sensor, found: int) -> None:
    """Refuse a picture that shows fewer beads than sensor.toml declares, or more."""
    count = sensor.markers.count
    if isinstance(count, int) and not MIN_BEADS_SHARE * count <= found <= count:
        raise CalibrationError(
            f"{found} beads were found in the reference frame, sensor.toml's markers.count is {count} (at "
            f"least {MIN_BEADS_SHARE:.0%} are needed, and no more): correct it, or look at palpate-edge "
            "inspect"
        )


def _check_complete(blobs: Blobs, position_px: Array) -> None:
    """Refuse beads (n, 2) with other spots of their strength among them: beads that were not recognised."""
    if len(position_px) < 2 or not len(blobs.strength):
        return
    apart = distances(blobs.position_px, position_px)
    typical = float(np.median(blobs.strength[apart.argmin(axis=0)]))
    nearest = (apart / spacing(position_px)).min(axis=1)
    low, high = NEXT_TO_A_BEAD
    spare = int(((blobs.strength > STRONG * typical) & (nearest > low) & (nearest < high)).sum())
    if spare > MAX_SPARE_SHARE * len(position_px):
        raise CalibrationError(
            f"{len(position_px)} beads were found in the reference frame, and among them {spare} other spots "
            f"that stand out as clearly: the learned layout would be incomplete: {REMEDY}"
        )


def _on_dome(position_px: Array, view: View, radius_mm: float) -> Mask:
    """Return the places (n, 2) whose ray leaves the beads' sphere on the dome's side."""
    height_mm = view.onto_sphere(position_px, radius_mm)[:, 2]
    return np.asarray(height_mm > radius_mm * np.cos(np.radians(MAX_THETA_DEG)))  # False for nan


def _recognise(
    image: Image, sensor: Sensor, layout_mm: Array, ring_of: Indices, appearance: Appearance
) -> tuple[float, Registration | None]:
    """Return score and registration with one appearance.

    The score is the number of beads seen plus a fraction that grows with their contrast over other blobs.
    """
    view = View(sensor.camera)
    expected_px = view.project(layout_mm)
    diameter_px = bead_diameters_px(sensor, view, layout_mm)
    blobs = find_blobs(plane(image, appearance), float(np.median(diameter_px)))
    count = len(layout_mm)
    if len(blobs.strength) < MIN_BEADS_SHARE * count:
        return 0.0, None
    near = _near_layout(blobs, expected_px)
    if not near.any():
        return 0.0, None
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
    seen = seen & (residual_px < MAX_RESIDUAL_DIAMETERS * diameter_px)  # else skin between beads would count
    if not seen.any():
        return 0.0, None
    position_px = np.where(seen[:, None], blobs.position_px[partner], start_px)
    contrast = float(np.median(blobs.strength[partner[seen]]))
    contrast /= strongest_other(blobs.strength, partner[seen])
    if appearance.channel == "grey":
        contrast *= GREY_PREFERENCE
    fitted = View(sensor.camera, pose)
    sizes_px = bead_diameters_px(sensor, fitted, layout_mm)
    registration = Registration(appearance, pose, position_px, seen, sizes_px, layout_mm, ring_of)
    return float(seen.sum()) + 1.0 - 1.0 / (1.0 + contrast), registration


def _near_layout(blobs: Blobs, expected_px: Array) -> Mask:
    """Return which blobs (n,) lie no farther out than the layout can reach."""
    centre = expected_px.mean(axis=0)
    reach = np.linalg.norm(expected_px - centre, axis=1).max()
    return np.asarray(np.linalg.norm(blobs.position_px - centre, axis=1) < 1.25 * reach)


def _align(expected_px: Array, strongest_px: Array) -> Array:
    """Return the expected places (n, 2), shifted and scaled to the cloud of the strongest blobs."""
    from_centre, to_centre = expected_px.mean(axis=0), np.median(strongest_px, axis=0)
    from_radius = np.median(np.linalg.norm(expected_px - from_centre, axis=1))
    to_radius = np.median(np.linalg.norm(strongest_px - to_centre, axis=1))
    scale = float(np.clip(to_radius / from_radius, 0.85, 1.15))
    return np.asarray(to_centre + scale * (expected_px - from_centre))
