"""The dome model's presses as one sensor shows them: apparent motions by geometry, and what stays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from palpate_edge.calibration.seen_presses import seen_by
from palpate_edge.calibration.training.dome_model import DomeModel, SolidPresses
from palpate_edge.common.arrays import Array
from palpate_edge.estimation.displacement_field import DisplacementReader, canonical_directions
from palpate_edge.geometry.sensor import Camera, View

RADIUS_MM = 26.5


def sphere(step_deg: float, most_deg: float) -> Array:
    """Return unit vectors about `step_deg` apart, from the apex to `most_deg`."""
    rows = [(0.0, 0.0, 1.0)]
    for theta in np.radians(np.arange(step_deg, most_deg + 1e-9, step_deg)):
        count = max(6, round(2 * np.pi * np.sin(theta) / np.radians(step_deg)))
        for phi in 2 * np.pi * np.arange(count) / count:
            rows.append((np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)))
    return np.array(rows)


def sensor(distance_mm: float) -> tuple[DisplacementReader, View]:
    """Return reader and view of a sensor whose camera is `distance_mm` below the dome's centre."""
    view = View(Camera(640, 480, (300.0, 300.0, 320.0, 240.0), (0.0, 0.0, -distance_mm)))
    places_px = view.project(RADIUS_MM * sphere(8.0, 80.0))
    return DisplacementReader(places_px, view, RADIUS_MM), view


def model(motion_mm: Array, points: Array) -> DomeModel:
    """Return a dome model whose only press in three dimensions moves the points by `motion_mm`."""
    inwards = np.array([[0.0, 0.0, -2.0]])
    solid = SolidPresses(points, motion_mm[None], -inwards / 2, inwards, np.array([3.0]))
    width = 2 * len(canonical_directions())
    return DomeModel(np.ones((1, width)), np.eye(3)[2:], -np.eye(3)[2:], RADIUS_MM, None, solid)


def apparent_motion_mm(theta_rad: float, inwards_mm: float, distance_mm: float) -> float:
    """Return how far a point that moves inwards seems to move along the sphere away from the apex.

    By bisection for the point of the sphere on the ray through the moved point.
    """
    across, up = (
        (RADIUS_MM - inwards_mm) * np.sin(theta_rad),
        (RADIUS_MM - inwards_mm) * np.cos(theta_rad),
    )
    slope = across / (up + distance_mm)
    low, high = 0.0, theta_rad
    for _ in range(60):
        middle = (low + high) / 2
        lower = RADIUS_MM * np.sin(middle) / (RADIUS_MM * np.cos(middle) + distance_mm) < slope
        low, high = (middle, high) if lower else (low, middle)
    return RADIUS_MM * (low - theta_rad)


@pytest.mark.parametrize("distance_mm", [20.0, 45.0, 70.0])
def test_skin_that_moves_inwards_seems_to_move_by_the_camera_s_distance(distance_mm: float) -> None:
    points, inwards_mm = sphere(9.0, 81.0), 0.5
    fields = seen_by(*sensor(distance_mm), model(-inwards_mm * points, points)).fields
    directions = canonical_directions()
    theta = np.arccos(directions[:, 2])
    ring = np.abs(np.degrees(theta) - 48.0) < 1
    expected_mm = apparent_motion_mm(float(theta[ring][0]), inwards_mm, distance_mm)
    assert fields[:, : len(directions)][:, ring].mean() == pytest.approx(expected_mm, rel=0.04)
    assert abs(fields[:, len(directions) :][:, ring].mean()) < 0.02 * inwards_mm


@pytest.mark.parametrize("distance_mm", [20.0, 70.0])
def test_skin_that_turns_about_the_axis_seems_alike_to_every_camera(distance_mm: float) -> None:
    points, turn_rad = sphere(9.0, 81.0), 0.01
    motion_mm = RADIUS_MM * turn_rad * np.cross([0.0, 0.0, 1.0], points)
    seen = seen_by(*sensor(distance_mm), model(motion_mm, points))
    directions = canonical_directions()
    ring = np.abs(np.degrees(np.arccos(directions[:, 2])) - 48.0) < 1
    moved_mm = np.abs(seen.fields[:, len(directions) :][:, ring]).mean()  # mirror images turn backwards
    assert moved_mm == pytest.approx(RADIUS_MM * turn_rad * np.sin(np.radians(48.0)), rel=0.03)
    assert seen.forces == pytest.approx(np.tile([0.0, 0.0, -2.0], (2, 1)))
    assert seen.directions == pytest.approx(np.tile([0.0, 0.0, 1.0], (2, 1)))


def test_a_model_without_presses_in_three_dimensions_stays() -> None:
    width = 2 * len(canonical_directions())
    dome = DomeModel(np.ones((1, width)), np.eye(3)[2:], -np.eye(3)[2:], RADIUS_MM)
    assert seen_by(*sensor(45.0), dome) is dome


def test_presses_seen_teach_the_torsion_and_are_sized_with_the_dome() -> None:
    points = sphere(9.0, 81.0)
    dome = model(-0.5 * points, points)
    seen = seen_by(*sensor(45.0), dome)
    assert seen.is_seen
    assert not dome.is_seen
    assert seen.twisted is not None
    assert seen.twisted.torsions == pytest.approx([3.0, -3.0])  # of the press and its mirror image
    assert (seen.twisted.fields == seen.fields).all()
    smaller = dome.for_markers(RADIUS_MM / 2).solid
    assert smaller is not None
    assert smaller.torsions == pytest.approx([3.0 / 8])  # a force's square of the size, and its arm


def test_faint_presses_and_one_of_three_have_hidden_beads_and_are_turned() -> None:
    """All presses dent the skin alike, every second one less: those with all beads have nearly one shape."""
    points = sphere(9.0, 81.0)
    middle = np.array([np.sin(0.8), 0.0, np.cos(0.8)])
    depth_mm = np.exp(-((points - middle) ** 2).sum(axis=1) / 0.2)
    one = model(-depth_mm[:, None] * points, points)
    assert one.solid is not None
    solid, count = one.solid, 12
    motions, directions, forces = (
        np.repeat(each, count, axis=0) for each in (solid.motions, solid.directions, solid.forces)
    )
    motions[1::2] *= 0.5
    repeated = SolidPresses(points, motions, directions, forces, np.repeat(solid.torsions, count))
    seen = seen_by(*sensor(45.0), replace(one, solid=repeated))
    assert seen.plain is not None
    plain = seen.plain[::2]  # each has its mirror image beside it
    assert np.flatnonzero(plain).tolist() == [2, 4, 8, 10]
    shapes = seen.fields[::2] / np.linalg.norm(seen.fields[::2], axis=1, keepdims=True)
    off = np.linalg.norm(shapes - shapes[2], axis=1)
    assert off[plain].max() < 0.07, off
    assert np.median(off[~plain]) > 1.5 * off[plain].max(), off
