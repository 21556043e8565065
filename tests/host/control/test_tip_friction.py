"""The friction ratio of a contact, and what slip and holding do to the estimate of friction."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad

from palpate_host.common.tip_contact import TipContact
from palpate_host.control.tip_friction import TipFriction, friction_ratio

RADIUS_M, K_N_M2 = 0.03, 3e5
FRAME_US = 33_333


def contact(position_mm=(0.0, 0.0, 30.0), normal_N=2.0, shear_N=(0.6, 0.8), torsion_Nmm=None, **changes):
    whole = TipContact(
        received_at_us=0,
        exposed_at_us=0,
        sequence=0,
        latency_us=0,
        position_mm=position_mm,
        normal_force_N=normal_N,
        shear_N=shear_N,
        torsion_Nmm=torsion_Nmm,
        valid=True,
        in_contact=True,
        slip=False,
        quality=255,
    )
    return replace(whole, **changes)


def frame(number, slip=False, delay_us=50_000):
    exposed_at_us = number * FRAME_US
    return contact(exposed_at_us=exposed_at_us, received_at_us=exposed_at_us + delay_us, slip=slip)


def test_the_ratio_is_that_of_the_whole_tangential_force():
    """Two components of a shear that is tangential to the dome determine the third."""
    rng = np.random.default_rng(1)
    for _ in range(50):
        outward = rng.normal(size=3)
        outward[2] = 0.3 + abs(outward[2])
        outward /= np.linalg.norm(outward)
        shear = np.cross(outward, rng.normal(size=3))
        found = friction_ratio(contact(tuple(30.0 * outward), 2.5, tuple(shear[:2])), RADIUS_M, K_N_M2)
        assert found == pytest.approx(np.linalg.norm(shear) / 2.5)


def test_torsion_alone_slips_where_coulombs_integral_slips():
    """Friction times Hertz' pressure over the disk: mu times the integral of p(s) s 2 pi s ds."""
    normal_N, mu = 3.0, 0.5
    a = np.sqrt(RADIUS_M * np.sqrt(normal_N / K_N_M2))
    peak = 3 * normal_N / (2 * np.pi * a**2)
    limit_Nm, _ = quad(lambda s: mu * peak * np.sqrt(1 - (s / a) ** 2) * 2 * np.pi * s**2, 0.0, a)
    twisted = contact(normal_N=normal_N, shear_N=(0.0, 0.0), torsion_Nmm=1e3 * limit_Nm)
    assert friction_ratio(twisted, RADIUS_M, K_N_M2) == pytest.approx(mu, rel=1e-6)
    both = replace(twisted, shear_N=(0.0, 1.2))
    assert friction_ratio(both, RADIUS_M, K_N_M2) == pytest.approx(np.hypot(mu, 0.4), rel=1e-6)
    assert friction_ratio(both, RADIUS_M, 0.0) == pytest.approx(0.4)


@pytest.mark.parametrize(
    "unknown",
    [
        {"valid": False},
        {"in_contact": False},
        {"normal_force_N": None},
        {"shear_N": None},
        {"position_mm": None},
        {"normal_force_N": 0.05},
        {"position_mm": (29.9, 0.0, 1.0)},
    ],
)
def test_what_is_not_known_gives_no_ratio(unknown):
    assert friction_ratio(contact(**unknown), RADIUS_M, K_N_M2) is None
    state = TipFriction(0.4).after_contact(frame(0), None)
    assert (state.ratio, state.margin, state.friction) == (None, None, 0.4)


def test_slip_lowers_the_estimate_below_the_ratio_at_which_it_came():
    state = TipFriction(0.4).after_contact(frame(1, slip=True), 0.3)
    assert state.friction == pytest.approx(0.27)
    assert state.margin == pytest.approx(-0.03)
    assert (state.slips, state.is_lowered) == (1, True)


def test_frames_exposed_before_the_answer_acts_show_the_same_slip():
    """50 ms from exposure to host and 30 ms until the grip acts: of 30 frames/s the next two do not count."""
    state = TipFriction(0.4)
    answered = []
    for number in range(7):
        state = state.after_contact(frame(number, slip=True), 0.3)
        answered.append(state.slips)
    assert answered == [1, 1, 1, 2, 2, 2, 3]


def test_one_false_alarm_costs_a_factor_of_two_and_is_forgotten():
    state = TipFriction(0.4).after_contact(frame(1, slip=True), 0.01)
    assert state.friction == pytest.approx(0.2)
    for _ in range(30_000):  # five minutes of ticks
        state = state.after_tick(0.01)
    assert state.friction == pytest.approx(0.4, abs=0.001)


def test_a_ratio_held_in_five_frames_is_a_lower_bound():
    state = TipFriction(0.4)
    for number, ratio in enumerate([0.50, 0.47, 0.52, 0.46]):
        state = state.after_contact(frame(number), ratio)
    assert state.friction == 0.4
    state = state.after_contact(frame(5), 0.49)
    assert state.friction == 0.46
    state = state.after_contact(frame(6, slip=True), 0.3)
    assert state.friction == pytest.approx(0.27)


def test_the_estimate_is_not_tested_again_and_again():
    """An hour on a skin of 0.3 under a load that always uses all of the estimate: slips become rare."""
    state, slips_at_s = TipFriction(0.4), []
    for number in range(7200):  # 2 frames a second
        is_slip = state.friction > 0.3
        after = state.after_contact(frame(15 * number, slip=is_slip), 0.3 if is_slip else state.friction)
        if after.slips > state.slips:
            slips_at_s.append(number / 2)
        state = after.after_tick(0.5)
    assert len(slips_at_s) <= 12
    assert (np.diff(slips_at_s)[1:] > 8.0).all()
    assert slips_at_s[-1] - slips_at_s[-2] > 600.0
