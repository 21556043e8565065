"""Library of displacement fields: interpolates solved presses of the dome, without finite elements.

`palpate-host simulate dome library` writes the file (format: :mod:`make_library`); reading needs numpy only.
Between the solved presses, it interpolates
- along contact angle and depth by cubic polynomials of displacement / depth at a fixed fraction of the
  largest depth; below the smallest solved depth the field is proportional to the depth;
- along the slide by the solved slides towards the base, away from it, towards +y and (mirrored) towards -y:
  odd and even parts are weighted so that small slides superpose and large ones keep Coulomb's limit;
- a twist of the probe (:mod:`twist_library`) is weighted with the slide as a third direction of it;
- over the bead sphere by trigonometric polynomials on each ring and cubic polynomials across the rings.

Interpolation error against solutions on the same mesh at random positions, depths and slides (40 presses, 150
points each), rms over points as a fraction of the depth: plate 0.4 % on average (95th percentile 0.8 %),
sphere5 0.8 % (2.3 %). Force: plate 1.9 % (5 %), sphere5 4 % (12 % for small forces), because a 5 mm sphere is
not much larger than an element. Mesh error at 2 mm depth against a finer mesh: 3.6 um (plate) and 9 um
(sphere5), 1.5 % and 4 % of the force.
"""

from __future__ import annotations

import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate_edge.common.arrays import Array
from palpate_edge.common.errors import ConfigError
from palpate_edge.geometry.angles import polar_angle
from palpate_twin.dome import field_grid as grid
from palpate_twin.dome.polynomial import lagrange
from palpate_twin.dome.probe import Probe
from palpate_twin.dome.twist_library import SHIPPED as SHIPPED_TWISTS
from palpate_twin.dome.twist_library import TwistLibrary, load_twists

SHIPPED = Path(__file__).with_name("fields.npz")
REFRESH = "refresh it with palpate-host simulate dome library"
MAKE_TWISTS = "make them with palpate-host simulate dome twists"
MIRROR = np.array([1.0, -1.0, 1.0])
TOLERANCE = 1e-6  # relative: the file contains float32


@dataclass(frozen=True, slots=True)
class Field:
    """Displacement and force of a press, in frame F.

    displacement_mm: (q, 3) of the requested points; force_per_mu_mm2: (3,) on the dome, times the shear
    modulus in N/mm^2 gives N; torsion_per_mu_mm3: moment of that force about the inward normal through the
    point of first touch, None without a twist library.
    """

    displacement_mm: Array
    force_per_mu_mm2: Array
    torsion_per_mu_mm3: float | None = None


@dataclass(frozen=True, slots=True)
class SlideAndTwist:
    """Slide and twist of the probe after the press, both over the largest of the grid.

    size: of both together, 0 to 1; along (towards the base), across (along increasing azimuth), turn: their
    parts of it, a unit vector. Slide and twist share the friction as two directions of a slide do.
    """

    size: float
    along: float
    across: float
    turn: float


