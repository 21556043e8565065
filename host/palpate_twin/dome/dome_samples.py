"""Training samples of the packaged dome model: presses of the field library, measured by random sensors.

Layout, bead positions, camera pose and noise vary between sensors as between real ones; presses vary in
position, depth and slide. Further presses, which teach the torsion alone, vary in twist too.

Presses of other places, twists and walls of uneven stiffness are kept in three dimensions, for the camera of
the sensor that is calibrated. Of presses that are spread evenly over the dome one in a hundred is within
8 deg of the apex, where grasps begin: further ones are near it. Further ones too are by the smallest ball,
whose deep presses near the base differ most from the others. `palpate-host simulate dome model` writes the
file.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from palpate_edge.calibration.seen_presses import tracked_beads
from palpate_edge.calibration.training.dome_model import DomeModel, SolidPresses, TwistedPresses
from palpate_edge.calibration.training.samples import Samples, TrainingPress, make_samples
from palpate_edge.common.arrays import Array
from palpate_edge.estimation.displacement_field import DisplacementReader
from palpate_edge.geometry.sensor import Camera, CameraPose, Markers, Ring, View, bead_layout_mm
from palpate_twin.dome import field_grid
from palpate_twin.dome.library import Field, FieldLibrary
from palpate_twin.dome.probe import Probe
from palpate_twin.dome.uneven_wall import UnevenWall, random_stiffness

SENSORS = 24
TWISTED_SENSORS = 12
PRESSES_A_SENSOR = 50
SOLID_PRESSES, APEX_PRESSES, BALL_PRESSES = 900, 240, 300
UNEVEN_WALLS, PRESSES_A_WALL, UNEVENNESS = 10, 30, 0.15
COPIES = 1
MOST_THETA_RAD = np.radians(75.0)
APEX_THETA_RAD = np.radians(20.0)
LEAST_DEPTH_SHARE = 0.01
PLATE_SHARE = 0.6  # share of presses by the plate; the others use any probe of the library
MOST_SLIDE_SHARE = 0.4
BEAD_TOLERANCE_MM = 0.15
CAMERA = Camera(640, 480, (380.0, 380.0, 320.0, 240.0), (0.0, 0.0, -45.0))
LAYOUTS = (
    ((0, 1), (15, 6), (30, 12), (45, 18), (60, 24), (75, 24)),
    ((0, 1), *((6 * ring, 6) for ring in range(1, 15))),
    ((0, 1), *((12 * ring, 12) for ring in range(1, 8))),
)


def dome_samples(
    library: FieldLibrary, seed: int, progress: Callable[[int, int], None] = lambda _done, _total: None
) -> DomeModel:
    """Return `PRESSES_A_SENSOR` presses and their mirror images for each of `SENSORS` sensors, and as many
    twisted ones for each of `TWISTED_SENSORS`."""
    rng, twisted_rng = np.random.default_rng(seed), np.random.default_rng([seed, 1])
    parts, twisted = [], []
    for sensor in range(SENSORS + TWISTED_SENSORS):
        if sensor < SENSORS:
            parts.append(_one_sensor(library, rng))
        else:
            twisted.append(_one_sensor(library, twisted_rng, twisted=True))
        progress(sensor + 1, SENSORS + TWISTED_SENSORS)
    return DomeModel(
        np.concatenate([part.fields for part in parts]),
        np.concatenate([part.directions for part in parts]),
        np.concatenate([part.forces_N for part in parts]),
        field_grid.BEAD_RADIUS_MM,
        TwistedPresses(
            np.concatenate([part.fields for part in twisted]),
            np.concatenate([part.torsions_Nmm for part in twisted if part.torsions_Nmm is not None]),
        ),
        solid_presses(library, np.random.default_rng([seed, 2])),
    )


def solid_presses(library: FieldLibrary, rng: np.random.Generator) -> SolidPresses:
    """Return `SOLID_PRESSES` presses of an even wall, `APEX_PRESSES` near its apex, `PRESSES_A_WALL` of each
    uneven wall, and `BALL_PRESSES` by the smallest ball, at azimuth 0 on the library's own directions."""
    parts = [
        *(_solid_press(library, rng) for _ in range(SOLID_PRESSES)),
        *(_solid_press(library, rng, near_apex=True) for _ in range(APEX_PRESSES)),
    ]
    points = field_grid.ring_directions()
    for _ in range(UNEVEN_WALLS):
        stiffness = random_stiffness(UNEVENNESS, int(rng.integers(2**31)))
        points_mm = field_grid.BEAD_RADIUS_MM * points
        wall = UnevenWall(stiffness, points_mm, library.outer_radius_mm, library.wall_mm)
        parts += [_solid_press(library, rng, wall) for _ in range(PRESSES_A_WALL)]
    parts += [_solid_press(library, rng, probe=Probe.SPHERE5) for _ in range(BALL_PRESSES)]
    fields, directions = zip(*parts, strict=True)
    return SolidPresses(
        points,
        np.array([field.displacement_mm for field in fields]),
        np.array(directions),
        np.array([field.force_per_mu_mm2 for field in fields]),
        np.array([field.torsion_per_mu_mm3 for field in fields]),
    )


