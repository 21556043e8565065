"""The margin of place and orientation together, against a simulation of the delayed loop."""

import numpy as np
import pytest
from tests.host.control.gait.gait_hand import loaded, start_rad

from palpate_host.control.gains import gains_of
from palpate_host.control.holding.stable_stiffness import (
    COUPLED_MARGIN,
    DELAY_TICKS,
    coupled_margin,
    object_damping,
    stable_stiffness,
)
from palpate_host.control.holding.virtual_object import grip_of

TICK_S = 0.01
PARTS = 50


def lifted_grasp(share):
    """The hand of four fingers in its start pose around its object; damping of the object, and its place."""
    config, hand = loaded()
    pose = hand.pose(start_rad())
    place_m = np.array(config.twin.object.position_m)
    outward = (pose.tip_centre_m - place_m) * (1.0, 1.0, 0.0)
    normal = outward / np.linalg.norm(outward, axis=1, keepdims=True)
    grip = grip_of(pose.tip_centre_m, normal, np.full((4, 1), 0.028), np.array(share))
    return config, pose, grip, object_damping(pose, grip, gains_of(config).B_Nms_rad), place_m


def growth(D, K, seconds=3.0):
    """Return how much D dx/dt = -K x(t - T) grows in the second half of `seconds`."""
    delay = round(DELAY_TICKS * PARTS)
    step = np.linalg.solve(D, K) * TICK_S / PARTS
    path = [np.ones(6)] * (delay + 1)
    for _ in range(round(seconds / TICK_S * PARTS)):
        path.append(path[-1] - step @ path[-1 - delay])
    sizes = np.linalg.norm(path, axis=1)
    return sizes[-len(sizes) // 4 :].max() / sizes[len(sizes) // 4 : len(sizes) // 2].max()


@pytest.mark.parametrize("share", [(1.0, 0.0, 1.0, 0.45), (1.0, 0.0, 1.0, 0.12), (1.0, 1.0, 1.0, 0.0)])
def test_the_coupled_margin_is_where_the_delayed_loop_becomes_unstable(share):
    config, pose, grip, D, place_m = lifted_grasp(share)
    found = stable_stiffness(config.pose_law, pose, grip, gains_of(config).B_Nms_rad, TICK_S, place_m)
    margin = coupled_margin(found, D, place_m, grip, TICK_S)
    assert margin >= COUPLED_MARGIN - 1e-6
    K = np.zeros((6, 6))
    K[:3, :3], K[3:, 3:] = found.K_p_N_m, found.K_o_Nm_rad
    # The damping about the place, by the power of a motion of the object in both descriptions.
    lever = place_m - grip.centroid_m
    at_centroid = np.eye(6)
    at_centroid[:3, 3:] = -np.cross(np.eye(3), -lever)  # v_centroid = v_place - w x lever
    about_place = at_centroid.T @ D @ at_centroid
    assert growth(about_place, 0.93 * margin * K) < 1.0 < growth(about_place, 1.07 * margin * K)