@dataclass(frozen=True)
class FieldLibrary:
    """Solved presses of the file in double precision.

    probes: in the order of their rows; displacement_mm (n, d, 3) of n presses in d directions;
    force_per_mu_mm2 (n, 3); depth_mm (n,); twists: what a twist of the probe adds, None without its file.
    """

    probes: tuple[Probe, ...]
    outer_radius_mm: float
    wall_mm: float
    depth_mm: Array
    displacement_mm: Array
    force_per_mu_mm2: Array
    twists: TwistLibrary | None = None

    def largest_depth_mm(self, theta_rad: float, probe: Probe) -> float:
        """Return the largest depth of :meth:`field` at a contact angle."""
        return float(grid.largest_depth_mm(theta_rad, probe, self.outer_radius_mm))

    def largest_twist_rad(self, depth_mm: float, probe: Probe) -> float:
        """Return the largest twist of :meth:`field` at a depth; 0 without a twist library."""
        return 0.0 if self.twists is None else self.twists.largest_twist_rad(depth_mm, probe)

    def field(
        self,
        directions: Array,
        theta_rad: float,
        depth_mm: float,
        shear_mm: tuple[float, float] = (0.0, 0.0),
        azimuth_rad: float = 0.0,
        probe: Probe = Probe.PLATE,
        twist_rad: float = 0.0,
    ) -> Field:
        """Return the field of a press at polar angle theta and azimuth, followed by a slide and a twist.

        directions: (q, 3) unit vectors in F of points on the bead sphere; shear_mm: slide towards the base
        and along increasing azimuth; twist_rad: of the probe about the inward normal. Raises ConfigError
        outside of the grid: theta above 75 deg, depth above :meth:`largest_depth_mm`, slide above 0.4 of the
        depth, or twist above :meth:`largest_twist_rad`.
        """
        solved = self.solved(theta_rad, depth_mm, shear_mm, probe, twist_rad)
        moved = ring_weights(_turned(directions, -azimuth_rad)) @ solved.displacement_mm
        force = _turned(solved.force_per_mu_mm2, azimuth_rad)
        return Field(_turned(moved, azimuth_rad), force, solved.torsion_per_mu_mm3)

    def solved(
        self,
        theta_rad: float,
        depth_mm: float,
        shear_mm: tuple[float, float],
        probe: Probe = Probe.PLATE,
        twist_rad: float = 0.0,
    ) -> Field:
        """Return :meth:`field` on the library's own directions (d, 3) with the contact at azimuth 0."""
        motion = self._motion(depth_mm, shear_mm, probe, twist_rad)
        rows, plain, mirrored = self._row_weights(theta_rad, depth_mm, motion, probe)
        needed = (plain != 0) | (mirrored != 0)
        rows, plain, mirrored = rows[needed], plain[needed], mirrored[needed]
        fields = self.displacement_mm[rows]
        moved = np.tensordot(plain, fields, 1)
        if mirrored.any():
            moved = moved + np.tensordot(mirrored, fields, 1)[grid.mirror_order()] * MIRROR
        force = self._force(rows, plain, mirrored)
        if self.twists is None or probe not in self.twists.probes:
            return Field(moved, force)
        if depth_mm == 0 or motion.size == 0:
            return Field(moved, force, 0.0)
        torsion = motion.across * self.twists.torsion_of_slide(theta_rad, depth_mm, motion.size, probe)
        if twist_rad:
            twist = self.twists.twist(theta_rad, depth_mm, motion.size, motion.turn, probe)
            moved, force = moved + twist.displacement_mm, force + twist.force_per_mu_mm2
            torsion += twist.torsion_per_mu_mm3
        return Field(moved, force, torsion)

    def solved_force_per_mu_mm2(
        self, theta_rad: float, depth_mm: float, shear_mm: tuple[float, float], probe: Probe = Probe.PLATE
    ) -> Array:
        """Return only the force (3,) of :meth:`solved`."""
        motion = self._motion(depth_mm, shear_mm, probe, 0.0)
        return self._force(*self._row_weights(theta_rad, depth_mm, motion, probe))

    def _force(self, rows: NDArray[np.intp], plain: Array, mirrored: Array) -> Array:
        forces = self.force_per_mu_mm2[rows]
        return np.asarray(plain @ forces + (mirrored @ forces) * MIRROR)

    def _row_weights(
        self, theta_rad: float, depth_mm: float, motion: SlideAndTwist, probe: Probe
    ) -> tuple[NDArray[np.intp], Array, Array]:
        """Return indices of the rows to combine, their weights, and the weights of their mirror images."""
        share = self._depth_share(theta_rad, depth_mm, probe)
        angles, angle_weights = lagrange(np.radians(grid.THETA_DEG), theta_rad, 4)
        plain, mirrored = np.zeros(grid.CASES), np.zeros(grid.CASES)
        depths, depth_weights = lagrange(grid.DEPTH_SHARES, max(share, grid.DEPTH_SHARES[0]), 4)
        plain[depths] = depth_weights
        if motion.size > 0:
            _add_slide(plain, mirrored, share, motion)
        first = self.probes.index(probe) * len(grid.THETA_DEG) * grid.CASES
        rows = first + angles[:, None] * grid.CASES + np.arange(grid.CASES)
        scale = angle_weights[:, None] * depth_mm / self.depth_mm[rows]
        return rows.ravel(), (scale * plain).ravel(), (scale * mirrored).ravel()

    def _depth_share(self, theta_rad: float, depth_mm: float, probe: Probe) -> float:
        """Return depth / largest depth. Raises ConfigError outside of the grid."""
        if probe not in self.probes:
            known = ", ".join(known.label for known in self.probes)
            raise ConfigError(f"probe {probe.label} is not in the field library ({known}): {REFRESH}")
        if not 0 <= theta_rad <= np.radians(grid.THETA_DEG[-1]) + TOLERANCE:
            raise ConfigError(
                f"theta = {np.degrees(theta_rad):.1f} deg is outside of the field library, "
                f"which has 0 to {grid.THETA_DEG[-1]:g} deg"
            )
        deepest_mm = self.largest_depth_mm(theta_rad, probe)
        if not 0 <= depth_mm <= deepest_mm * (1 + TOLERANCE):
            raise ConfigError(
                f"depth = {depth_mm:g} mm is outside of the field library, "
                f"which has 0 to {deepest_mm:.2f} mm at this contact angle"
            )
        return min(depth_mm / deepest_mm, 1.0)

    def _motion(
        self, depth_mm: float, shear_mm: tuple[float, float], probe: Probe, twist_rad: float
    ) -> SlideAndTwist:
        """Return slide and twist as one motion. Raises ConfigError outside of the grid."""
        size_mm = float(np.hypot(*shear_mm))
        if size_mm > grid.SHEAR_SHARES[-1] * depth_mm * (1 + TOLERANCE):
            raise ConfigError(
                f"slide = {size_mm:g} mm at depth {depth_mm:g} mm is outside of the field library, "
                f"which has up to {grid.SHEAR_SHARES[-1]:g} of the depth"
            )
        slide = size_mm / (grid.SHEAR_SHARES[-1] * depth_mm) if size_mm else 0.0
        turn = self._twist_share(depth_mm, probe, twist_rad)
        whole = float(np.hypot(slide, turn))
        if whole == 0:
            return SlideAndTwist(0.0, 0.0, 0.0, 0.0)
        across = np.array(shear_mm) / size_mm * slide / whole if size_mm else np.zeros(2)
        return SlideAndTwist(min(whole, 1.0), float(across[0]), float(across[1]), turn / whole)

    def _twist_share(self, depth_mm: float, probe: Probe, twist_rad: float) -> float:
        """Return the twist as a fraction of the largest one."""
        if twist_rad == 0:
            return 0.0
        if self.twists is None or probe not in self.twists.probes:
            raise ConfigError(f"the field library has no twists of probe {probe.label}: {MAKE_TWISTS}")
        return self.twists.share(depth_mm, twist_rad, probe)


