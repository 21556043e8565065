"""Deformation of one sensor's beads and inner skin under a press, from the field library."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_edge.common.errors import ConfigError
from palpate_edge.geometry.sensor import Dome
from palpate_twin.dome import field_grid as grid
from palpate_twin.dome.library import Field, FieldLibrary, periodic, ring_weights
from palpate_twin.dome.probe import Probe
from palpate_twin.dome.uneven_wall import Stiffness, UnevenWall

AZIMUTHS = grid.POINTS_A_RING * (grid.RINGS - 1)  # azimuths of the skin's polar grid: the outermost ring's
WALL_TOLERANCE = 0.02  # tolerance of wall over radius; fields depend on this ratio
FIRST_SLIDE = 0.1  # first step of the search for a slide, as a fraction of the depth
SLIDE_STEPS = 3


@dataclass(frozen=True, slots=True)
class ProbePress:
    """Press of a probe at polar angle and azimuth, then slide towards the base and along the azimuth, then
    twist about the inward normal."""

    theta_rad: float
    azimuth_rad: float
    depth_mm: float
    shear_mm: tuple[float, float] = (0.0, 0.0)
    probe: Probe = Probe.PLATE
    twist_rad: float = 0.0

    @property
    def outward(self) -> Array:
        """(3,) the dome's outward normal at the point of first touch, in F."""
        across = np.sin(self.theta_rad)
        return np.array(
            [across * np.cos(self.azimuth_rad), across * np.sin(self.azimuth_rad), np.cos(self.theta_rad)]
        )


@dataclass(frozen=True, slots=True)
class Deformation:
    """Displacement and force of a press, in frame F.

    bead_mm: (n, 3) of the beads; skin_mm: (RINGS + 1, AZIMUTHS, 3) of the polar grid of
    :func:`skin_directions`; force_per_mu_mm2: (3,) on the dome, times the shear modulus in N/mm^2 gives N;
    torsion_per_mu_mm3: its moment about the inward normal through the point of first touch, None unknown.
    """

    bead_mm: Array
    skin_mm: Array
    force_per_mu_mm2: Array
    torsion_per_mu_mm3: float | None = None


class DeformableDome:
    """The library's fields on one dome's beads, for domes of any size with the library's wall ratio.

    On a dome that is s times as large, displacements at s times the depth are s times, forces s^2 times and
    torsions s^3 times as large.
    """

    def __init__(
        self, library: FieldLibrary, dome: Dome, bead_directions: Array, stiffness: Stiffness | None = None
    ) -> None:
        """Prepare the fields at bead_directions (n, 3), unit vectors in F.

        stiffness: relative shear modulus of an uneven wall, which takes some seconds; None for an even one.
        Raises ConfigError if the wall ratio is not the library's.
        """
        self.scale = dome.outer_radius_mm / library.outer_radius_mm
        wall_mm = library.wall_mm * self.scale
        if abs(dome.wall_mm - wall_mm) > WALL_TOLERANCE * dome.outer_radius_mm:
            raise ConfigError(
                f"dome.wall_mm = {dome.wall_mm:g} cannot be simulated: at radius {dome.outer_radius_mm:g} mm "
                f"the field library has a wall of {wall_mm:g} mm"
            )
        self._library = library
        self._beads = ring_weights(bead_directions) @ _library_directions()
        self._uneven = None
        if stiffness is not None:
            points_mm = grid.BEAD_RADIUS_MM * self.scale * skin_directions()[:-1].reshape(-1, 3)
            self._uneven = UnevenWall(stiffness, points_mm, dome.outer_radius_mm, dome.wall_mm)

    def largest_depth_mm(self, theta_rad: float, probe: Probe) -> float:
        return self.scale * self._library.largest_depth_mm(theta_rad, probe)

    def largest_twist_rad(self, depth_mm: float, probe: Probe) -> float:
        return self._library.largest_twist_rad(depth_mm / self.scale, probe)

    def slid(self, press: ProbePress, friction_ratio: Array) -> ProbePress:
        """Return the press with the slide that gives a ratio of tangential to normal force.

        friction_ratio: (2,) towards the base and along increasing azimuth. The slide is found by Broyden's
        method and limited to the library's largest slide.
        """
        if press.depth_mm <= 0:
            return press

        def residual(slide: Array) -> Array:
            return friction_ratio - self._friction_ratio(press, slide)

        slide = np.zeros(2)
        error = residual(slide)
        steps = FIRST_SLIDE * np.eye(2)
        jacobian = np.column_stack([(residual(step) - error) / FIRST_SLIDE for step in steps])
        for _ in range(SLIDE_STEPS):
            next_slide = slide - np.linalg.solve(jacobian, error)
            next_slide *= min(1.0, grid.SHEAR_SHARES[-1] / max(float(np.hypot(*next_slide)), 1e-9))
            step = next_slide - slide
            length2 = float(step @ step)
            if length2 < 1e-8:
                break
            next_error = residual(next_slide)
            jacobian += np.outer(next_error - error - jacobian @ step, step) / length2
            slide, error = next_slide, next_error
        along, across = (press.depth_mm * slide).tolist()
        return replace(press, shear_mm=(along, across))

    def _friction_ratio(self, press: ProbePress, slide: Array) -> Array:
        """Return the force ratio (2,) of a slide (2,) given as a fraction of the depth."""
        depth_mm = press.depth_mm / self.scale
        along, across = (depth_mm * slide).tolist()
        force = self._library.solved_force_per_mu_mm2(press.theta_rad, depth_mm, (along, across), press.probe)
        sin, cos = math.sin(press.theta_rad), math.cos(press.theta_rad)
        x, y, z = force.tolist()
        inwards: float = -(x * sin + z * cos)
        return np.array([x * cos - z * sin, y]) / inwards

    def press(self, press: ProbePress) -> Deformation:
        """Return the deformation of a press. Raises ConfigError outside of the library's grid."""
        along, across = press.shear_mm
        shear_mm = (along / self.scale, across / self.scale)
        solved = self._library.solved(
            press.theta_rad, press.depth_mm / self.scale, shear_mm, press.probe, press.twist_rad
        )
        cos, sin = np.cos(press.azimuth_rad), np.sin(press.azimuth_rad)
        to_azimuth = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
        skin = np.zeros((grid.RINGS + 1, AZIMUTHS, 3))  # the last ring, the base edge, is fixed
        skin[:-1] = turned_rings(solved.displacement_mm @ to_azimuth * self.scale, press.azimuth_rad)
        force = solved.force_per_mu_mm2 @ to_azimuth
        field = Field(skin[:-1].reshape(-1, 3), force, solved.torsion_per_mu_mm3)
        if self._uneven is not None:
            change = self._uneven.change(
                press.theta_rad, press.azimuth_rad, press.depth_mm, press.shear_mm, press.probe
            )
            field = change.of(field)
            skin[:-1] = field.displacement_mm.reshape(skin[:-1].shape)
        torsion = field.torsion_per_mu_mm3
        return Deformation(
            self._beads @ field.displacement_mm,
            skin,
            field.force_per_mu_mm2 * self.scale**2,
            None if torsion is None else torsion * self.scale**3,
        )


