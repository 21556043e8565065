"""The ramp of a turn and its integral, beside rotations by SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation

from palpate_host.control.turn_ramp import TurnRamp

R_VIR = Rotation.from_euler("xyz", [20, -10, 40], degrees=True).as_matrix()
M = Rotation.from_euler("xyz", [-5, 15, 8], degrees=True).as_matrix()
R_C = R_VIR @ M


def turned_deg(ramp):
    """The rotation vector from the measured orientation to the desired one."""
    return Rotation.from_matrix(ramp.R_d @ R_C.T).as_rotvec(degrees=True)


def test_target_ramps_along_one_axis():
    full = Rotation.from_euler("xyz", [10, 20, 30], degrees=True)
    for share in (0.0, 0.25, 1.0, 2.0):
        ramp = TurnRamp((10.0, 20.0, 30.0), 2.0, 0.0)
        ramp.advance(R_VIR, M, share * 2.0)
        np.testing.assert_allclose(
            np.radians(turned_deg(ramp)), min(1.0, share) * full.as_rotvec(), atol=1e-9
        )
    at_once = TurnRamp((10.0, 20.0, 30.0), 0.0, 0.0)
    at_once.advance(R_VIR, M, 0.0)
    np.testing.assert_allclose(at_once.R_d @ R_C.T, full.as_matrix(), atol=1e-9)


def test_an_eased_ramp_is_the_cubic_that_starts_and_ends_at_rest():
    ramp, ticks = TurnRamp((0.0, 0.0, 30.0), 2.0, 0.0, is_eased=True), 200
    turned = [0.0]
    for _ in range(ticks):
        ramp.advance(R_VIR, M, 2.0 / ticks)
        turned.append(turned_deg(ramp)[2])
    cubic = CubicHermiteSpline([0.0, 2.0], [0.0, 30.0], [0.0, 0.0])
    np.testing.assert_allclose(turned, cubic(np.linspace(0.0, 2.0, ticks + 1)), atol=1e-9)
    assert ramp.share == 1.0
    ramp.advance(R_VIR, M, -1.0)
    np.testing.assert_allclose(turned_deg(ramp), [0.0, 0.0, 15.0], atol=1e-9)


def test_a_ramp_runs_back_and_not_beyond_its_start():
    ramp = TurnRamp((0.0, 20.0, 0.0), 1.0, 0.0)
    assert ramp.R_d is None and ramp.R_d_vir is None
    for dt_s, share in ((0.6, 0.6), (-0.2, 0.4), (-1.0, 0.0), (5.0, 1.0)):
        ramp.advance(R_VIR, M, dt_s)
        assert ramp.share == pytest.approx(share)
        np.testing.assert_allclose(turned_deg(ramp), [0.0, 20.0 * share, 0.0], atol=1e-9)
        np.testing.assert_allclose(ramp.R_d_vir @ M, ramp.R_d, atol=1e-12)  # Eq. (15)


def test_a_ramp_goes_on_from_an_orientation_that_was_led_elsewhere():
    ramp = TurnRamp((0.0, 0.0, 0.0), 0.0, 0.0)
    ramp.advance(R_VIR, M, 0.01)
    led = Rotation.from_euler("z", 50.0, degrees=True).as_matrix() @ R_C
    ramp.lead_elsewhere(led)
    np.testing.assert_array_equal(ramp.R_d, led)
    ramp.begin((0.0, 0.0, 10.0), 2.0)
    ramp.advance(R_VIR, M, 1.0)
    np.testing.assert_allclose(turned_deg(ramp), [0.0, 0.0, 55.0], atol=1e-9)


def test_a_forgotten_ramp_starts_from_the_measured_orientation_and_without_integral():
    ramp = TurnRamp((0.0, 0.0, 10.0), 0.0, 0.5)
    ramp.advance(R_VIR, M, 0.1)
    trimmed = Rotation.from_matrix(ramp.R_d_vir @ M @ R_C.T).as_rotvec(degrees=True)
    np.testing.assert_allclose(trimmed, [0.0, 0.0, 10.5], atol=1e-9)  # 10 deg for 0.1 s at 0.5/s
    ramp.forget()
    assert ramp.R_d is None and ramp.R_d_vir is None
    elsewhere = Rotation.from_euler("x", 30.0, degrees=True).as_matrix()
    ramp.advance(elsewhere, np.eye(3), 0.0)
    turn = Rotation.from_matrix(ramp.R_d_vir @ elsewhere.T).as_rotvec(degrees=True)
    np.testing.assert_allclose(turn, [0.0, 0.0, 10.0], atol=1e-9)
