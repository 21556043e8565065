"""The sphere through touches, the onset of a force, and the labels' geometry, against analytic cases."""

from __future__ import annotations

import math

import numpy as np
import pytest

from palpate_edge.common.errors import RigError
from palpate_edge.press_rig.dome_place import DomePlace, outward
from palpate_edge.press_rig.sphere_fit import check_fit, fit_place, onset_mm
from palpate_edge.press_rig.weighed_force import cone_bounds_N, forces_from_weights, rotation_between

TRUE = DomePlace((101.0, 99.0, 20.0), 35.2)
GUESS = DomePlace((96.0, 99.0, 22.0), 35.0)


def _touches(late_mm: float = 0.0) -> np.ndarray:
    sides = [(0.0, 0.0), *((math.radians(55), side * math.pi / 3) for side in range(6))]
    return np.array([TRUE.ball_mm(theta, azimuth, late_mm) for theta, azimuth in sides])


def test_touches_give_the_sphere() -> None:
    place, residual_mm = fit_place(_touches(), GUESS, free_reach=True)
    assert place.centre_mm == pytest.approx(TRUE.centre_mm, abs=1e-6)
    assert place.reach_mm == pytest.approx(TRUE.reach_mm, abs=1e-6)
    assert residual_mm < 1e-6


def test_touches_that_are_late_alike_change_the_distance_and_not_the_centre() -> None:
    place, _ = fit_place(_touches(late_mm=0.1), GUESS, free_reach=True)
    assert place.centre_mm == pytest.approx(TRUE.centre_mm, abs=1e-6)
    assert place.reach_mm == pytest.approx(TRUE.reach_mm - 0.1, abs=1e-6)


@pytest.mark.parametrize(
    ("place", "residual_mm", "message"),
    [(TRUE, 0.5, "0.50 mm rms off a sphere"), (DomePlace((0, 0, 0), 33.0), 0.0, "measure 33.00 mm")],
)
def test_another_surface_is_refused(place: DomePlace, residual_mm: float, message: str) -> None:
    with pytest.raises(RigError, match=message):
        check_fit(place, residual_mm, 35.0)


def test_the_onset_of_a_stiffening_force_is_where_it_is_zero() -> None:
    force_N = np.linspace(0.02, 0.25, 7)
    travel_mm = 1.7 + 3 * force_N - 2 * force_N**2
    assert onset_mm(travel_mm, force_N) == pytest.approx(1.7)


def test_the_ball_goes_round_the_dome() -> None:
    for azimuth in np.linspace(0, 2 * math.pi, 7):
        start, end = TRUE.ball_mm(1.1, 0.0, -2.0), TRUE.ball_mm(0.8, azimuth, -2.0)
        z_mm = TRUE.bypass_z_mm(start, end, 2.0)
        way = start + np.linspace(0, 1, 50)[:, None] * (end - start)
        way[:, 2] = z_mm
        nearest_mm = np.linalg.norm(way - TRUE.centre_mm, axis=1).min()
        assert nearest_mm >= TRUE.reach_mm + 2.0 - 1e-9
        assert z_mm <= TRUE.centre_mm[2] + TRUE.reach_mm + 2.0 + 1e-9


def test_a_frictionless_press_has_one_normal_force_and_a_stuck_one_a_range() -> None:
    up, weight_N = np.array([0.0, 0.0, 1.0]), np.array([1.0, 1.0])
    sides = np.array([outward(0.0, 0.0), outward(math.radians(60), 0.0)])
    for bound in cone_bounds_N(sides, up, weight_N, 0.0):
        assert bound == pytest.approx([1.0, 2.0])  # weight / cos
    low_N, high_N = cone_bounds_N(sides, up, weight_N, 0.5)
    assert low_N == pytest.approx([1.0, 1 / (0.5 + 0.5 * math.sqrt(0.75))])
    assert high_N == pytest.approx([1.0, 1 / (0.5 - 0.5 * math.sqrt(0.75))])
    assert np.isnan(cone_bounds_N(sides, up, weight_N, 1.0)[1][1])


def test_weights_give_the_stiffness_of_the_models_forces() -> None:
    rng = np.random.default_rng(3)
    true_N = rng.normal(size=(200, 3)) * 0.3 - [0, 0, 1.5]
    weight_N = -true_N[:, 2] + 0.005 * rng.standard_normal(200)
    force_N, spread = forces_from_weights(
        true_N / 12, np.array([0.0, 0.0, 1.0]), weight_N, np.full(200, 0.005)
    )
    assert spread == pytest.approx(0.02)
    assert np.sqrt(((force_N - true_N) ** 2).mean()) < 0.005


def test_a_wrong_factor_of_one_force_is_corrected_by_its_weight() -> None:
    rng = np.random.default_rng(4)
    true_N = rng.normal(size=(200, 3)) * 0.3 - [0, 0, 1.5]
    model = true_N * rng.normal(1.0, 0.1, (200, 1))
    force_N, _ = forces_from_weights(model, np.array([0.0, 0.0, 1.0]), -true_N[:, 2], np.full(200, 0.005))
    off = np.linalg.norm(force_N - true_N, axis=1).mean()
    assert off < 0.3 * np.linalg.norm(model - true_N, axis=1).mean()


def test_the_rotation_between_directions_withstands_wrong_ones() -> None:
    rng = np.random.default_rng(5)
    seen = rng.normal(size=(100, 3))
    seen /= np.linalg.norm(seen, axis=1, keepdims=True)
    angle = math.radians(3)
    turn = np.array(
        [[math.cos(angle), -math.sin(angle), 0], [math.sin(angle), math.cos(angle), 0], [0, 0, 1]]
    )
    moved = seen @ turn.T
    moved[:5] = -moved[:5]
    assert rotation_between(seen, moved) == pytest.approx(turn, abs=1e-3)
