"""The adjustment of the dome model, against presses that a known rotation and stretch have moved."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from palpate_edge.calibration.training.dome_adjustment import JigPress, fit_adjustment
from palpate_edge.calibration.training.dome_model import DomeModel
from palpate_edge.jig.jig_plan import JigSize, plan_holes
from palpate_edge.vision.beads import Beads

RADIUS_MM = 30.0
HOLES = np.array([hole.outward for hole in plan_holes(RADIUS_MM, JigSize(2 * RADIUS_MM))])
BEADS = Beads.from_positions(np.zeros((1, 2)), np.ones(1, dtype=np.bool_))


def spherical(theta, phi):
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=1)


def angles(directions):
    return np.arccos(np.clip(directions[:, 2], -1, 1)), np.arctan2(directions[:, 1], directions[:, 0])


def adjusted(given, true=HOLES, *, is_drawn=False, faintness=1.0):
    presses = [JigPress(BEADS, direction, faintness) for direction in true]
    return fit_adjustment(given, presses, RADIUS_MM, is_drawn=is_drawn)


def dome(directions, forces):
    return DomeModel(np.ones((len(directions), 2)), directions, forces, 26.5)


def test_a_turned_camera_is_found():
    """A turn of 1.5 deg about the axis, which a learned layout leaves open."""
    turn = Rotation.from_rotvec([0.0, 0.0, np.radians(1.5)])
    found = adjusted(turn.inv().apply(HOLES))
    assert found.errors.used
    assert np.degrees(found.numbers[:3]) == pytest.approx([0, 0, 1.5], abs=0.15)
    assert np.abs(found.numbers[3:]).max() < 0.002
    assert found.errors.left_out_mm < 0.15 * found.errors.without_mm


def test_a_drawn_layout_holds_the_camera_against_a_jig_that_is_turned_on_the_housing():
    jig = Rotation.from_rotvec([0.0, 0.0, np.radians(1.0)])
    found = adjusted(jig.inv().apply(HOLES), is_drawn=True)
    assert abs(np.degrees(found.numbers[2])) < 0.3


def test_a_stretched_dome_is_found_and_its_model_mended():
    """Between the holes too: the model's contacts come to where the stretch has them."""
    theta, phi = angles(HOLES)
    found = adjusted(spherical(theta + 0.06 * np.sin(theta) * (1 - np.cos(theta)), phi))
    assert found.errors.used and found.errors.left_out_mm < 0.2 * found.errors.without_mm
    theta, phi = np.radians(np.arange(5.0, 70.0, 5.0)), np.arange(13.0)
    shifted = theta + 0.06 * np.sin(theta) * (1 - np.cos(theta))
    outward = spherical(shifted, phi)
    mended = found.stretched(dome(outward, -2.0 * outward))
    off_mm = RADIUS_MM * np.linalg.norm(mended.directions - spherical(theta, phi), axis=1)
    assert off_mm.max() < 0.2 < RADIUS_MM * np.abs(shifted - theta).max()
    np.testing.assert_allclose(
        mended.forces, -2.0 * mended.directions, atol=1e-9
    )  # along the normal as before


def test_one_hole_taken_for_another_moves_the_rest_little():
    given = HOLES.copy()
    given[[8, 12]] = given[[12, 8]]
    found = adjusted(given)
    assert RADIUS_MM * np.abs(found.numbers).max() < 0.15
    assert found.errors.left_out_mm > 2.0


@pytest.mark.parametrize("seed", range(8))
def test_errors_of_the_print_alone_move_contacts_by_less_than_they_are_themselves(seed):
    """With a dome model that is right, the adjustment changes the positions only a little."""
    rng = np.random.default_rng(seed)
    given = HOLES + 0.0093 * rng.standard_normal(HOLES.shape)
    given /= np.linalg.norm(given, axis=1, keepdims=True)
    found = adjusted(given, is_drawn=True)
    moved = found.stretched(dome(HOLES, -HOLES)).directions
    printed = np.linalg.norm(given - HOLES, axis=1).mean()
    assert np.linalg.norm(moved - HOLES, axis=1).mean() < printed / 2


def test_four_holes_are_too_few():
    given = Rotation.from_rotvec([0.0, 0.0, 0.03]).apply(HOLES[8:12])
    found = adjusted(given, HOLES[8:12])
    assert not found.errors.used and not found.numbers.any()
    assert found.errors.left_out_mm == found.errors.without_mm == pytest.approx(0.78, abs=0.02)
