"""Rings -> ellipses -> virtual points (Eq. 1) -> triangles -> area change."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull, Delaunay

from palpate_edge.common.errors import CalibrationError
from palpate_edge.estimation.virtual_points import VirtualPointMesh, ellipse_points, fit_ellipse
from palpate_edge.geometry.triangulation import delaunay

LAYOUTS = {
    "1+6+12+18+24+24": ((1, 0), (6, 0), (12, 15), (18, 0), (24, 7.5), (24, 0)),
    "1+6x14": ((1, 0), *((6, 30 * (ring % 2)) for ring in range(14))),
    "1+7x12": ((1, 0), *((12, 15 * (ring % 2)) for ring in range(7))),
}
ellipses = st.tuples(
    st.floats(100, 500),
    st.floats(100, 400),
    st.floats(40, 300),
    st.floats(40, 300),
    st.floats(0, 180),
)


def rings_px(layout):
    """Circular rings about (320.3, 240.7), the n-th of n times 18 px; (n, 2) places and (n,) ring indices."""
    places, ring_of = [], []
    for ring, (count, first_deg) in enumerate(layout):
        for number in range(count):
            angle = math.radians(first_deg + 360 * number / count)
            places.append((320.3 + 18 * ring * math.cos(angle), 240.7 + 18 * ring * math.sin(angle)))
            ring_of.append(ring)
    return np.array(places), np.array(ring_of, dtype=np.intp)


@pytest.fixture(params=LAYOUTS.values(), ids=LAYOUTS.keys())
def mesh(request):
    places, ring_of = rings_px(request.param)
    return VirtualPointMesh(places, ring_of), places


def everything(places):
    return np.ones(len(places), dtype=bool)


@given(ellipses, st.floats(-math.pi, math.pi), st.integers(6, 30))
def test_points_of_eq_1_lie_on_the_ellipse(ellipse, first_angle_rad, count):
    x, y, width, height, angle_deg = ellipse
    points = ellipse_points(ellipse, first_angle_rad, count) - (x, y)
    turn = math.radians(angle_deg)
    along = points @ (math.cos(turn), math.sin(turn))
    across = points @ (-math.sin(turn), math.cos(turn))
    assert np.allclose((2 * along / width) ** 2 + (2 * across / height) ** 2, 1.0)


@given(ellipses, st.floats(-math.pi, math.pi))
def test_an_ellipse_has_one_set_of_points_however_its_angle_is_told(ellipse, first_angle_rad):
    """(w, h, alpha), (h, w, alpha + 90) and (w, h, alpha + 180) are the same ellipse."""
    x, y, width, height, angle_deg = ellipse
    points = ellipse_points(ellipse, first_angle_rad, 24)
    for other in ((x, y, height, width, angle_deg + 90), (x, y, width, height, angle_deg + 180)):
        assert np.allclose(points, ellipse_points(other, first_angle_rad, 24), atol=1e-9)


@given(st.floats(0, 180), st.floats(-math.pi, math.pi))
def test_labels_on_a_circle_do_not_depend_on_the_fitted_angle(angle_deg, first_angle_rad):
    points = ellipse_points((320, 240, 150, 150, angle_deg), first_angle_rad, 12)
    angles = first_angle_rad + np.radians(30) * np.arange(12)
    expected = np.stack([320 + 75 * np.cos(angles), 240 + 75 * np.sin(angles)], axis=1)
    assert np.allclose(points, expected, atol=1e-9)


@settings(max_examples=50)
@given(ellipses, st.integers(6, 24), st.integers(0, 2**32 - 1))
def test_the_fit_gives_back_the_ellipse_that_the_beads_lie_on(ellipse, count, seed):
    x, y, width, height, angle_deg = ellipse
    t = np.linspace(0, 2 * np.pi, count, endpoint=False) + np.random.default_rng(seed).uniform(0, 6)
    turn = math.radians(angle_deg)
    beads = np.stack(
        [
            x + width / 2 * np.cos(t) * math.cos(turn) - height / 2 * np.sin(t) * math.sin(turn),
            y + width / 2 * np.cos(t) * math.sin(turn) + height / 2 * np.sin(t) * math.cos(turn),
        ],
        axis=1,
    )
    fitted = fit_ellipse(beads)
    assert fitted[:2] == pytest.approx((x, y), abs=0.05)
    assert sorted(fitted[2:4]) == pytest.approx(sorted((width, height)), abs=0.1)


def test_circular_rings_are_their_own_virtual_points(mesh):
    made, places = mesh
    assert np.allclose(made.reference_px, places, atol=0.02)
    assert made.points(places, everything(places)).trusted.all()


def test_triangles_are_the_delaunay_triangles_of_scipy(mesh):
    made, _ = mesh
    random = np.random.default_rng(1)
    points = made.reference_px + random.normal(0, 0.5, made.reference_px.shape)  # no two ways to cut a square
    ours = {tuple(sorted(triangle)) for triangle in delaunay(points)}
    theirs = {tuple(sorted(triangle)) for triangle in Delaunay(points).simplices.tolist()}
    hull = set(ConvexHull(points).vertices.tolist())
    slivers = {triangle for triangle in theirs if set(triangle) <= hull}
    assert ours <= theirs
    assert theirs - ours <= slivers  # flat ones along the outermost ring may be left out


def test_triangles_cover_the_disk_once(mesh):
    made, _ = mesh
    a, b, c = (made.reference_px[made.triangles[:, corner]] for corner in range(3))
    area = 0.5 * np.abs((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
    outline = ConvexHull(made.reference_px).volume  # in a plane scipy's volume is the area
    assert area.sum() == pytest.approx(outline, rel=0.01)
    assert set(made.triangles.ravel()) == set(range(len(made.reference_px)))


@pytest.mark.parametrize("scale", [0.8, 1.0, 1.1, 1.5])
def test_uniform_scaling_by_s_changes_every_area_by_s_squared_minus_one(mesh, scale):
    made, places = mesh
    scaled = (320.3, 240.7) + scale * (places - (320.3, 240.7))
    change = made.area_change(made.points(scaled, everything(places)))
    assert np.allclose(change, scale**2 - 1, atol=2e-3)


def test_translation_and_turning_change_no_area(mesh):
    made, places = mesh
    turn = np.array([[math.cos(0.2), -math.sin(0.2)], [math.sin(0.2), math.cos(0.2)]])
    moved = (places - places.mean(axis=0)) @ turn.T + (300, 260)
    change = made.area_change(made.points(moved, everything(places)))
    assert np.abs(change).max() < 2e-3


def test_mean_area_about_a_point_by_the_shoelace_formula():
    places, ring_of = rings_px(LAYOUTS["1+6+12+18+24+24"])
    made = VirtualPointMesh(places, ring_of)
    moved = places.copy()
    moved[0] += (3.0, -2.0)  # the bead at the apex stands for itself
    points = made.points(moved, everything(places))
    change = made.area_change(points)

    def mean_area(point, where):
        corners = [where[triangle] for triangle in made.triangles if point in triangle]
        return np.mean(
            [
                abs(sum(p[0] * q[1] - q[0] * p[1] for p, q in zip(t, np.roll(t, -1, axis=0), strict=True)))
                / 2
                for t in corners
            ]
        )

    for point in (0, 1, 4, 10, 40, 84):
        expected = mean_area(point, points.position_px) / mean_area(point, made.reference_px) - 1
        assert change[point] == pytest.approx(expected, abs=1e-6)


def test_beads_that_are_not_found_do_not_move_a_ring_of_many():
    places, ring_of = rings_px(LAYOUTS["1+6+12+18+24+24"])
    made, found = VirtualPointMesh(places, ring_of), everything(places)
    found[-12::2] = False
    points = made.points(np.where(found[:, None], places, places + 40), found)
    assert points.trusted.all()
    assert np.allclose(points.position_px, places, atol=0.05)


def test_a_ring_of_six_that_lost_one_bead_takes_its_predicted_place():
    places, ring_of = rings_px(LAYOUTS["1+6x14"])
    made, found = VirtualPointMesh(places, ring_of), everything(places)
    lost = np.flatnonzero(ring_of == 9)[2]
    found[lost] = False
    predicted = places + 12.0  # everything moved alike, so did the lost one
    points = made.points(predicted, found)
    assert points.trusted.all()
    assert np.allclose(points.position_px, places + 12.0, atol=0.05)


def test_a_ring_that_lost_most_of_its_beads_is_not_trusted_and_keeps_its_reference(mesh):
    made, places = mesh
    ring = made.ring_of == made.ring_of.max()
    found = everything(places)
    found[np.flatnonzero(ring)[: int(0.6 * ring.sum()) + 1]] = False
    points = made.points(places + 5.0, found)
    assert (points.trusted == ~ring).all()
    assert np.allclose(points.position_px[ring], made.reference_px[ring])


def test_neighbours_of_the_apex_are_the_first_ring_and_beside_it_are_two_opposite_ones():
    places, ring_of = rings_px(LAYOUTS["1+6+12+18+24+24"])
    made = VirtualPointMesh(places, ring_of)
    assert made.neighbours(0).tolist() == [1, 2, 3, 4, 5, 6]
    before, behind = made.ring_neighbours(0)
    assert np.allclose((places[before] + places[behind]) / 2, places[0])


def test_beside_a_point_are_the_two_next_to_it_on_its_ring():
    places, ring_of = rings_px(LAYOUTS["1+6+12+18+24+24"])
    made = VirtualPointMesh(places, ring_of)
    first, last = 1 + 6 + 12 + 18, 1 + 6 + 12 + 18 + 23
    assert made.ring_neighbours(first) == (last, first + 1)
    assert made.ring_neighbours(last) == (last - 1, first)
    assert made.ring_neighbours(first + 5) == (first + 4, first + 6)


def test_beads_without_a_ring_of_six_are_refused():
    places, ring_of = rings_px(((1, 0), (4, 0), (5, 0)))
    with pytest.raises(CalibrationError, match=r"no ring has 6 beads.*markers\.rings"):
        VirtualPointMesh(places, ring_of)