def _add_slide(plain: Array, mirrored: Array, share: float, motion: SlideAndTwist) -> None:
    """Add the weights of the solved slides and subtract those of the presses they start from, in place."""
    along, across = motion.along, motion.across
    # f(+) and f(-) combined to odd * c + even * c^2, where c is the slide's component in this direction.
    ways = [(along + along**2) / 2, (along**2 - along) / 2, (across + across**2) / 2]
    towards_minus_y = (across**2 - across) / 2
    starts = grid.DEPTH_SHARES[list(grid.SHEARED)]
    levels, level_weights = lagrange(starts, max(share, starts[0]), len(starts))
    slide = motion.size * grid.SHEAR_SHARES[-1]
    sizes, size_weights = lagrange(np.concatenate([[0.0], grid.SHEAR_SHARES]), slide, 3)
    for level, level_weight in zip(levels, level_weights, strict=True):
        for size, size_weight in zip(sizes, size_weights, strict=True):
            if size == 0:
                continue
            weight = level_weight * size_weight
            for way, way_weight in enumerate(ways):
                plain[_slide_case(level, way, size - 1)] += weight * way_weight
            plain[grid.SHEARED[level]] -= weight * sum(ways)
            mirrored[_slide_case(level, len(ways) - 1, size - 1)] += weight * towards_minus_y
            mirrored[grid.SHEARED[level]] -= weight * towards_minus_y


def _slide_case(level: int, way: int, size: int) -> int:
    """Return a slide's index in :func:`field_grid.cases`."""
    return len(grid.DEPTH_SHARES) + (level * len(grid.SHEAR_WAYS) + way) * len(grid.SHEAR_SHARES) + size


