"""The 95 % radii of the object's pose."""

import numpy as np
import pytest

from palpate_host.control.holding.pose_uncertainty import PoseUncertainty


def test_the_radius_of_the_orientation_holds_95_percent_of_a_simulated_estimate():
    """Three orthogonal normals, each with its own references, turn an estimate by a share of their error."""
    rng = np.random.default_rng(3)
    scatter_rad, references, share, runs = 0.01, 5, 1.0 / 15.0, 2000
    normals = np.eye(3)
    offset = scatter_rad / np.sqrt(references) * rng.normal(size=(runs, 3, 3))
    estimate = np.zeros((runs, 3))
    state = PoseUncertainty()
    for _ in range(100):
        for finger, normal in enumerate(normals):
            measured = offset[:, finger] + scatter_rad * rng.normal(size=(runs, 3))
            # A small rotation w moves the normal by w x n; the part along n cannot be seen.
            off = np.cross(normal, measured - np.cross(estimate, normal))
            estimate += share * off
            state = state.after_normal(float(np.linalg.norm(off[0])))
    radius_deg = state.orientation95_deg(3, references, share)
    found_deg = np.degrees(np.quantile(np.linalg.norm(estimate, axis=1), 0.95))
    assert radius_deg == pytest.approx(found_deg, rel=0.25)


def test_the_scatter_is_that_of_the_residuals():
    rng = np.random.default_rng(4)
    state = PoseUncertainty()
    for _ in range(600):
        state = state.after_normal(float(np.hypot(*(0.002 * rng.normal(size=2)))))
    assert np.sqrt(state.normal_variance) == pytest.approx(0.002, rel=0.25)


def test_slip_makes_the_place_less_certain_for_good():
    state = PoseUncertainty()
    before_mm = state.place95_mm(0.0)
    assert state.place95_mm(10.0) > before_mm
    assert state.after_slip().after_normal(0.001).place95_mm(0.0) >= before_mm + 1.0
