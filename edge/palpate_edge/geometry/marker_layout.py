"""Rings learned from where an untouched sensor shows its beads, for a sensor.toml without ``markers.rings``.

Two kinds of layout are told apart:

- hexagonal: one bead in the middle, and 6 k beads at k steps from it along the edges of the Delaunay
  triangles (a TacTip's 127 and 331 pins). A shell of the lattice then stands for a ring.
- concentric: polar angles gather in steps, and the beads of a step are evenly spaced in azimuth.

Any other layout is taken in shells about the bead nearest to the apex, of whatever size they are.
A layout looks the same when it is turned about the apex, a ring by its own spacing and a lattice by 60 deg:
that tells where the camera is. How far the camera is turned about the apex, and a longer focal length from a
wider layout, it does not tell: there the nominal camera stands.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate_edge.common.arrays import Array, Indices
from palpate_edge.common.errors import CalibrationError
from palpate_edge.geometry.camera_pose import fit_pose
from palpate_edge.geometry.sensor import Camera, CameraPose, View
from palpate_edge.geometry.triangulation import delaunay

MIN_BEADS = 7
ROUNDS = 8
SEARCH_STEPS = np.linspace(-0.09, 0.09, 7)  # of the layout's median radius, about its centroid
MIN_GAP_RATIO = 1.5  # of the narrowest gap between rings to the widest step within one
MAX_MISSING = 3  # beads of a ring
MAX_UNEVENNESS = 0.2  # root mean square, in bead spacings of the ring
LONG_EDGE = 1.6  # in typical edges of the bead: spans a missing bead or a dent of the outline
HEXAGONAL = 6
MIN_SHELL = 4


@dataclass(frozen=True, slots=True)
class MarkerLayout:
    """n beads on a sphere, ring by ring from the apex, in each by growing azimuth.

    position_mm (n, 3) in F: on ideal rings; ring_of (n,): ring of each; order (n,): which of the given
    pixels is the bead; pose: the camera that sees the layout there.
    """

    position_mm: Array
    ring_of: Indices
    order: Indices
    pose: CameraPose


def learn_layout(camera: Camera, radius_mm: float, position_px: Array) -> MarkerLayout:
    """The layout on a sphere of `radius_mm` that `camera`, not quite where it should be, sees at
    `position_px` (n, 2), in any order.

    Raises CalibrationError for too few beads or beads that cannot lie on the sphere.
    """
    if len(position_px) < MIN_BEADS:
        raise CalibrationError(
            f"only {len(position_px)} beads were found in the reference frame: give markers.rings in "
            "sensor.toml, or check markers.diameter_mm, camera.matrix and the light"
        )
    pose = _first_pose(camera, radius_mm, position_px)
    for _ in range(ROUNDS):
        direction = _directions(camera, pose, radius_mm, position_px)
        ring_of, turns, _ = _rings(direction)
        ideal_mm = radius_mm * _symmetrised(direction, ring_of, turns)
        pose = fit_pose(camera, ideal_mm, position_px)
    azimuth = np.arctan2(ideal_mm[:, 1], ideal_mm[:, 0])
    order = np.lexsort((azimuth, ring_of)).astype(np.intp)
    return MarkerLayout(ideal_mm[order], ring_of[order], order, pose)


def _first_pose(camera: Camera, radius_mm: float, position_px: Array) -> CameraPose:
    """The camera that sees the apex near the beads' centroid, where the rings are clearest: a few missing
    beads move the centroid by as much as narrow rings are apart."""
    apex_mm = np.array([[0.0, 0.0, radius_mm]])
    centroid = position_px.mean(axis=0)
    reach = float(np.median(np.linalg.norm(position_px - centroid, axis=1)))
    best, clearest = fit_pose(camera, apex_mm, centroid[None]), 0.0
    if _is_hexagonal(_shells(_directions(camera, best, radius_mm, position_px))):
        return best
    for x in SEARCH_STEPS:
        for y in SEARCH_STEPS:
            pose = fit_pose(camera, apex_mm, (centroid + reach * np.array([x, y]))[None])
            direction = View(camera, pose).onto_sphere(position_px, radius_mm) / radius_mm
            if np.isnan(direction).any():
                continue
            _, _, clear = _rings(direction)
            if clear > clearest:
                best, clearest = pose, clear
    return best


def _directions(camera: Camera, pose: CameraPose, radius_mm: float, position_px: Array) -> Array:
    """Unit vectors (n, 3) in F to the beads. Raises CalibrationError when one is beside the dome."""
    direction = View(camera, pose).onto_sphere(position_px, radius_mm) / radius_mm
    if np.isnan(direction).any():
        raise CalibrationError(
            "beads of the reference frame lie beside the dome: check markers.radius_mm, camera.matrix "
            "and camera.position_mm in sensor.toml"
        )
    return np.asarray(direction)


def _rings(direction: Array) -> tuple[Indices, Indices, float]:
    """Ring of each bead (n,), by which part of a full turn each ring looks the same, (rings,), and how
    clearly rings of one polar angle stand apart, 0 for shells."""
    shell_of = _shells(direction)
    if _is_hexagonal(shell_of):
        return shell_of, np.full(shell_of.max() + 1, HEXAGONAL), 0.0
    concentric = _concentric(direction)
    if concentric is not None:
        return concentric
    return shell_of, np.ones(shell_of.max() + 1, dtype=np.intp), 0.0


def _concentric(direction: Array) -> tuple[Indices, Indices, float] | None:
    """Steps of the polar angle as rings, when they are clear and each is evenly spaced."""
    theta = _polar_angle(direction)
    azimuth = np.arctan2(direction[:, 1], direction[:, 0])
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
    turns = np.array([_places(azimuth[ring_of == ring]) for ring in range(ring_of.max() + 1)], dtype=np.intp)
    return (ring_of, turns, float(ratio[last])) if (turns > 0).all() else None


def _places(azimuth: Array) -> int:
    """Of how many evenly spaced places a ring's beads fill all, or all but a few; 0 when they are not even.

    A bead alone, at the apex, looks the same at every turn.
    """
    if len(azimuth) == 1:
        return HEXAGONAL
    for places in range(len(azimuth), len(azimuth) + MAX_MISSING + 1):
        turned = np.exp(1j * places * azimuth)
        off = np.angle(turned / turned.mean()) / (2 * np.pi)  # of a spacing
        if np.sqrt((off**2).mean()) < MAX_UNEVENNESS:
            return places
    return 0


def _shells(direction: Array) -> Indices:
    """Steps (n,) from the bead nearest to the apex along the edges of Delaunay triangles."""
    theta = _polar_angle(direction)
    azimuth = np.arctan2(direction[:, 1], direction[:, 0])
    flat = 1e3 * theta[:, None] * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
    joined = _edges(direction, delaunay(flat))
    shell_of = np.full(len(theta), -1, dtype=np.intp)
    front = np.arange(len(theta)) == np.argmin(theta)
    shell = 0
    while front.any():
        shell_of[front] = shell
        front = joined[front].any(axis=0) & (shell_of < 0)
        shell += 1
    shell_of[shell_of < 0] = shell  # cut off from the others: outermost
    return np.asarray(np.minimum(shell_of, _last_shell(shell_of)))


def _edges(direction: Array, triangles: Indices) -> NDArray[np.bool_]:
    """(n, n) which beads are joined, long edges left out."""
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
    """The outermost shell of a few beads at least: fewer only seem farther out, past a missing one."""
    return int(np.flatnonzero(np.bincount(shell_of) >= MIN_SHELL).max(initial=0))


def _is_hexagonal(shell_of: Indices) -> bool:
    """Shells of 1, 6, 12, 18, ... beads, some of them missing."""
    count = np.bincount(shell_of)
    whole = np.maximum(1, HEXAGONAL * np.arange(len(count)))
    off = np.abs(count - whole)
    return bool(len(count) > 2 and (off <= 1 + whole // 8).all() and off.sum() <= 0.05 * whole.sum())


def _symmetrised(direction: Array, ring_of: Indices, turns: Indices) -> Array:
    """Unit vectors (n, 3) with each ring the mean of its own copies turned about z by 1/turns."""
    apart = np.linalg.norm(direction[:, None] - direction[None], axis=2)
    np.fill_diagonal(apart, np.inf)
    limit = 0.5 * apart.min(axis=1)
    ideal = direction.copy()
    for ring, count in enumerate(turns):
        beads = np.flatnonzero(ring_of == ring)
        own = direction[beads]
        total = np.zeros_like(own)
        for angle in 2 * np.pi * np.arange(count) / count:
            cos, sin = np.cos(angle), np.sin(angle)
            turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
            distance = np.linalg.norm((own @ turn.T)[:, None] - own[None], axis=2)
            partner = distance.argmin(axis=1)
            near = distance.min(axis=1) < limit[beads]
            total[near] += (own[partner] @ turn)[near]
        ideal[beads] = total / np.linalg.norm(total, axis=1, keepdims=True)
    return ideal


def _polar_angle(direction: Array) -> Array:
    return np.asarray(np.arctan2(np.hypot(direction[:, 0], direction[:, 1]), direction[:, 2]))