def ring_weights(directions: Array) -> Array:
    """Return the weights (q, d) of the library's directions at the directions (q, 3).

    Raises ConfigError for a direction below the base plane.
    """
    theta_deg = np.degrees(polar_angle(directions))
    if not (theta_deg <= 90 + TOLERANCE).all():
        raise ConfigError(
            f"a point at {theta_deg.max():.1f} deg from the pole is below the base plane: give 0 to 90 deg"
        )
    phi = np.arctan2(directions[:, 1], directions[:, 0])
    ring_of = np.repeat(np.arange(grid.RINGS), [1, *grid.POINTS_A_RING * np.arange(1, grid.RINGS)])
    count = np.maximum(grid.POINTS_A_RING * np.arange(grid.RINGS), 1)
    start = np.concatenate([[0], np.cumsum(count)[:-1]])
    phi_of = 2 * np.pi * (np.arange(len(ring_of)) - start[ring_of]) / count[ring_of]

    # Rings -1 (ring 1 continued across the pole) to 10 (the base edge: zero, so it has no column).
    first = np.clip(np.floor(theta_deg / grid.RING_STEP_DEG).astype(int) - 1, -1, grid.RINGS - 3)
    by_ring = np.zeros((len(directions), grid.RINGS + 2))
    inner = theta_deg / grid.RING_STEP_DEG - first
    for node in range(4):
        others = [other for other in range(4) if other != node]
        weight = np.prod([(inner - other) / (node - other) for other in others], axis=0)
        by_ring[np.arange(len(directions)), first + node + 1] = weight
    turn = phi[:, None] - phi_of
    weights = by_ring[:, 1 + ring_of] * periodic(turn, count[ring_of])
    first_ring = ring_of == 1
    weights[:, first_ring] += by_ring[:, :1] * periodic(turn[:, first_ring] + np.pi, count[1:2])
    return np.asarray(weights)


def periodic(turn_rad: Array, count: NDArray[np.intp]) -> Array:
    """Return the weight of a point turn_rad away in trigonometric interpolation on `count` even points."""
    half = turn_rad / 2
    sine = np.sin(half)
    on_point = np.abs(sine) < 1e-9
    weight = np.sin(count * half) * np.cos(half) / (count * np.where(on_point, 1.0, sine))
    return np.where(on_point | (count == 1), 1.0, weight)


def _turned(vectors: Array, angle_rad: float) -> Array:
    """Return vectors (..., 3) rotated about z."""
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    return np.asarray(vectors @ np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]]))


def load_library(path: Path = SHIPPED, twists: Path | None = SHIPPED_TWISTS) -> FieldLibrary:
    """Read a field library and the twist library that belongs to it, None for presses without twists.

    Raises ConfigError if a file is missing, damaged or has a different grid.
    """
    try:
        with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
    except FileNotFoundError:
        raise ConfigError(f"{path}: no such file: make it with palpate-host simulate dome library") from None
    except (OSError, ValueError, zipfile.BadZipFile) as error:
        raise ConfigError(f"{path} is not a field library ({error}): {REFRESH}") from None
    names = ("directions", "theta_rad", "depth_mm", "probe", "displacement_mm", "force_per_mu_mm2", "dome")
    for name in names:
        if name not in arrays:
            raise ConfigError(f"{path} has no array {name}: {REFRESH}")
    probes = tuple(Probe(int(number)) for number in dict.fromkeys(arrays["probe"].tolist()))
    library = FieldLibrary(
        probes=probes,
        outer_radius_mm=float(arrays["dome"][0]),
        wall_mm=float(arrays["dome"][1]),
        depth_mm=arrays["depth_mm"].astype(np.float64),
        displacement_mm=arrays["displacement_mm"].astype(np.float64),
        force_per_mu_mm2=arrays["force_per_mu_mm2"].astype(np.float64),
        twists=None if twists is None else load_twists(twists),
    )
    theta_rad = np.tile(np.repeat(np.radians(grid.THETA_DEG), grid.CASES), len(probes))
    same_angles = arrays["theta_rad"].shape == theta_rad.shape and np.allclose(
        arrays["theta_rad"], theta_rad, atol=1e-5
    )
    if not same_angles or not np.allclose(arrays["directions"], grid.ring_directions(), atol=1e-5):
        raise ConfigError(f"{path} has a different grid of angles or directions: {REFRESH}")
    return library
