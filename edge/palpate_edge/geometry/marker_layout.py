"""Marker layout: rings learned from an untouched sensor's beads, for a sensor.toml without ``markers.rings``.

Two kinds of layout are distinguished:

- hexagonal: one bead in the middle, and 6 k beads at k steps from it along the edges of the Delaunay
  triangles (a TacTip's 127 and 331 pins). A shell of the lattice is used as a ring. Where beads are missing,
  the steps are counted in lattice coordinates.
- concentric: polar angles form steps, and the beads of a step are evenly spaced in azimuth.

Any other layout is divided into shells of any size about the bead nearest to the apex.
A layout is symmetric under rotation about the apex, a ring by its own spacing and a lattice by 60 deg: this
determines the camera's position and tilt. It determines neither the camera's rotation about the apex, nor
focal length and layout width separately: these are taken from the nominal camera.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate_edge.common.arrays import Array, Indices, Mask
from palpate_edge.common.errors import CalibrationError
from palpate_edge.geometry.angles import azimuth, polar_angle, rotation_about_z
from palpate_edge.geometry.camera_pose import fit_pose
from palpate_edge.geometry.hexagonal_lattice import lattice_shells
from palpate_edge.geometry.points import distances, spacing
from palpate_edge.geometry.sensor import Camera, CameraPose, View
from palpate_edge.geometry.triangulation import delaunay

MIN_BEADS, MAX_BEADS = 7, 700
MAX_IRREGULARITY = 0.3  # root mean square logarithm of a bead's spacing over that of the beads around
MAX_RESIDUAL = 0.25  # root mean square distance from the ideal rings, in bead spacings
ROUNDS = 8
SEARCH_STEPS = np.linspace(-0.09, 0.09, 7)  # of the layout's median radius, about its centroid
MIN_GAP_RATIO = 1.5  # of the narrowest gap between rings to the widest step within one
MAX_MISSING = 3  # beads of a ring
MAX_UNEVENNESS = 0.2  # root mean square, in bead spacings of the ring
LONG_EDGE = 1.6  # in typical edges of the bead: spans a missing bead or a dent of the outline
HEXAGONAL = 6
MIN_SHELL = 4
REMEDY = (
    "look at palpate-edge inspect, correct markers.diameter_mm, camera.matrix and the light, or give "
    "markers.rings"
)


@dataclass(frozen=True, slots=True)
class MarkerLayout:
    """A layout of n beads on a sphere: ring by ring from the apex, within a ring by growing azimuth.

    position_mm (n, 3) in F: on ideal rings; ring_of (n,): ring of each; order (n,): index of the bead among
    the given pixels; pose: the fitted camera; hexagonal: whether it is a hexagonal lattice.
    """

    position_mm: Array
    ring_of: Indices
    order: Indices
    pose: CameraPose
    hexagonal: bool


def learn_layout(camera: Camera, radius_mm: float, position_px: Array) -> MarkerLayout:
    """Learn the layout on a sphere of `radius_mm` from its beads at `position_px` (n, 2), in any order.

    camera: nominal. Raises CalibrationError for too few beads, beads that cannot lie on the sphere, or beads
    that make no layout.
    """
    if len(position_px) < MIN_BEADS:
        raise CalibrationError(
            f"only {len(position_px)} beads were found in the reference frame, at least {MIN_BEADS} are "
            "needed: give markers.rings in sensor.toml, or check markers.diameter_mm, camera.matrix and the "
            "light"
        )
    _check_regular(position_px)
    pose = _first_pose(camera, radius_mm, position_px)
    for _ in range(ROUNDS):
        direction = _directions(camera, pose, radius_mm, position_px)
        rings = _rings(direction)
        ring_of = rings.ring_of
        ideal_mm = radius_mm * _symmetrised(direction, ring_of, rings.turns)
        pose = fit_pose(camera, ideal_mm, position_px)
    order = np.lexsort((azimuth(ideal_mm), ring_of)).astype(np.intp)
    _check_residual(View(camera, pose).project(ideal_mm), position_px)
    return MarkerLayout(ideal_mm[order], ring_of[order], order, pose, rings.hexagonal)


def _check_regular(position_px: Array) -> None:
    """Refuse too many beads, and beads scattered at random."""
    if len(position_px) > MAX_BEADS:
        raise CalibrationError(
            f"{len(position_px)} beads were found in the reference frame, at most {MAX_BEADS} can be "
            f"learned: {REMEDY}"
        )
    nearest = spacing(position_px)
    around = np.argsort(distances(position_px, position_px), axis=1)[:, 1 : HEXAGONAL + 1]
    relative = nearest / np.maximum(np.median(nearest[around], axis=1), 1e-9)
    irregularity = float(np.sqrt((np.log(np.maximum(relative, 1e-3)) ** 2).mean()))
    if irregularity > MAX_IRREGULARITY:
        raise CalibrationError(
            f"the {len(position_px)} beads found in the reference frame make no layout: their spacing varies "
            f"by {irregularity:.0%} from bead to bead, at most {MAX_IRREGULARITY:.0%} is allowed: {REMEDY}"
        )


def _check_residual(ideal_px: Array, position_px: Array) -> None:
    """Refuse rings that do not fit the beads (n, 2) that they were learned from."""
    off = np.linalg.norm(ideal_px - position_px, axis=1) / np.median(spacing(position_px))
    residual = float(np.sqrt((off**2).mean()))
    if not residual <= MAX_RESIDUAL:
        raise CalibrationError(
            f"the layout learned from {len(position_px)} beads does not fit them: they are {residual:.2f} "
            f"bead spacings off, at most {MAX_RESIDUAL} is allowed: {REMEDY}"
        )


def _first_pose(camera: Camera, radius_mm: float, position_px: Array) -> CameraPose:
    """Return a first pose: the apex lies near the beads' centroid, where the rings separate best.

    A few missing beads displace the centroid by as much as narrow rings lie apart.
    """
    apex_mm = np.array([[0.0, 0.0, radius_mm]])
    centroid = position_px.mean(axis=0)
    reach = float(np.median(np.linalg.norm(position_px - centroid, axis=1)))
    best, clearest = fit_pose(camera, apex_mm, centroid[None]), 0.0
    _, hexagonal = _shells(_directions(camera, best, radius_mm, position_px))
    if hexagonal:
        return best
    for x in SEARCH_STEPS:
        for y in SEARCH_STEPS:
            pose = fit_pose(camera, apex_mm, (centroid + reach * np.array([x, y]))[None])
            direction = View(camera, pose).onto_sphere(position_px, radius_mm) / radius_mm
            if np.isnan(direction).any():
                continue
            separation = _rings(direction).separation
            if separation > clearest:
                best, clearest = pose, separation
    return best


def _directions(camera: Camera, pose: CameraPose, radius_mm: float, position_px: Array) -> Array:
    """Return the unit vectors (n, 3) in F to the beads.

    Raises CalibrationError for a bead beside the dome.
    """
    direction = View(camera, pose).onto_sphere(position_px, radius_mm) / radius_mm
    if np.isnan(direction).any():
        raise CalibrationError(
            "beads of the reference frame lie beside the dome: check markers.radius_mm, camera.matrix "
            "and camera.position_mm in sensor.toml"
        )
    return np.asarray(direction)


@dataclass(frozen=True, slots=True)
class _Rings:
    """Rings of n beads.

    ring_of (n,): each bead's ring; turns (rings,): rotational symmetry of each ring, k if 1/k of a full turn
    leaves it unchanged; separation: how well the rings separate, 0 for shells; hexagonal: whether they are
    the shells of a lattice.
    """

    ring_of: Indices
    turns: Indices
    separation: float = 0.0
    hexagonal: bool = False


def _rings(direction: Array) -> _Rings:
    shell_of, hexagonal = _shells(direction)
    shells = int(shell_of.max()) + 1
    if hexagonal:
        return _Rings(shell_of, np.full(shells, HEXAGONAL), hexagonal=True)
    return _concentric(direction) or _Rings(shell_of, np.ones(shells, dtype=np.intp))


def _concentric(direction: Array) -> _Rings | None:
    """Return steps of the polar angle as rings, if they separate well and each is evenly spaced."""
    theta = polar_angle(direction)
    phi = azimuth(direction)
    order = np.argsort(theta)
    step = np.diff(theta[order])
    widest_first = np.sort(step)[::-1]
    most = len(theta) // 3
    ratio = widest_first[:most] / np.maximum(widest_first[1 : most + 1], 1e-6)
    last = int(np.argmax(ratio))
    if ratio[last] < MIN_GAP_RATIO:
        return None
    ring_of = np.zeros(len(theta), dtype=np.intp)
    ring_of[order[1:]] = np.cumsum(step >= widest_first[last])
    turns = np.array([_places(phi[ring_of == ring]) for ring in range(ring_of.max() + 1)], dtype=np.intp)
    return _Rings(ring_of, turns, float(ratio[last])) if (turns > 0).all() else None


def _places(phi: Array) -> int:
    """Return the number of evenly spaced places of which a ring's beads fill all, or all but a few.

    It is 0 for beads that are not evenly spaced. A single bead, at the apex, is symmetric under every turn.
    """
    if len(phi) == 1:
        return HEXAGONAL
    for places in range(len(phi), len(phi) + MAX_MISSING + 1):
        turned = np.exp(1j * places * phi)
        off = np.angle(turned / turned.mean()) / (2 * np.pi)  # of a spacing
        if np.sqrt((off**2).mean()) < MAX_UNEVENNESS:
            return places
    return 0


def _shells(direction: Array) -> tuple[Indices, bool]:
    """Return the steps (n,) from the bead nearest to the apex along the edges of Delaunay triangles, and
    whether they are the shells of a hexagonal lattice."""
    theta = polar_angle(direction)
    phi = azimuth(direction)
    flat = 1e3 * theta[:, None] * np.stack([np.cos(phi), np.sin(phi)], axis=1)
    joined = _edges(direction, delaunay(flat))
    in_lattice = lattice_shells(flat, joined)
    if in_lattice is not None:
        return in_lattice, True
    shell_of = np.full(len(theta), -1, dtype=np.intp)
    front = np.arange(len(theta)) == np.argmin(theta)
    shell = 0
    while front.any():
        shell_of[front] = shell
        front = joined[front].any(axis=0) & (shell_of < 0)
        shell += 1
    shell_of[shell_of < 0] = shell  # not joined to the others: outermost
    shell_of = np.minimum(shell_of, _last_shell(shell_of))
    return shell_of, _is_hexagonal(shell_of)


def _edges(direction: Array, triangles: Indices) -> Mask:
    """Return which beads are joined by an edge (n, n); long edges are left out."""
    count = len(direction)
    joined = np.zeros((count, count), dtype=np.bool_)
    for corner in range(3):
        a, b = triangles[:, corner], triangles[:, corner - 1]
        joined[a, b] = joined[b, a] = True
    length = np.where(joined, np.linalg.norm(direction[:, None] - direction[None], axis=2), np.nan)
    alone = ~joined.any(axis=1)
    length[alone] = 0.0
    typical = np.nanmedian(length, axis=1)
    longest = LONG_EDGE * np.maximum(typical[:, None], typical[None])
    return np.asarray(joined & (length <= longest))


def _last_shell(shell_of: Indices) -> int:
    """Return the outermost shell of at least `MIN_SHELL` beads; fewer lie behind a missing bead."""
    return int(np.flatnonzero(np.bincount(shell_of) >= MIN_SHELL).max(initial=0))


def _is_hexagonal(shell_of: Indices) -> bool:
    """Return whether the shells have 1, 6, 12, 18, ... beads, with some of them missing."""
    count = np.bincount(shell_of)
    whole = np.maximum(1, HEXAGONAL * np.arange(len(count)))
    off = np.abs(count - whole)
    return bool(len(count) > 2 and (off <= 1 + whole // 8).all() and off.sum() <= 0.05 * whole.sum())


def _symmetrised(direction: Array, ring_of: Indices, turns: Indices) -> Array:
    """Return unit vectors (n, 3) with each ring averaged over its copies turned about z by 1/turns."""
    apart = np.linalg.norm(direction[:, None] - direction[None], axis=2)
    np.fill_diagonal(apart, np.inf)
    limit = 0.5 * apart.min(axis=1)
    ideal = direction.copy()
    for ring, count in enumerate(turns):
        beads = np.flatnonzero(ring_of == ring)
        if not len(beads):
            continue  # no bead in the middle
        own = direction[beads]
        total = np.zeros_like(own)
        for angle in 2 * np.pi * np.arange(count) / count:
            turn = rotation_about_z(angle)
            distance = np.linalg.norm((own @ turn.T)[:, None] - own[None], axis=2)
            partner = distance.argmin(axis=1)
            near = distance.min(axis=1) < limit[beads]
            total[near] += (own[partner] @ turn)[near]
        ideal[beads] = total / np.linalg.norm(total, axis=1, keepdims=True)
    return ideal
