"""The canonical field by NumPy's dense matrices in double precision."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate_edge.kernels.canonical_field import CanonicalFieldKernel, FieldNoise

BEADS, DIRECTIONS, LENGTH, NOISE = 30, 19, 0.45, 1e-3
RANDOM = np.random.default_rng(2)


def unit_vectors(count):
    vectors = RANDOM.standard_normal((count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def matern(a, b):
    """Rasmussen and Williams, Eq. (4.17), with nu = 3/2, at the chord's length."""
    distance = math.sqrt(3) * np.linalg.norm(a[:, None] - b[None], axis=2) / LENGTH
    return (1 + distance) * np.exp(-distance)


UNIT, AT = unit_vectors(BEADS), unit_vectors(DIRECTIONS)
AT[0] = UNIT[0]  # distance 0
TANGENTS = RANDOM.standard_normal((2, DIRECTIONS, 3))
MM_PER_PX = RANDOM.standard_normal((BEADS, 3, 2))
COVARIANCE = matern(UNIT, UNIT)
INVERSE = np.linalg.inv(COVARIANCE + NOISE * np.eye(BEADS))
MOVED_PX = RANDOM.standard_normal((BEADS, 2))
FIELD_NOISE = FieldNoise(NOISE, 0.02, 16.0, 0.1)
WEIGHTS = INVERSE @ np.einsum("nij,nj->ni", MM_PER_PX, MOVED_PX)


def field():
    return CanonicalFieldKernel(AT, TANGENTS, UNIT, MM_PER_PX, COVARIANCE, FIELD_NOISE, length=LENGTH)


def turned(azimuth_rad):
    cos, sin = math.cos(azimuth_rad), math.sin(azimuth_rad)
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize("azimuth_rad", [0.0, 0.9, -2.5])
def test_the_covariance_is_materns_about_the_azimuth(azimuth_rad):
    reader = field()
    reader.turn(azimuth_rad)
    expected = matern(AT @ turned(azimuth_rad).T, UNIT)
    assert reader.covariance[:, :BEADS] == pytest.approx(expected, rel=2e-6)


def test_the_azimuth_is_that_of_the_squared_displacement():
    smooth = COVARIANCE @ WEIGHTS
    x, y, _ = (smooth**2).sum(axis=1) @ UNIT
    for turn_rad in (0.0, 0.3):
        azimuth_rad, _ = field().read(MOVED_PX, turn_rad, all_exact=False)
        assert azimuth_rad == pytest.approx(math.atan2(y, x) + turn_rad, abs=1e-9)


def test_the_mean_motion_is_that_of_the_beads_and_about_the_centre():
    moved_mm = np.einsum("nij,nj->ni", MM_PER_PX, MOVED_PX)
    expected = np.concatenate([moved_mm.mean(axis=0), np.cross(UNIT, moved_mm).mean(axis=0)])
    assert field().mean_motion(MOVED_PX) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("size", [1.0, 0.05, 0.0])
def test_the_noise_of_exact_beads_is_over_the_frames_displacement(size):
    """By the covariance's inverse with that noise on its diagonal, in place of its modes."""
    moved_mm = np.einsum("nij,nj->ni", MM_PER_PX, size * MOVED_PX)
    square = (moved_mm**2).sum(axis=1).mean()
    noise = NOISE + 16.0 * 0.02 / max(square - 0.02, 0.1 * square, 1e-12)
    weights = np.linalg.inv(COVARIANCE + noise * np.eye(BEADS)) @ moved_mm
    x, y, _ = ((COVARIANCE @ weights) ** 2).sum(axis=1) @ UNIT
    azimuth_rad, values = field().read(size * MOVED_PX, 0.4, all_exact=True)
    assert azimuth_rad == pytest.approx(math.atan2(y, x) + 0.4, abs=1e-9)
    np.testing.assert_allclose(values, field().read_weighed(weights, azimuth_rad), rtol=1e-5, atol=1e-12)


@pytest.mark.parametrize("given_by", ["displacement", "weights"])
def test_the_field_is_the_interpolated_displacement_along_the_tangents(given_by):
    reader, azimuth_rad = field(), 0.9
    if given_by == "weights":
        values = reader.read_weighed(WEIGHTS, azimuth_rad)
    else:
        azimuth_rad, values = reader.read(MOVED_PX, azimuth_rad, all_exact=False)
    assert reader.covariance[:, :BEADS] == pytest.approx(matern(AT @ turned(azimuth_rad).T, UNIT), rel=2e-6)
    turn = turned(azimuth_rad)
    moved = matern(AT @ turn.T, UNIT) @ WEIGHTS @ turn
    expected = np.einsum("pgi,gi->pg", TANGENTS, moved).ravel()
    assert values == pytest.approx(expected, abs=2e-6 * np.abs(WEIGHTS).max() * BEADS)


@settings(deadline=None, max_examples=50)
@given(st.floats(), st.floats(-1e9, 1e9), st.integers(0, 2 * BEADS - 1))
def test_any_displacement_is_computed_with(value, azimuth_rad, place):
    reader, moved_px = field(), MOVED_PX.copy()
    moved_px.ravel()[place] = value
    for all_exact in (False, True):
        assert len(reader.read(moved_px, azimuth_rad, all_exact=all_exact)[1]) == 2 * DIRECTIONS
    assert len(reader.mean_motion(moved_px)) == 6


def test_geometry_of_other_beads_is_refused():
    with pytest.raises(ValueError, match="does not fit"):
        CanonicalFieldKernel(AT, TANGENTS, UNIT, MM_PER_PX[1:], COVARIANCE, FIELD_NOISE, length=LENGTH)