def _solid_press(
    library: FieldLibrary,
    rng: np.random.Generator,
    wall: UnevenWall | None = None,
    *,
    near_apex: bool = False,
    probe: Probe | None = None,
) -> tuple[Field, Array]:
    """Return the field of a press at azimuth 0, and its direction (3,)."""
    contact = _random_contact(library, rng, twisted=True, near_apex=near_apex, probe=probe)
    contact = contact._replace(azimuth_rad=0.0)
    field = library.solved(
        contact.theta_rad, contact.depth_mm, contact.shear_mm, contact.probe, contact.twist_rad
    )
    if wall is not None:
        change = wall.change(contact.theta_rad, 0.0, contact.depth_mm, contact.shear_mm, contact.probe)
        field = change.of(field)
    return field, contact.direction


def _one_sensor(library: FieldLibrary, rng: np.random.Generator, *, twisted: bool = False) -> Samples:
    rings = LAYOUTS[int(rng.integers(len(LAYOUTS)))]
    turn_deg = float(rng.uniform(0, 360))
    markers = Markers(
        field_grid.BEAD_RADIUS_MM, 3.0, tuple(Ring(theta, count, turn_deg) for theta, count in rings)
    )
    beads = bead_layout_mm(markers)[0]
    beads = beads + BEAD_TOLERANCE_MM * rng.standard_normal(beads.shape)
    directions = beads / np.linalg.norm(beads, axis=1, keepdims=True)
    view = View(CAMERA, _random_pose(rng))
    reference_px = view.project(directions * field_grid.BEAD_RADIUS_MM)
    reader = DisplacementReader(reference_px, view, field_grid.BEAD_RADIUS_MM)
    presses = [_press(library, directions, view, rng, twisted=twisted) for _ in range(PRESSES_A_SENSOR)]
    return make_samples(
        reader, presses, int(rng.integers(2**31)), COPIES, varied=np.ones(len(presses), np.bool_)
    )


def _random_pose(rng: np.random.Generator) -> CameraPose:
    offset = rng.uniform(-1, 1, 3)
    tilt = np.radians(rng.uniform(-2, 2, 3))
    return CameraPose(
        (float(offset[0]), float(offset[1]), float(offset[2])),
        (float(tilt[0]), float(tilt[1]), float(tilt[2])),
        float(rng.uniform(0.97, 1.03)),
    )


def _press(
    library: FieldLibrary,
    directions: Array,
    view: View,
    rng: np.random.Generator,
    *,
    twisted: bool,
) -> TrainingPress:
    contact = _random_contact(library, rng, twisted=twisted)
    field = library.field(directions, *contact)
    beads = tracked_beads(view, directions * field_grid.BEAD_RADIUS_MM + field.displacement_mm, rng)
    torsion = field.torsion_per_mu_mm3
    return TrainingPress(beads, contact.direction, field.force_per_mu_mm2, torsion_Nmm=torsion)


class _Contact(NamedTuple):
    """Arguments of `FieldLibrary.field` after the directions."""

    theta_rad: float
    depth_mm: float
    shear_mm: tuple[float, float]
    azimuth_rad: float
    probe: Probe
    twist_rad: float

    @property
    def direction(self) -> Array:
        """(3,) the unit vector from the dome's centre to the contact."""
        across = np.sin(self.theta_rad)
        x, y = across * np.cos(self.azimuth_rad), across * np.sin(self.azimuth_rad)
        return np.array([x, y, np.cos(self.theta_rad)])


def _random_contact(
    library: FieldLibrary,
    rng: np.random.Generator,
    *,
    twisted: bool,
    near_apex: bool = False,
    probe: Probe | None = None,
) -> _Contact:
    """Return a contact by a probe, any one if None, at a random place of the dome or, by uniform angles, near
    its apex."""
    if probe is None:
        is_plate = rng.uniform() < PLATE_SHARE
        probe = Probe.PLATE if is_plate else library.probes[int(rng.integers(len(library.probes)))]
    if near_apex:
        theta = float(rng.uniform(0.0, APEX_THETA_RAD))
    else:
        theta = float(np.arccos(rng.uniform(np.cos(MOST_THETA_RAD), 1.0)))
    azimuth, slide_direction = rng.uniform(0, 2 * np.pi, 2)
    depth_mm = float(rng.uniform(LEAST_DEPTH_SHARE, 1.0)) * library.largest_depth_mm(theta, probe)
    slide_share = float(rng.uniform(0, MOST_SLIDE_SHARE))
    slide_mm, twist_rad = slide_share * depth_mm, 0.0
    shear_mm = (slide_mm * float(np.cos(slide_direction)), slide_mm * float(np.sin(slide_direction)))
    if twisted:  # slide and twist share the friction
        free = float(np.sqrt(1 - (slide_share / MOST_SLIDE_SHARE) ** 2))
        twist_rad = float(rng.uniform(-1, 1)) * free * library.largest_twist_rad(depth_mm, probe)
    return _Contact(theta, depth_mm, shear_mm, float(azimuth), probe, twist_rad)
