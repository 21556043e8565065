"""Contact position (Eq. 2), force (Eq. 3) and the two fitted polynomials."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate_edge.estimation.paper_method import (
    MAX_THETA_RAD,
    MIN_AREA_STEP,
    PaperModel,
    corrected_theta,
    fit_paper_model,
    normal_force,
    on_dome,
    raw_contact,
)
from palpate_edge.estimation.virtual_points import VirtualPoints
from palpate_edge.geometry.sensor import Camera, View

VIEW = View(Camera(640, 480, (380.0, 380.0, 320.0, 240.0), (0.0, 0.0, -45.0)))
BEADS_RADIUS_MM = 26.5


class HexagonMesh:
    """vp_1 at the image's centre, vp_2..vp_7 on a hexagon of 40 px about it, with areas set by hand."""

    reference_px = np.array(
        [(320.0, 240.0)]
        + [
            (320 + 40 * math.cos(math.radians(60 * k)), 240 + 40 * math.sin(math.radians(60 * k)))
            for k in range(6)
        ]
    )

    def __init__(self, change):
        self._change = np.array(change, dtype=float)

    def area_change(self, _points):
        return self._change.copy()

    def neighbours(self, point):
        return np.array([k for k in range(7) if k != point])

    def ring_neighbours(self, _point):
        return 1, 4


def resting(mesh, trusted=None):
    mask = np.ones(7, dtype=bool) if trusted is None else np.array(trusted)
    return VirtualPoints(mesh.reference_px.copy(), (), mask)


def test_eq_2_by_hand():
    # 1/(0.5 - 0.25) = 4 for the point at 0 deg, 1/(0.5 - 0) = 2 for the five others: D = 14.
    # The hexagon's corners sum to zero about its centre, so P_c = centre + (4 - 2)/14 of the first corner.
    mesh = HexagonMesh([0.5, 0.25, 0, 0, 0, 0, 0])
    raw = raw_contact(mesh, resting(mesh), VIEW, BEADS_RADIUS_MM)
    assert raw.centre == 0
    assert raw.point_px == pytest.approx([320 + 40 * 2 / 14, 240])
    # The ray through that pixel meets the sphere of 26.5 mm where x = (z + 45) t, x^2 + z^2 = 26.5^2.
    t = (40 * 2 / 14) / 380
    z = (-45 * t**2 + math.sqrt(45**2 * t**4 - (1 + t**2) * (45**2 * t**2 - 26.5**2))) / (1 + t**2)
    assert raw.theta_rad == pytest.approx(math.atan2((z + 45) * t, z), rel=1e-6)
    assert raw.phi_rad == pytest.approx(0, abs=1e-9)


def test_eq_2_a_neighbour_that_changed_as_much_as_the_centre_weighs_bounded():
    mesh = HexagonMesh([0.5, 0.5, 0, 0, 0, 0, 0])
    raw = raw_contact(mesh, resting(mesh), VIEW, BEADS_RADIUS_MM)
    first, other = 1 / MIN_AREA_STEP, 2.0
    assert raw.point_px == pytest.approx([320 + 40 * (first - other) / (first + 5 * other), 240])


def test_eq_2_leaves_out_points_that_cannot_be_trusted():
    mesh = HexagonMesh([9, 0.5, 0.25, 0.25, 0.25, 0.25, 0.25])
    raw = raw_contact(mesh, resting(mesh, [False] + 6 * [True]), VIEW, BEADS_RADIUS_MM)
    assert raw.centre == 1
    assert raw.point_px == pytest.approx(mesh.reference_px[2:].mean(axis=0))


def test_eq_3_is_the_growth_of_both_distances():
    mesh = HexagonMesh([0.5, 0, 0, 0, 0, 0, 0])
    points = resting(mesh)
    points.position_px[1] += (9, 0)  # 40 -> 49
    points.position_px[4] += (-1, 0)  # 40 -> 41
    raw = raw_contact(mesh, points, VIEW, BEADS_RADIUS_MM)
    assert raw.spread_px == pytest.approx(10)
    assert normal_force(PaperModel(stiffness_N_px=(0.2, 0.1)), 0.5, raw.spread_px) == pytest.approx(2.5)


def test_force_is_never_negative_and_unknown_without_a_stiffness():
    assert normal_force(PaperModel(stiffness_N_px=(0.2,)), 0.3, -4.0) == 0
    assert normal_force(PaperModel(), 0.3, 4.0) is None


def test_the_empty_correction_changes_nothing_and_the_rim_bounds_it():
    assert corrected_theta(PaperModel(), 0.7) == 0.7
    assert corrected_theta(PaperModel(theta=(1.0,)), 0.5) == pytest.approx(0.75)
    assert corrected_theta(PaperModel(theta=(5.0,)), 1.5) == pytest.approx(MAX_THETA_RAD)
    assert corrected_theta(PaperModel(theta=(-5.0,)), 1.5) == 0


@given(st.floats(0, math.pi / 2), st.floats(-math.pi, math.pi))
def test_points_on_the_dome_have_its_radius_and_their_angles(theta_rad, phi_rad):
    x, y, z = on_dome(theta_rad, phi_rad, 30.0)
    assert math.hypot(x, y, z) == pytest.approx(30)
    assert z == pytest.approx(30 * math.cos(theta_rad), abs=1e-9)
    assert x * math.sin(phi_rad) == pytest.approx(y * math.cos(phi_rad), abs=1e-9)
    assert x * math.cos(phi_rad) + y * math.sin(phi_rad) >= -1e-9


def test_fit_recovers_known_polynomials():
    random = np.random.default_rng(4)
    raw, spread_px = random.uniform(0.02, 1.3, 400), random.uniform(1, 12, 400)
    true = raw * (1 - 0.15 * raw + 0.06 * raw**2)
    force_N = (0.2 + 0.05 * true - 0.03 * true**2) * spread_px
    model = fit_paper_model(raw, true, spread_px, force_N)
    for angle in np.linspace(0.05, 1.25, 7):
        wanted = angle * (1 - 0.15 * angle + 0.06 * angle**2)
        assert corrected_theta(model, angle) == pytest.approx(wanted, abs=0.002)
        stiffness = 0.2 + 0.05 * angle - 0.03 * angle**2
        assert normal_force(model, angle, 8.0) == pytest.approx(8 * stiffness, rel=0.01)


@pytest.mark.parametrize("count", range(1, 9))
def test_fit_of_a_handful_of_presses_stays_near_them(count):
    raw = np.linspace(0.2, 1.0, count)
    model = fit_paper_model(raw, 0.9 * raw, np.full(count, 5.0), np.full(count, 1.0))
    for angle in raw if count > 1 else ():
        assert corrected_theta(model, angle) == pytest.approx(0.9 * angle, abs=0.1)
        assert normal_force(model, 0.9 * angle, 5.0) == pytest.approx(1.0, abs=0.1)


def test_fit_of_no_press_is_the_empty_model():
    none = np.zeros(0)
    assert fit_paper_model(none, none, none, none) == PaperModel()
