"""The same hand at every tick rate, and hands of four and five fingers."""

import msgspec
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from palpate_host.common.mode import Mode
from palpate_host.config import hand_reader
from palpate_host.control.control_law import grasp_force_N, orientation_force_N
from palpate_host.control.gains import gains_of
from palpate_host.control.hand_model import model_of, source_of
from palpate_host.control.kinematics import HandKinematics
from palpate_host.control.virtual_frame import (
    check_numbering,
    contact_frame,
    fit_contact_frame,
    virtual_frame,
)


@pytest.mark.parametrize("tick_Hz", [100, 250, 500, pytest.param(1000, marks=pytest.mark.slow)])
def test_every_rate_turns_the_target_in_the_same_time(bench, table_4, tick_Hz):
    """2 s of ramp to 10 deg of yaw: 1.3 s after turning began, R_d has turned by 6.5 deg at every rate."""
    config, hand = table_4
    config = msgspec.structs.replace(config, control=msgspec.structs.replace(config.control, tick_Hz=tick_Hz))
    rig = bench.VirtualBench(config, hand)
    rig.run(1.3)
    began = next(status for status in rig.statuses if status.mode is Mode.MANIPULATE)
    status = rig.run((began.time_us + 1_300_000 - rig.now_us) * 1e-6)
    assert status.mode is Mode.MANIPULATE
    turned = Rotation.from_matrix(np.array(status.R_d) @ np.array(began.R_d).T).as_rotvec(degrees=True)
    np.testing.assert_allclose(turned, [0.0, 0.0, 6.5], atol=0.06)
    assert status.counters.late_ticks == 0
    period_us = 1_000_000 // tick_Hz
    assert {b.time_us - a.time_us for a, b in zip(rig.statuses, rig.statuses[1:], strict=False)} == {
        period_us
    }


def hand_of(tmp_path, bench, count):
    """Table 4's finger, `count` times around the palm."""
    text = bench.TABLE_4.read_text().replace('start = "command"', 'start = "auto"')
    head, *_ = text.split("[[fingers]]")
    first = text.split("[[fingers]]")[1]
    azimuths = [360.0 * number / count for number in range(count)]
    head = head.replace("[0.0, 120.0, 240.0]", str(azimuths))
    head = head.replace('["tip_1", "tip_2", "tip_3"]', str([f"tip_{n + 1}" for n in range(count)]))
    fingers = []
    for number in range(count):
        finger = first.replace("finger-1", f"finger-{number + 1}").replace("0x10", f"0x{0x10 + number:02X}")
        for joint in (3, 2, 1):
            finger = finger.replace(
                f"drive_node = {joint},", f"drive_node = 0x{0x20 + 3 * number + joint:02X},"
            )
        fingers.append(finger.replace('_1"', f'_{number + 1}"'))
    path = tmp_path / "hand.toml"
    path.write_text("[[fingers]]".join([head, *fingers]))
    config = hand_reader.load(path)
    joints = [joint.name for joint in config.joints]
    return config, HandKinematics(model_of(config), joints, config.model.tip_sites, source_of(config))


@pytest.mark.parametrize("count", [4, 5])
def test_more_fingers_than_three_grasp_and_turn(tmp_path, bench, count):
    config, hand = hand_of(tmp_path, bench, count)
    rig = bench.VirtualBench(config, hand)
    status = rig.run(1.5)
    assert status.mode is Mode.MANIPULATE and len(status.fingers) == count
    assert np.isclose(np.linalg.det(np.array(status.R_d_vir)), 1.0)
    tips = rig.pose().tip_centre_m
    check_numbering(tips)
    gains = gains_of(config)
    grasp = grasp_force_N(tips, gains)
    np.testing.assert_allclose(grasp.sum(axis=0), 0.0, atol=1e-12)
    # Each tip is pulled with f_d rho/(n r), Eq. (10) with n in the place of 3.
    rho = np.linalg.norm(tips - tips.mean(axis=0), axis=1)
    np.testing.assert_allclose(np.linalg.norm(grasp, axis=1), 4.0 * rho / (count * 0.030), rtol=1e-12)
    turn = orientation_force_N(tips, np.eye(3), Rotation.from_rotvec([0, 0, 0.1]).as_matrix(), gains)
    np.testing.assert_allclose(turn.sum(axis=0), 0.0, atol=1e-12)
    assert np.cross(tips - tips.mean(axis=0), turn).sum(axis=0)[2] > 0.0


@pytest.mark.parametrize("count", [3, 4, 5, 8])
def test_frames_of_n_fingers_turn_with_the_hand(count):
    """Any rotation of tips and normals is a rotation of R_vir and R_c by the same (scipy's)."""
    rng = np.random.default_rng(count)
    angle = 2 * np.pi * np.arange(count) / count
    tips = np.column_stack((np.cos(angle), np.sin(angle), 0.1 * rng.normal(size=count)))
    normals = tips / np.linalg.norm(tips, axis=1, keepdims=True)
    R = Rotation.random(random_state=count).as_matrix()
    np.testing.assert_allclose(virtual_frame(tips @ R.T), R @ virtual_frame(tips), atol=1e-12)
    np.testing.assert_allclose(contact_frame(normals @ R.T), R @ contact_frame(normals), atol=1e-12)
    np.testing.assert_allclose(fit_contact_frame(normals, normals @ R.T), R, atol=1e-12)
    frame = virtual_frame(tips)
    np.testing.assert_allclose(frame.T @ frame, np.eye(3), atol=1e-12)
