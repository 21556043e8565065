"""Library of twists: what a twist of the probe adds to a press of the field library.

`palpate-host simulate dome twists` writes the file (:mod:`make_twists`); reading needs numpy only. A twist is
the turn of the probe about the inward normal after the press. Its size is the arc that it moves at Hertz's
contact radius a = sqrt(R depth), as a fraction of the depth (R: 1/R = 1/dome + 1/probe). Every contact angle,
depth and probe therefore begins to slide as a whole at nearly the same size, and the grid ends there.

Interpolated are displacement and force over the depth, and torsion over a^2 depth, its size by Hertz's
theory: over the contact angle and the size by cubic polynomials, over the depth by a quadratic one. Below the
smallest solved depth these ratios are constant. Twists of the other sign are mirror images. A slide across
the meridian has a torsion too, as its force acts beside the point of first touch.
"""

from __future__ import annotations

import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_edge.common.errors import ConfigError
from palpate_twin.dome import field_grid as grid
from palpate_twin.dome.polynomial import lagrange
from palpate_twin.dome.probe import Probe

SHIPPED = Path(__file__).with_name("twists.npz")
REFRESH = "make it again with palpate-host simulate dome twists"
MIRROR = np.array([1.0, -1.0, 1.0])
TWIST_SHARES = np.array([0.08, 0.2, 0.45])
TWISTED = grid.SHEARED
"""Indices in DEPTH_SHARES of the depths with twists: those with slides."""
TOLERANCE = 1e-6
ARRAYS = ("probe", "theta_rad", "displacement_mm", "force_per_mu_mm2", "torsion_per_mu_mm3", "slide_torsion")


@dataclass(frozen=True, slots=True)
class Twist:
    """Addition of a twist to a press with the contact at azimuth 0, in F.

    displacement_mm: (d, 3) on the library's directions; force_per_mu_mm2: (3,); torsion_per_mu_mm3: about the
    inward normal through the point of first touch.
    """

    displacement_mm: Array
    force_per_mu_mm2: Array
    torsion_per_mu_mm3: float


@dataclass(frozen=True)
class TwistLibrary:
    """Solved twists in double precision, over the depth (displacement, force) and a^2 depth (torsion).

    displacement (p, a, l, t, d, 3), force (p, a, l, t, 3), torsion (p, a, l, t) of p probes, a contact
    angles, l depths, t twists; slide_torsion (p, a, l, s) of s slides towards +y.
    """

    probes: tuple[Probe, ...]
    outer_radius_mm: float
    displacement: Array
    force: Array
    torsion: Array
    slide_torsion: Array

    def largest_twist_rad(self, depth_mm: float, probe: Probe) -> float:
        """Return the largest twist of :meth:`twist`; 0 without depth."""
        radius_mm = contact_radius_mm(probe, depth_mm, self.outer_radius_mm)
        return float(TWIST_SHARES[-1] * depth_mm / radius_mm) if depth_mm > 0 else 0.0

    def share(self, depth_mm: float, twist_rad: float, probe: Probe) -> float:
        """Return the twist over the largest one. Raises ConfigError beyond -1 to 1."""
        largest_rad = self.largest_twist_rad(depth_mm, probe)
        if not abs(twist_rad) <= largest_rad * (1 + TOLERANCE):
            raise ConfigError(
                f"twist = {np.degrees(twist_rad):.2f} deg at depth {depth_mm:g} mm is outside of the twist "
                f"library, which has up to {np.degrees(largest_rad):.2f} deg, where the probe slides"
            )
        return twist_rad / largest_rad

    def twist(self, theta_rad: float, depth_mm: float, size: float, turn: float, probe: Probe) -> Twist:
        """Return what a twist adds: the part `turn`, -1 to 1, of a motion of a size of 0 to 1.

        The odd part of the solved twists in their sign is weighted with `turn`, the even one with its square.
        """
        at = self._place(theta_rad, depth_mm, size * TWIST_SHARES[-1], TWIST_SHARES, probe)
        moved, force = depth_mm * _mean(self.displacement, *at), depth_mm * _mean(self.force, *at)
        torsion = self._volume_mm3(depth_mm, probe) * float(_mean(self.torsion, *at))
        plain, mirrored = (turn**2 + turn) / 2, (turn**2 - turn) / 2
        return Twist(
            plain * moved + mirrored * moved[grid.mirror_order()] * MIRROR,
            plain * force + mirrored * force * MIRROR,
            turn * torsion,
        )

    def torsion_of_slide(self, theta_rad: float, depth_mm: float, size: float, probe: Probe) -> float:
        """Return the torsion per mu, mm^3, of a slide towards +y of a size of 0 to 1."""
        at = self._place(theta_rad, depth_mm, size * grid.SHEAR_SHARES[-1], grid.SHEAR_SHARES, probe)
        return self._volume_mm3(depth_mm, probe) * float(_mean(self.slide_torsion, *at))

    def _place(
        self, theta_rad: float, depth_mm: float, size: float, solved: Array, probe: Probe
    ) -> tuple[int, slice, Array, Array, Array]:
        """Return the arguments of :func:`_mean` for a size between 0 and the last of the solved ones."""
        _, by_size = lagrange(np.concatenate([[0.0], solved]), size, len(solved) + 1)
        return self.probes.index(probe), *self._weights(theta_rad, depth_mm, probe), by_size[1:]

    def _volume_mm3(self, depth_mm: float, probe: Probe) -> float:
        return contact_radius_mm(probe, depth_mm, self.outer_radius_mm) ** 2 * depth_mm

    def _weights(self, theta_rad: float, depth_mm: float, probe: Probe) -> tuple[slice, Array, Array]:
        """Return the contact angles, their weights, and the weights of the depths."""
        angles, by_angle = lagrange(np.radians(grid.THETA_DEG), theta_rad, 4)
        deepest_mm = float(grid.largest_depth_mm(theta_rad, probe, self.outer_radius_mm))
        levels = grid.DEPTH_SHARES[list(TWISTED)]
        share = float(np.clip(depth_mm / deepest_mm, levels[0], levels[-1]))
        _, by_depth = lagrange(levels, share, len(levels))
        return slice(int(angles[0]), int(angles[-1]) + 1), by_angle, by_depth


