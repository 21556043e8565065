"""The canonical field: rotates with the contact, mirrors, and does not depend on the bead layout."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from scipy.special import kv

from palpate_edge.estimation.displacement_field import (
    BEAD_NOISE,
    CANONICAL_RINGS,
    DisplacementReader,
    canonical_directions,
    kernel,
    mirrored,
    tangent_basis,
)
from palpate_edge.geometry.angles import rotation_about_z
from palpate_edge.geometry.sensor import Camera, CameraPose, View
from palpate_edge.vision.beads import Beads

RADIUS_MM = 26.5
CAMERA = Camera(640, 480, (380.0, 380.0, 320.0, 240.0), (0.0, 0.0, -45.0))
UPRIGHT = CameraPose()
CROOKED = CameraPose((0.7, -0.5, 0.4), (0.02, -0.03, 0.015), 1.02)
FREE = settings(deadline=None, max_examples=40)
FEW = settings(deadline=None, max_examples=15)
FLOAT32_MM = 1e-5  # fields are summed in float32, of motions up to a few mm
ANGLE = st.floats(-math.pi, math.pi)


def directions_of(rings):
    """Unit vectors (n, 3) of (theta_deg, count, phi0_deg) rings, by plain trigonometry."""
    found = []
    for theta_deg, count, phi0_deg in rings:
        for number in range(count):
            theta, phi = math.radians(theta_deg), math.radians(phi0_deg + 360 * number / count)
            sin = math.sin(theta)
            found.append((sin * math.cos(phi), sin * math.sin(phi), math.cos(theta)))
    return np.array(found)


BEADS = directions_of([(0, 1, 0), (15, 6, 0), (30, 12, 15), (45, 18, 0), (60, 24, 7.5), (75, 24, 0)])
DENSE = directions_of([(0, 1, 0), *((8 * ring, 6 * ring, 0) for ring in range(1, 11))])


def pinhole(points_mm, pose):
    """The camera again, with scipy's rotations instead of OpenCV's: (n, 3) mm -> (n, 2) px."""
    fx, fy, cx, cy = CAMERA.matrix
    camera = np.add(CAMERA.position_mm, pose.offset_mm)
    x, y, z = Rotation.from_rotvec(pose.rotation_rad).inv().apply(points_mm - camera).T
    return np.stack([cx + pose.focal_scale * fx * x / z, cy + pose.focal_scale * fy * y / z], axis=1)


def dent(directions, centre, depth_mm, sideways_mm):
    """Smooth motion (n, 3), mm, along the sphere: away from `centre`, and a shear that dies off."""
    along = directions @ centre
    bump = np.exp(-((np.arccos(np.clip(along, -1, 1)) / 0.45) ** 2))
    outward = depth_mm * (directions - along[:, None] * centre)
    moved = bump[:, None] * (outward + sideways_mm)
    return moved - (moved * directions).sum(axis=1)[:, None] * directions


def read(directions, motion_mm, pose=UPRIGHT, found=None, turn_rad=0.0):
    """The canonical field of beads (n, 3) that move by (n, 3) mm, seen by `pinhole`."""
    reader = DisplacementReader(pinhole(RADIUS_MM * directions, pose), View(CAMERA, pose), RADIUS_MM)
    moved_px = pinhole(RADIUS_MM * directions + motion_mm, pose)
    seen = np.ones(len(directions), dtype=np.bool_) if found is None else found
    return reader.read(Beads.from_positions(moved_px, seen), turn_rad)


def vectors(field):
    """Canonical values (2 g,) as motion (g, 3) in F, at directions (g, 3) in F."""
    count = len(field.values) // 2
    along, across = tangent_basis(canonical_directions())
    motion = field.values[:count, None] * along + field.values[count:, None] * across
    turn = rotation_about_z(field.azimuth_rad)
    return canonical_directions() @ turn.T, motion @ turn.T


def angle_between(a_rad, b_rad):
    return abs(math.remainder(a_rad - b_rad, 2 * math.pi))


def contact(theta_rad, phi_rad):
    sin = math.sin(theta_rad)
    return np.array([sin * math.cos(phi_rad), sin * math.sin(phi_rad), math.cos(theta_rad)])


@FREE
@given(turn=ANGLE, phi=ANGLE, theta=st.floats(0.2, 1.2), depth=st.floats(0.2, 2), shear=st.floats(-0.5, 0.5))
def test_a_turned_sensor_gives_the_same_field_at_a_turned_azimuth(turn, phi, theta, depth, shear):
    moved = dent(BEADS, contact(theta, phi), depth, np.array([0.0, shear, 0.0]))
    rotation = Rotation.from_rotvec([0, 0, turn])
    plain, turned = read(BEADS, moved), read(rotation.apply(BEADS), rotation.apply(moved))
    assert turned.values == pytest.approx(plain.values, abs=FLOAT32_MM)
    assert angle_between(turned.azimuth_rad, plain.azimuth_rad + turn) < 1e-6


@FREE
@given(phi=ANGLE, theta=st.floats(0.3, 1.1))
def test_a_turned_press_on_the_same_beads_gives_nearly_the_same_field(phi, theta):
    """The remaining difference is the beads' places: 7 mm apart, they sample a dent of 12 mm to 2 %."""
    here, there = (read(BEADS, dent(BEADS, contact(theta, at), 1.5, np.zeros(3))).values for at in (0.0, phi))
    assert np.linalg.norm(there - here) < 0.04 * np.linalg.norm(here)


