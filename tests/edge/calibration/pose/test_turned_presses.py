"""Presses turned with their layout: each is what the pad shows of the turned pose."""

from __future__ import annotations

import numpy as np
import pytest
from tests.edge.calibration.pose.drawn_pad import DrawnPad

from palpate_edge.calibration.pose.transferred import PressesHere
from palpate_edge.calibration.pose.turned_presses import turned_presses
from palpate_edge.common.arrays import Array

LABELS = ("depth_mm", "tilt_x_deg", "tilt_y_deg", "shear_x_mm", "shear_y_mm", "torsion_deg")
SQUARE = 20.0 * np.stack(np.meshgrid(np.arange(8.0), np.arange(8.0)), axis=-1).reshape(-1, 2)


def displacement_px(rest_px: Array, poses: Array, tilt_y_sign: float = 1.0) -> Array:
    """A pad that is alike in all directions: markers spread with depth and with the tilt towards them, and
    shear and turn with the object."""
    off = (rest_px - rest_px.mean(axis=0)) / 80
    depth, tilt_x, tilt_y, shear_x, shear_y, torsion = poses.T[:, :, None]
    local = depth + tilt_x * off[:, 1] - tilt_y_sign * tilt_y * off[:, 0]
    return np.stack(
        [
            local * off[:, 0] + shear_x - torsion * off[:, 1],
            local * off[:, 1] + shear_y + torsion * off[:, 0],
        ],
        axis=2,
    ).reshape(len(poses), -1)


def presses(rest_px: Array, tilt_y_sign: float = 1.0) -> PressesHere:
    poses = np.random.default_rng(6).uniform([1, -1, -1, -1, -1, -1], [3, 1, 1, 1, 1, 1], size=(60, 6))
    return PressesHere(displacement_px(rest_px, poses, tilt_y_sign), poses)


@pytest.mark.parametrize(("rest_px", "count"), [(DrawnPad().rest_px(), 6), (SQUARE, 4)])
@pytest.mark.parametrize("tilt_y_sign", [1.0, -1.0])
def test_turned_presses_are_those_of_the_turned_poses(rest_px, count, tilt_y_sign):
    found = turned_presses(presses(rest_px, tilt_y_sign), rest_px, LABELS)
    assert len(found) == count
    for number, turned in enumerate(found):
        expected = displacement_px(rest_px, turned.targets, tilt_y_sign)
        np.testing.assert_allclose(turned.displacement_px, expected, atol=1e-6)
        angle = np.angle(turned.targets[:, 3:5] @ (1, 1j)) - np.angle(found[0].targets[:, 3:5] @ (1, 1j))
        np.testing.assert_allclose(np.exp(1j * angle), np.exp(2j * np.pi * number / count), atol=1e-9)
        np.testing.assert_array_equal(turned.targets[:, [0, 5]], found[0].targets[:, [0, 5]])


def test_a_layout_without_symmetry_is_not_turned():
    rest_px = np.random.default_rng(3).uniform(0, 200, size=(61, 2))
    assert len(turned_presses(presses(rest_px), rest_px, LABELS)) == 1


def test_presses_whose_tilt_does_not_show_are_not_turned():
    rest_px = DrawnPad().rest_px()
    given = presses(rest_px)
    still = PressesHere(displacement_px(rest_px, given.targets * [1, 0, 0, 1, 1, 1]), given.targets)
    assert len(turned_presses(still, rest_px, LABELS)) == 1
