"""The hand that the page draws, against the kinematics of the controller."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from palpate_host.console.hand_scene import SceneMaker

RADIUS_MM = 30.0


@pytest.fixture
def scene_and_pose(bench, table_4):
    """Scene of a hand whose first finger is touched at the apex and whose second one is not touched."""
    config, hand = table_4
    status = bench.VirtualBench(config, hand).run(0.5)
    first, second, *others = status.fingers
    touched = replace(first, in_contact=True, position_mm=(0.0, 0.0, RADIUS_MM), normal_force_N=2.0)
    free = replace(second, in_contact=False, position_mm=None)
    status = replace(status, fingers=(touched, free, *others))
    q_rad = np.array([joint.position_rad for joint in status.joints])
    return SceneMaker(config).of(status), hand.pose(q_rad), status, config


def test_domes_contacts_and_forces_are_where_the_controller_has_them(scene_and_pose):
    scene, pose, _, config = scene_and_pose
    radius_m = config.control.tip_radius_m
    for index, finger in enumerate(scene.fingers):
        assert finger.chain_m[-1] == pytest.approx(pose.tip_centre_m[index], abs=1e-5)
        axis = pose.tip_rotation[index][:, 2]
        assert finger.apex_m == pytest.approx(pose.tip_centre_m[index] + radius_m * axis, abs=2e-5)
    touched, free = scene.fingers[:2]
    axis = pose.tip_rotation[0][:, 2]
    assert touched.contact_m == pytest.approx(pose.tip_centre_m[0] + 1e-3 * RADIUS_MM * axis, abs=2e-5)
    assert touched.force_N == pytest.approx(-2.0 * axis, abs=1e-4)  # inwards
    assert free.contact_m is None and free.force_N is None


def test_links_keep_their_lengths_and_an_unknown_joint_gives_no_scene(scene_and_pose, bench):
    scene, _, status, config = scene_and_pose

    def lengths(one):
        return [np.linalg.norm(np.diff(np.array(finger.chain_m), axis=0), axis=1) for finger in one.fingers]

    turned = replace(
        status, joints=tuple(replace(joint, position_rad=joint.position_rad + 0.2) for joint in status.joints)
    )
    maker = SceneMaker(config)
    for before, after in zip(lengths(scene), lengths(maker.of(turned)), strict=True):
        assert after == pytest.approx(before, abs=5e-5)
    unknown = replace(status, joints=(replace(status.joints[0], position_rad=None), *status.joints[1:]))
    assert maker.of(unknown) is None
