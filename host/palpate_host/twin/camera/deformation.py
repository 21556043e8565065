"""How one sensor's beads and inner skin move when the dome is pressed, from the library of fields."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate_edge.errors import ConfigError
from palpate_edge.sensor import Dome
from palpate_host.twin.dome import field_grid as grid
from palpate_host.twin.dome.library import FieldLibrary, ring_weights
from palpate_host.twin.dome.probe import Probe

Array = NDArray[np.float64]

AZIMUTHS = 72  # of the skin's polar grid
WALL_TOLERANCE = 0.02  # of wall over radius: fields of another ratio are others


@dataclass(frozen=True, slots=True)
class ProbePress:
    """A probe pushed in at polar angle and azimuth, then slid (towards the base, along growing azimuth)."""

    theta_rad: float
    azimuth_rad: float
    depth_mm: float
    shear_mm: tuple[float, float] = (0.0, 0.0)
    probe: Probe = Probe.PLATE

    @property
    def outward(self) -> Array:
        """(3,) the dome's normal, in F, where the probe first touches."""
        across = np.sin(self.theta_rad)
        return np.array(
            [across * np.cos(self.azimuth_rad), across * np.sin(self.azimuth_rad), np.cos(self.theta_rad)]
        )


@dataclass(frozen=True, slots=True)
class Deformation:
    """bead_mm (n, 3): displacement of the beads; skin_mm (RINGS + 1, AZIMUTHS, 3): of the polar grid of
    :func:`skin_directions`; force_per_mu_mm2 (3,): on the dome, times the shear modulus in N/mm^2 in N; in F.
    """

    bead_mm: Array
    skin_mm: Array
    force_per_mu_mm2: Array


class DeformableDome:
    """The library's fields on one dome's beads, for domes of any size with the library's wall ratio.

    A dome s times as large, pressed s times as deep, moves s times as far and bears s^2 times the force.
    """

    def __init__(self, library: FieldLibrary, dome: Dome, bead_directions: Array) -> None:
        """bead_directions (n, 3), unit vectors in F. Raises ConfigError for a wall the library has not."""
        self.scale = dome.outer_radius_mm / library.outer_radius_mm
        wall_mm = library.wall_mm * self.scale
        if abs(dome.wall_mm - wall_mm) > WALL_TOLERANCE * dome.outer_radius_mm:
            raise ConfigError(
                f"dome.wall_mm {dome.wall_mm:g}: the library of fields has a wall of {wall_mm:g} mm "
                f"at radius {dome.outer_radius_mm:g} mm: give that one"
            )
        self._library = library
        self._beads = ring_weights(bead_directions)
        moving = skin_directions()[: grid.RINGS].reshape(-1, 3)  # all but the rim, which is fixed
        self._skin = ring_weights(moving)

    def largest_depth_mm(self, theta_rad: float, probe: Probe) -> float:
        return self.scale * self._library.largest_depth_mm(theta_rad, probe)

    def press(self, press: ProbePress) -> Deformation:
        """Raises ConfigError outside the library, as :meth:`FieldLibrary.field`."""
        along, across = press.shear_mm
        shear_mm = (along / self.scale, across / self.scale)
        solved = self._library.solved(press.theta_rad, press.depth_mm / self.scale, shear_mm, press.probe)
        cos, sin = np.cos(press.azimuth_rad), np.sin(press.azimuth_rad)
        to_azimuth = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
        moved = turned_rings(solved.displacement_mm, press.azimuth_rad) @ to_azimuth * self.scale
        skin = np.zeros((grid.RINGS + 1, AZIMUTHS, 3))
        skin[:-1] = (self._skin @ moved).reshape(grid.RINGS, AZIMUTHS, 3)
        force = solved.force_per_mu_mm2 @ to_azimuth * self.scale**2
        return Deformation(self._beads @ moved, skin, force)


def turned_rings(values: Array, azimuth_rad: float) -> Array:
    """(d, k) on the library's directions, turned about z: each ring's trigonometric polynomial, shifted."""
    turned = values.copy()
    first = 1
    for ring in range(1, grid.RINGS):
        count = grid.POINTS_A_RING * ring
        waves = np.fft.rfft(values[first : first + count], axis=0)
        waves *= np.exp(-1j * azimuth_rad * np.arange(len(waves)))[:, None]
        turned[first : first + count] = np.fft.irfft(waves, count, axis=0)
        first += count
    return turned


def skin_directions() -> Array:
    """(RINGS + 1, AZIMUTHS, 3) unit vectors: polar angles from the pole to the rim, azimuths from 0."""
    theta = np.radians(grid.RING_STEP_DEG * np.arange(grid.RINGS + 1))[:, None]
    phi = (2 * np.pi * np.arange(AZIMUTHS) / AZIMUTHS)[None]
    across = np.sin(theta)
    return np.stack(np.broadcast_arrays(across * np.cos(phi), across * np.sin(phi), np.cos(theta)), axis=2)
