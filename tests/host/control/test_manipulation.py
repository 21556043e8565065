"""What the controller remembers from tick to tick: the integral, and where a held object is to stay."""

import msgspec
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from palpate_host.common.mode import Mode
from palpate_host.common.tip_contact import TipContact
from palpate_host.control.manipulation import Manipulation
from palpate_host.control.turn_ramp import TRIM_LIMIT_RAD
from palpate_host.control.virtual_frame import virtual_frame

START_RAD = np.tile([0.0, 0.348, 1.221], 3)
STILL = np.zeros(9)
APEX = (0.0, 0.0, 30.0)
TICK_S = 0.01


def touch(exposed_at_us, in_contact=True):
    return TipContact(
        received_at_us=exposed_at_us,
        exposed_at_us=exposed_at_us,
        sequence=0,
        latency_us=0,
        position_mm=APEX,
        normal_force_N=1.0,
        shear_N=(0.0, 0.0),
        torsion_Nmm=0.0,
        valid=True,
        in_contact=in_contact,
        slip=False,
        quality=255,
    )


@pytest.fixture
def holding(table_4):
    """Makes a controller that holds an object at all three apexes, and the hand's pose."""
    config, hand = table_4
    pose = hand.pose(START_RAD)

    def make(ramp_s=0.0, **control):
        target = msgspec.structs.replace(config.target, rpy_deg=(0.0, 0.0, 10.0), ramp_s=ramp_s)
        changed = msgspec.structs.replace(config.control, **control)
        manipulation = Manipulation(msgspec.structs.replace(config, control=changed, target=target))
        for frame in range(6):
            for finger in range(3):
                manipulation.add_contact(finger, touch(frame * 33_333), pose)
        return manipulation, pose

    return make


def tick(manipulation, pose, mode=Mode.MANIPULATE, ticks=1):
    for _ in range(ticks):
        torque = manipulation.torque_Nm(mode, pose, STILL, virtual_frame(pose.tip_centre_m), TICK_S)
    return torque


def trim_deg(manipulation, pose):
    """How far R_d_vir is turned beyond what Eq. (15) asks for."""
    plain = manipulation.R_d @ manipulation.M.T
    return np.degrees(Rotation.from_matrix(manipulation.R_d_vir @ plain.T).as_rotvec())


def test_without_integral_the_target_is_eq_15s(holding):
    manipulation, pose = holding()
    tick(manipulation, pose, ticks=50)
    np.testing.assert_allclose(trim_deg(manipulation, pose), 0.0, atol=1e-9)


def test_the_integral_grows_with_error_and_time_up_to_its_bound(holding):
    """10 deg missing, 0.5/s: 0.5 deg after 0.1 s; after a long jam 15 deg and no more."""
    manipulation, pose = holding(integral_per_s=0.5)
    tick(manipulation, pose, ticks=10)
    np.testing.assert_allclose(trim_deg(manipulation, pose), [0.0, 0.0, 0.5], atol=1e-6)
    tick(manipulation, pose, ticks=1000)
    np.testing.assert_allclose(trim_deg(manipulation, pose), [0, 0, np.degrees(TRIM_LIMIT_RAD)], atol=1e-6)
    assert pytest.approx(15.0) == np.degrees(TRIM_LIMIT_RAD)


def test_the_integral_begins_where_the_ramp_ends(holding):
    """Tenths of a second after a ramp of 1 s: 10 deg missing at 0.5/s."""
    manipulation, pose = holding(ramp_s=1.0, integral_per_s=0.5)
    tick(manipulation, pose, ticks=99)
    np.testing.assert_allclose(trim_deg(manipulation, pose), 0.0, atol=1e-9)
    tick(manipulation, pose, ticks=21)
    np.testing.assert_allclose(trim_deg(manipulation, pose), [0.0, 0.0, 1.05], atol=0.051)


def test_what_rests_begins_its_next_turn_without_the_integral_of_the_last(holding):
    manipulation, pose = holding(integral_per_s=0.5)
    tick(manipulation, pose, ticks=100)
    assert trim_deg(manipulation, pose)[2] > 4.0
    manipulation.stop_turning()
    manipulation.turn((0.0, 0.0, 10.0), 1.0)
    tick(manipulation, pose)
    np.testing.assert_allclose(trim_deg(manipulation, pose), 0.0, atol=1e-9)


def test_a_frozen_frame_freezes_the_integral(holding):
    manipulation, pose = holding(integral_per_s=0.5)
    tick(manipulation, pose, ticks=10)
    before = manipulation.R_d_vir.copy()
    tick(manipulation, pose, mode=Mode.BLIND, ticks=100)
    np.testing.assert_array_equal(manipulation.R_d_vir, before)


def test_a_held_object_is_carried_and_kept_where_it_was_taken(holding, table_4):
    """The torques' difference is J^T of a third of the weight and of the spring at each tip."""
    plain, pose = holding()
    carrying, _ = holding(object_weight_N=0.9, position_stiffness_N_m=100.0)
    third = np.array([0.0, 0.0, 0.3])
    lift = np.einsum("iaj,a->j", pose.tip_jacobian_m, third)
    np.testing.assert_allclose(
        tick(carrying, pose, Mode.HOLD) - tick(plain, pose, Mode.HOLD), lift, atol=1e-12
    )
    sunk = table_4[1].pose(START_RAD + 0.05)
    down = pose.tip_centre_m.mean(axis=0) - sunk.tip_centre_m.mean(axis=0)
    expected = np.einsum("iaj,a->j", sunk.tip_jacobian_m, third + 100.0 * down / 3.0)
    np.testing.assert_allclose(
        tick(carrying, sunk, Mode.HOLD) - tick(plain, sunk, Mode.HOLD), expected, atol=1e-12
    )


def test_empty_fingers_carry_nothing_and_take_a_new_place(holding, table_4):
    carrying, pose = holding(object_weight_N=0.9, position_stiffness_N_m=100.0)
    plain, _ = holding()
    tick(carrying, pose, Mode.HOLD)
    for manipulation in (carrying, plain):
        for exposed_at_us in (300_000, 450_000):
            manipulation.add_contact(0, touch(exposed_at_us, in_contact=False), pose)
    np.testing.assert_array_equal(tick(carrying, pose, Mode.HOLD), tick(plain, pose, Mode.HOLD))
    elsewhere = table_4[1].pose(START_RAD + 0.05)
    for frame in range(6):
        for finger in range(3):
            for manipulation in (carrying, plain):
                manipulation.add_contact(finger, touch(500_000 + frame * 33_333), elsewhere)
    lift = np.einsum("iaj,a->j", elsewhere.tip_jacobian_m, np.array([0.0, 0.0, 0.3]))
    difference = tick(carrying, elsewhere, Mode.HOLD) - tick(plain, elsewhere, Mode.HOLD)
    np.testing.assert_allclose(difference, lift, atol=1e-12)
