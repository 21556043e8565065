"""The stiffness from weighed presses, against sensors whose stiffness is set."""

from __future__ import annotations

import numpy as np
import pytest

from palpate_edge.calibration.training.apex_stiffness import apex_stiffness, typical_force_interval
from palpate_edge.calibration.training.dome_model import DomeModel
from palpate_edge.calibration.training.kernel_ridge import fit
from palpate_edge.calibration.training.samples import WeighedSamples

TRUE_SCALE = 0.37


@pytest.fixture(scope="module")
def dome(problem):
    presses = problem.samples(150, seed=1)
    return DomeModel(presses.fields, presses.directions, presses.forces_N, 26.5)


def near_apex(problem, seed, scale=TRUE_SCALE):
    presses = problem.samples(400, seed)
    chosen = presses.directions[:, 2] > np.cos(np.radians(25))
    normal_N = -(presses.forces_N * presses.directions).sum(axis=1)
    return WeighedSamples(presses.fields[chosen], scale * normal_N[chosen])


def test_a_sensor_of_another_stiffness_is_weighed(problem, dome):
    """The problem's stiffness is the same everywhere, so weights near the apex give all forces."""
    weighed = near_apex(problem, seed=2)
    assert 10 < len(weighed.normal_N) < 100
    regression = fit(None, dome, 30.0, weighed=weighed)
    assert regression.stiffness_scale == pytest.approx(TRUE_SCALE, rel=0.02)
    assert regression.apex.spread < 0.05
    unseen = problem.samples(100, seed=3, stiffness=TRUE_SCALE)
    direction, force_N, _ = regression.predict(unseen.fields, np.zeros(100))
    missed_N = np.linalg.norm(force_N - unseen.forces_N, axis=1)
    assert np.sqrt((missed_N**2).mean()) < 0.06 * np.linalg.norm(unseen.forces_N, axis=1).max()
    untaught, _, _ = fit(None, dome, 30.0).predict(unseen.fields, np.zeros(100))
    np.testing.assert_allclose(direction, untaught, atol=1e-12)


def test_one_wrong_weight_is_seen_in_the_spread(problem, dome):
    weighed = near_apex(problem, seed=2)
    weighed.normal_N[0] += weighed.normal_N.max()  # one weight more on the pan than in the table
    assert fit(None, dome, 30.0, weighed=weighed).apex.spread > 0.05


def test_placed_presses_without_forces_take_theirs_from_the_weights(problem, dome):
    """Places are learned from the presses, stiffness from the weights."""
    presses = problem.samples(40, seed=4)
    blank = type(presses)(
        **{**{n: getattr(presses, n) for n in presses.__slots__}, "forces_N": np.zeros((40, 3))}
    )
    regression = fit(blank, dome, 30.0, weighed=near_apex(problem, seed=2))
    assert regression.stiffness_scale == pytest.approx(TRUE_SCALE, rel=0.02)
    unseen = problem.samples(100, seed=3, stiffness=TRUE_SCALE)
    _, force_N, _ = regression.predict(unseen.fields, np.zeros(100))
    missed_N = np.linalg.norm(force_N - unseen.forces_N, axis=1)
    assert np.sqrt((missed_N**2).mean()) < 0.06 * np.linalg.norm(unseen.forces_N, axis=1).max()


def test_forces_of_placed_presses_count_before_weights(problem, dome):
    presses = problem.samples(40, seed=4, stiffness=2.0)
    regression = fit(presses, dome, 30.0, weighed=near_apex(problem, seed=2))
    assert regression.apex is None
    assert regression.stiffness_scale == pytest.approx(2.0, rel=0.02)


def test_stiffness_by_hand():
    """Fields of 2 and 4 mm whose model has 0.5 N/mm inwards: 1 N and 2 N; the scale shows 3 N and 6 N."""
    weighed = WeighedSamples(np.array([[2.0, 0.0], [0.0, 4.0]]), np.array([3.0, 6.0]))
    answers = np.array([[0, 0, 2.0, 0.3, 0, -0.5], [0, 0, 0.5, 0, 0, -0.5]])
    found = apex_stiffness(answers, weighed)
    assert (found.scale, found.spread) == (pytest.approx(3.0), pytest.approx(0.0, abs=1e-12))


def test_the_radius_of_the_force_grows_with_scale_and_size(dome):
    soft, stiff = typical_force_interval(dome, 0.1), typical_force_interval(dome, 0.2)
    none = np.zeros(1)
    small, large = np.full((1, 24), 0.1), np.full((1, 24), 0.4)
    assert stiff.half_width(small, none) == pytest.approx(2 * soft.half_width(small, none))
    assert soft.half_width(large, none) > soft.half_width(small, none)
    assert soft.half_width(large, none + 0.3) > soft.half_width(large, none)
