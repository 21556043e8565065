"""The faces of an object, on a cube whose distances are known."""

import itertools

import numpy as np
import pytest

from palpate_host.control.gait.object_shape import hull_of, shape_of

HALF = 0.04


def cube():
    """Six faces, each seen counter-clockwise from outside."""
    faces = []
    for axis, sign in itertools.product(range(3), (-1.0, 1.0)):
        u, v = np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3]
        corners = [a * u + b * v + sign * np.eye(3)[axis] for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        faces.append(HALF * np.array(corners[:: int(sign)]))
    return shape_of(faces)


def test_normals_point_outwards():
    normals = sorted(tuple(face.normal.round(9) + 0.0) for face in cube().faces)
    assert normals == sorted(tuple(sign * row + 0.0) for row in np.eye(3) for sign in (-1.0, 1.0))
    assert all(face.distance_m == pytest.approx(HALF) for face in cube().faces)


def test_the_inset_of_a_point_is_its_distance_from_the_nearest_edge():
    face = cube().nearest_face(np.array([0.1, 0.01, 0.0]))
    assert face.normal == pytest.approx([1.0, 0.0, 0.0])
    assert face.inset_m(np.array([HALF, 0.01, -0.02])) == pytest.approx(0.02)
    assert face.inset_m(np.array([HALF, 0.05, 0.0])) == pytest.approx(-0.01)


def test_the_gap_is_exact_before_a_face_and_too_small_beside_an_edge():
    before, beside, inside = np.array([[0.07, 0.0, 0.0], [0.07, 0.08, 0.0], [0.0, 0.0, 0.01]])
    gaps = cube().gap_m(np.array([before, beside, inside]))
    assert gaps == pytest.approx([0.03, 0.04, -0.03])
    assert gaps[1] < np.hypot(0.03, 0.04)


def test_a_moved_object_keeps_its_gaps():
    R = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    R *= np.linalg.det(R)
    shift, points = np.array([0.1, -0.2, 0.05]), np.random.default_rng(2).normal(0.0, 0.1, (20, 3))
    moved = cube().moved(R, shift)
    np.testing.assert_allclose(moved.gap_m(points @ R.T + shift), cube().gap_m(points), atol=1e-12)


def test_the_hull_of_a_cubes_corners_is_the_cube():
    corners_m = np.array(list(itertools.product((-HALF, HALF), repeat=3))) + np.array([0.01, 0.02, 0.1])
    hull, centre_m = hull_of(np.vstack((corners_m, [[0.02, 0.02, 0.11]])))  # one point inside
    assert centre_m == pytest.approx([0.01, 0.02, 0.1])
    own = hull.moved(np.eye(3), -centre_m)
    assert sorted(tuple(face.normal.round(9) + 0.0) for face in own.faces) == sorted(
        tuple(face.normal.round(9) + 0.0) for face in cube().faces
    )
    assert [face.distance_m for face in own.faces] == pytest.approx([HALF] * 6)
    assert all(len(face.corners_m) == 4 for face in own.faces)


def test_the_centre_of_a_hull_is_that_of_its_volume():
    """A cone's is at a quarter of its height; so is a pyramid's."""
    corners_m = np.array(
        [[1.0, 1.0, 0.0], [-1.0, 1.0, 0.0], [-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 0.0, 2.0]]
    )
    hull, centre_m = hull_of(0.03 * corners_m)
    assert len(hull.faces) == 5
    assert centre_m == pytest.approx([0.0, 0.0, 0.015])


@pytest.mark.parametrize("flat", [np.eye(3)[[0, 0, 0, 1]], np.vstack((np.eye(3), np.eye(3).mean(axis=0)))])
def test_corners_without_a_volume_are_refused(flat):
    with pytest.raises(ValueError, match="no volume"):
        hull_of(0.05 * flat)