@FREE
@given(phi=ANGLE, theta=st.floats(0.2, 1.2), shear=st.floats(-0.5, 0.5))
def test_the_mirrored_press_gives_the_mirrored_field(phi, theta, shear):
    flip = np.array([1.0, -1.0, 1.0])
    moved = dent(BEADS, contact(theta, phi), 1.0, np.array([shear, 0.3, 0.0]))
    plain, image = read(BEADS, moved), read(BEADS * flip, moved * flip)
    assert mirrored(plain.values) == pytest.approx(image.values, abs=FLOAT32_MM)
    assert angle_between(image.azimuth_rad, -plain.azimuth_rad) < 1e-6


def test_mirrored_twice_is_what_it_was():
    values = np.random.default_rng(3).standard_normal((5, 2 * len(canonical_directions())))
    assert (mirrored(mirrored(values)) == values).all()
    assert not np.allclose(mirrored(values), values)


@FEW
@given(phi=ANGLE)
def test_the_azimuth_points_to_the_press(phi):
    field = read(DENSE, dent(DENSE, contact(0.7, phi), 1.5, np.zeros(3)))
    assert angle_between(field.azimuth_rad, phi) < math.radians(0.5)


@FEW
@given(turn=ANGLE)
def test_an_extra_turn_turns_the_frame_and_not_the_motion(turn):
    moved = dent(DENSE, contact(0.6, 0.4), 1.5, np.array([0.2, 0.0, 0.0]))
    plain, turned = read(DENSE, moved), read(DENSE, moved, turn_rad=turn)
    assert angle_between(turned.azimuth_rad, plain.azimuth_rad + turn) < 1e-9
    for field in (plain, turned):
        where, motion = vectors(field)
        truth = dent(where, contact(0.6, 0.4), 1.5, np.array([0.2, 0.0, 0.0]))
        assert np.abs(motion - truth).max() < 0.05 * np.abs(truth).max()


def matern(a, b):
    """Rasmussen and Williams, Eq. (4.17), with nu = 3/2, length 0.45, at the chord's length."""
    scaled = np.maximum(math.sqrt(3) * np.linalg.norm(a[:, None] - b[None], axis=2) / 0.45, 1e-12)
    return 2 ** (1 - 1.5) / math.gamma(1.5) * scaled**1.5 * kv(1.5, scaled)


def untold(found):
    """Largest predictive variance of a hidden bead, 0 without one: Rasmussen and Williams, Eq. (2.26)."""
    if found.all():
        return 0.0
    seen, hidden = BEADS[found], BEADS[~found]
    told = matern(hidden, seen) @ np.linalg.inv(matern(seen, seen) + BEAD_NOISE * np.eye(len(seen)))
    return 1.0 - np.einsum("ij,ij->i", told, matern(hidden, seen)).min()


@pytest.mark.parametrize(("hidden", "most"), [(0.0, 0.04), (0.1, 0.09), (0.3, 0.17)])
def test_hidden_beads_are_interpolated(hidden, most):
    """Root mean square error over the dome, relative to the motion's: stated for 85 beads and a dent of
    12 mm radius, over twenty random choices of hidden beads."""
    rng = np.random.default_rng(11)
    share = []
    for _ in range(20):
        centre, shear = contact(rng.uniform(0, 1.1), rng.uniform(-3, 3)), np.array([0.3, 0.0, 0.0])
        found = np.ones(len(BEADS), dtype=np.bool_)
        found[rng.permutation(len(BEADS))[: round(hidden * len(BEADS))]] = False
        field = read(BEADS, dent(BEADS, centre, 1.5, shear), CROOKED, found)
        where, motion = vectors(field)
        truth = dent(where, centre, 1.5, shear)
        share.append(np.sqrt(((motion - truth) ** 2).sum() / (truth**2).sum()))
        assert field.hidden == pytest.approx(untold(found), abs=1e-6)
    assert np.mean(share) < most, np.mean(share)