def contact_radius_mm(probe: Probe, depth_mm: float, outer_radius_mm: float) -> float:
    """Return Hertz's contact radius of a probe on a solid sphere, mm."""
    curvature = 1 / outer_radius_mm + (1 / probe.radius_mm if probe.radius_mm else 0.0)
    return float(np.sqrt(depth_mm / curvature))


def _mean(
    values: Array, probe: int, angles: slice, by_angle: Array, by_depth: Array, by_size: Array
) -> Array:
    """Return the weighted mean of values (p, a, l, t, ...) of one probe over angles, depths and sizes."""
    over_angle = np.tensordot(by_angle, values[probe, angles], 1)
    return np.asarray(np.tensordot(by_size, np.tensordot(by_depth, over_angle, 1), 1))


def load_twists(path: Path = SHIPPED) -> TwistLibrary:
    """Read a twist library. Raises ConfigError if the file is missing, damaged or has a different grid."""
    try:
        with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            arrays = {name: file[name].astype(np.float64) for name in (*ARRAYS, "dome")}
    except FileNotFoundError:
        raise ConfigError(f"{path}: no such file: {REFRESH}") from None
    except (OSError, ValueError, KeyError, zipfile.BadZipFile) as error:
        raise ConfigError(f"{path} is not a twist library ({error}): {REFRESH}") from None
    probes = tuple(Probe(int(number)) for number in arrays["probe"])
    radius_mm = float(arrays["dome"][0])
    shape = (len(probes), len(grid.THETA_DEG), len(TWISTED), len(TWIST_SHARES))
    if arrays["torsion_per_mu_mm3"].shape != shape or not np.allclose(
        arrays["theta_rad"], np.radians(grid.THETA_DEG), atol=1e-5
    ):
        raise ConfigError(f"{path} has a different grid: {REFRESH}")
    deepest_mm = np.array(
        [grid.largest_depth_mm(np.radians(grid.THETA_DEG), probe, radius_mm) for probe in probes]
    )
    depth_mm = deepest_mm[:, :, None] * grid.DEPTH_SHARES[list(TWISTED)]
    curvature = np.array([1 / contact_radius_mm(probe, 1.0, radius_mm) ** 2 for probe in probes])
    volume_mm3 = (depth_mm**2 / curvature[:, None, None])[..., None]  # a^2 depth
    return TwistLibrary(
        probes=probes,
        outer_radius_mm=radius_mm,
        displacement=arrays["displacement_mm"] / depth_mm[..., None, None, None],
        force=arrays["force_per_mu_mm2"] / depth_mm[..., None, None],
        torsion=arrays["torsion_per_mu_mm3"] / volume_mm3,
        slide_torsion=arrays["slide_torsion"] / volume_mm3,
    )
