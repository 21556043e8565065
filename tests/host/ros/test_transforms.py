"""The hand's frames for TF, and at a real subscriber (test_urdf.py compares them with pinocchio)."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.host.ros.conftest import HAND, LOG, Listener, places, serve_until

from palpate_host.common.status import HostStatus
from palpate_host.operator.server import OperatorSocket
from palpate_host.recording.statuses import read_statuses
from palpate_host.ros.contents import HandContents
from palpate_host.ros.message_contents import PoseContent, Transform
from palpate_host.ros.transforms import HandFrames
from palpate_host.ros.urdf import urdf_of
from palpate_host.service.host import load_hand

JAZZY_HASH = "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087"
"""Type hash of tf2_msgs/TFMessage: `ros2 topic info --verbose /tf` of an installed ROS 2 Jazzy."""


def test_unknown_angles_give_no_frames_and_names_have_the_prefix() -> None:
    config, hand = load_hand(HAND)
    frames = HandFrames(urdf_of(config), "left/")
    contents = HandContents(hand, {f.name: f.name for f in config.fingers}, "left/")
    turning = next(s for s in read_statuses(LOG, config, hand) if s.R_c is not None)
    messages = contents.of_tick(turning)
    (sent,) = frames.of_tick(messages)
    every = (*sent.transforms, *frames.fixed(0).transforms)
    assert all(one.parent.startswith("left/") and one.child.startswith("left/") for one in every)
    (pose,) = (one for one in messages if isinstance(one, PoseContent))
    (held,) = (one for one in sent.transforms if one.child == "left/object")
    assert (held.parent, held.position_m, held.quaternion) == (pose.frame, pose.position_m, pose.quaternion)
    lost = replace(turning.joints[0], position_rad=None)
    changed = replace(turning, joints=(lost, *turning.joints[1:]))
    assert not list(frames.of_tick(contents.of_tick(changed)))


@pytest.mark.ros
def test_a_late_subscriber_gets_the_whole_tree(
    bridge,
    host: OperatorSocket,
    listener: Listener,
    tmp_path: Path,
    statuses: list[HostStatus],
) -> None:
    """The quality of service is that of tf2's listener; the fingertips are where the host's law has them."""
    tf2 = pytest.importorskip("tf2_msgs.msg", reason="tf2_msgs is not built: make ros-test")
    from rclpy.qos import DurabilityPolicy, QoSProfile

    status = next(one for one in statuses if one.R_c is not None)
    bridge(HAND, tmp_path / "host.sock", "--tf")
    moving = listener.subscribe(tf2.TFMessage, "/tf", QoSProfile(depth=100))
    serve_until(host, status, lambda: moving)
    latched = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    fixed = listener.subscribe(tf2.TFMessage, "/tf_static", latched)
    serve_until(host, status, lambda: fixed)
    (publisher,) = listener.node.get_publishers_info_by_topic("/tf")
    assert str(publisher.topic_type_hash) == JAZZY_HASH
    found = places(map(transform_of, [*fixed[0][1].transforms, *moving[-1][1].transforms]))
    config, hand = load_hand(HAND)
    tips_m = hand.pose(np.array([joint.position_rad for joint in status.joints])).tip_centre_m
    for site, tip_m in zip(config.model.tip_sites, tips_m, strict=True):
        np.testing.assert_allclose(found[site][0], tip_m, atol=1e-9)
    np.testing.assert_allclose(found["object"][1].as_matrix(), status.R_c, atol=1e-9)


def transform_of(message) -> Transform:
    place, turn = message.transform.translation, message.transform.rotation
    quaternion = turn.x, turn.y, turn.z, turn.w
    return Transform(
        0, message.header.frame_id, message.child_frame_id, (place.x, place.y, place.z), quaternion
    )