@pytest.mark.parametrize("inexact", [False, True], ids=["all exact", "some inexact"])
def test_faint_contacts_are_smoothed_and_firm_ones_are_not(inexact):
    """A dent of 0.15 mm is read with half of the error or less from beads with 0.2 px of noise; one of 3 mm
    with 0.02 px of noise as without."""
    rng = np.random.default_rng(5)
    at_rest_px, view = pinhole(RADIUS_MM * BEADS, UPRIGHT), View(CAMERA, UPRIGHT)
    plain = DisplacementReader(at_rest_px, view, RADIUS_MM)
    noise = np.where(np.arange(len(BEADS)) % 4 == 0, 4.0, 1.0) if inexact else np.ones(len(BEADS))
    everywhere = np.ones(len(BEADS), dtype=np.bool_)
    errors = []
    for depth_mm, noise_px in ((0.15, 0.2), (3.0, 0.02)):
        smoothing = DisplacementReader(at_rest_px, view, RADIUS_MM, noise_px)
        moved = dent(BEADS, contact(0.4, 1.0), depth_mm, np.zeros(3))
        moved_px = pinhole(RADIUS_MM * BEADS + moved, UPRIGHT)
        moved_px += noise_px * noise[:, None] * rng.standard_normal(moved_px.shape)
        beads = Beads.from_positions(
            moved_px, everywhere, noise=noise.astype(np.float32) if inexact else None
        )
        for reader in (plain, smoothing):
            where, motion = vectors(reader.read(beads))
            truth = dent(where, contact(0.4, 1.0), depth_mm, np.zeros(3))
            errors.append(np.sqrt(((motion - truth) ** 2).sum() / (truth**2).sum()))
    faint, faint_smoothed, firm, firm_smoothed = errors
    assert faint_smoothed < 0.5 * faint
    assert firm_smoothed < firm + 0.02


def test_where_a_hidden_bead_is_said_to_be_does_not_matter():
    moved = dent(BEADS, contact(0.5, 0.5), 1.5, np.zeros(3))
    found = np.ones(len(BEADS), dtype=np.bool_)
    found[[4, 30, 60]] = False
    elsewhere = moved.copy()
    elsewhere[~found] += 3.0
    assert (
        read(BEADS, moved, found=found).values.tolist() == read(BEADS, elsewhere, found=found).values.tolist()
    )


@pytest.mark.parametrize("pose", [UPRIGHT, CROOKED], ids=["upright", "crooked"])
def test_pixels_become_millimetres_along_the_sphere(pose):
    """Finite differences of `pinhole` along the sphere, undone by the reader's pixels to mm, are one."""
    along, across = tangent_basis(BEADS)
    reader = DisplacementReader(pinhole(RADIUS_MM * BEADS, pose), View(CAMERA, pose), RADIUS_MM)
    step_mm = 1e-3
    for tangent in (along, across):
        ahead = pinhole(RADIUS_MM * BEADS + step_mm * tangent, pose)
        behind = pinhole(RADIUS_MM * BEADS - step_mm * tangent, pose)
        slope_px_mm = (ahead - behind) / (2 * step_mm)
        motion = np.einsum("nij,nj->ni", reader._mm_per_px, slope_px_mm)
        assert motion == pytest.approx(tangent, abs=2e-3)


def test_the_kernel_about_an_azimuth_does_not_depend_on_the_one_before():
    reader = DisplacementReader(pinhole(RADIUS_MM * BEADS, UPRIGHT), View(CAMERA, UPRIGHT), RADIUS_MM)
    for azimuth_rad in (0.0, 0.7, 0.7, -1.3, 0.7):
        turned = canonical_directions() @ rotation_about_z(azimuth_rad).T
        expected = matern(turned, BEADS)
        assert reader.padded_kernel(azimuth_rad)[:, : len(BEADS)] == pytest.approx(expected, abs=1e-4)


def test_no_motion_is_a_field_of_zeros():
    assert read(BEADS, np.zeros_like(BEADS), CROOKED).values == pytest.approx(0, abs=1e-9)


def test_canonical_directions_are_whole_rings_of_unit_vectors():
    directions = canonical_directions()
    assert len(directions) == sum(count for _, count in CANONICAL_RINGS)
    assert np.linalg.norm(directions, axis=1) == pytest.approx(1)
    theta_deg = np.degrees(np.arccos(directions[:, 2]))
    expected = [theta for theta, count in CANONICAL_RINGS for _ in range(count)]
    assert theta_deg == pytest.approx(expected, abs=1e-6)


def test_the_kernel_is_matern_three_halves():
    assert kernel(BEADS, DENSE) == pytest.approx(matern(BEADS, DENSE), abs=1e-6)


@pytest.mark.parametrize("pose", [UPRIGHT, CROOKED])
@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)])
def test_the_mean_motion_of_a_skin_that_turns(pose, axis):
    """A rotation w displaces by d = w x r; the mean of r x d is R (w - r (r w)), with outer products."""
    turn_rad = 1e-4
    rest_px = pinhole(RADIUS_MM * BEADS, pose)
    reader = DisplacementReader(rest_px, View(CAMERA, pose), RADIUS_MM)
    turned = Rotation.from_rotvec(turn_rad * np.array(axis)).apply(RADIUS_MM * BEADS)
    motion = np.array(reader.mean_motion_mm(pinhole(turned, pose) - rest_px))
    outer = (BEADS[:, :, None] * BEADS[:, None, :]).mean(axis=0)
    mean_d = np.cross(axis, BEADS.mean(axis=0))
    expected = RADIUS_MM * turn_rad * np.concatenate([mean_d, np.array(axis) - outer @ axis])
    assert motion == pytest.approx(expected, abs=2e-3 * RADIUS_MM * turn_rad)