def turned_rings(values: Array, azimuth_rad: float) -> Array:
    """Rotate values (d, k) on the library's directions about z and return them as (RINGS, AZIMUTHS, k).

    Each ring's trigonometric polynomial is shifted by the azimuth.
    """
    waves = np.zeros((grid.RINGS, AZIMUTHS // 2 + 1, values.shape[1]), dtype=np.complex128)
    waves[0, 0] = AZIMUTHS * values[0]
    first = 1
    for ring in range(1, grid.RINGS):
        count = grid.POINTS_A_RING * ring
        waves[ring, : count // 2 + 1] = np.fft.rfft(values[first : first + count], axis=0)
        waves[ring] *= AZIMUTHS / count
        first += count
    waves *= np.exp(-1j * azimuth_rad * np.arange(AZIMUTHS // 2 + 1))[:, None]
    inner = np.arange(1, grid.RINGS - 1)
    last = grid.POINTS_A_RING * inner // 2  # a ring's Nyquist wave: only its even part is sampled, once
    waves[inner, last] = waves[inner, last].real / 2
    return np.fft.irfft(waves, AZIMUTHS, axis=1)


def _library_directions() -> Array:
    """Return the map (d, RINGS x AZIMUTHS) from all azimuths of each ring to the library's directions."""
    x, y, _ = grid.ring_directions().T
    ring_of = np.repeat(np.arange(grid.RINGS), [1, *grid.POINTS_A_RING * np.arange(1, grid.RINGS)])
    phi = 2 * np.pi * np.arange(AZIMUTHS) / AZIMUTHS
    around = periodic(np.arctan2(y, x)[:, None] - phi, np.array(AZIMUTHS))
    weights = np.zeros((len(ring_of), grid.RINGS, AZIMUTHS))
    weights[np.arange(len(ring_of)), ring_of] = around
    return weights.reshape(len(ring_of), -1)


def skin_directions() -> Array:
    """Return unit vectors (RINGS + 1, AZIMUTHS, 3): polar angles from pole to base edge, azimuths from 0."""
    theta = np.radians(grid.RING_STEP_DEG * np.arange(grid.RINGS + 1))[:, None]
    phi = (2 * np.pi * np.arange(AZIMUTHS) / AZIMUTHS)[None]
    across = np.sin(theta)
    return np.stack(np.broadcast_arrays(across * np.cos(phi), across * np.sin(phi), np.cos(theta)), axis=2)
