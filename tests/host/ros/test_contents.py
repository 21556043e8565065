"""The contents of ROS messages: units, frames, times of exposure, and when each is made."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from palpate_edge.common.contact import tangential_force_N
from palpate_host.common.status import HostStatus
from palpate_host.recording.statuses import read_statuses
from palpate_host.ros.contents import NO_HOST, HandContents, quaternion, topic_name, wrench
from palpate_host.ros.message_contents import (
    STALE,
    DiagnosisContent,
    JointContent,
    PointContent,
    PoseContent,
    TextContent,
    WrenchContent,
)
from palpate_host.service.host import load_hand

PROJECT = Path(__file__).resolve().parents[3]
LOG = PROJECT / "tests" / "replay" / "virtual.log.gz"
CONFIG, HAND = load_hand(PROJECT / "host" / "palpate_host" / "models" / "table4.toml")
FRAMES = dict(zip((finger.name for finger in CONFIG.fingers), CONFIG.model.tip_sites, strict=True))


@pytest.fixture(scope="module")
def statuses() -> list[HostStatus]:
    return list(read_statuses(LOG, CONFIG, HAND))


@pytest.fixture(scope="module")
def turning(statuses: list[HostStatus]) -> HostStatus:
    return next(status for status in statuses if status.R_c is not None)


def of_kind(contents, kind):
    return [content for content in contents if isinstance(content, kind)]


def test_a_wrench_is_the_force_at_the_contact_moved_to_the_centre() -> None:
    """The whole force is drawn; its normal and tangential parts are what the bus carries of it."""
    random = np.random.default_rng(1)
    for _ in range(50):
        point = random.normal(size=3) + np.array([0, 0, 3])
        point *= 30.0 / np.linalg.norm(point)
        whole_N = random.normal(size=3)
        normal_N = float(-whole_N @ point / 30.0)
        x_N, y_N, _ = tangential_force_N(tuple(point), tuple(whole_N))
        force_N, torque_Nm = wrench(tuple(point), normal_N, (x_N, y_N), 12.0)
        np.testing.assert_allclose(force_N, whole_N, atol=1e-12)
        expected_Nm = np.cross(point * 1e-3, whole_N) - 0.012 * point / 30.0
        np.testing.assert_allclose(torque_Nm, expected_Nm, atol=1e-12)


def test_a_contact_is_sent_once_at_the_time_of_its_exposure(turning: HostStatus) -> None:
    contents = HandContents(HAND, FRAMES, "left/")
    first, again = contents.of_tick(turning), contents.of_tick(turning)
    points = of_kind(first, PointContent)
    assert [point.topic for point in points] == ["finger_1/contact", "finger_2/contact", "finger_3/contact"]
    assert [wrench.frame for wrench in of_kind(first, WrenchContent)] == [
        "left/tip_1",
        "left/tip_2",
        "left/tip_3",
    ]
    assert not of_kind(again, PointContent) and not of_kind(again, WrenchContent)
    for point, finger in zip(points, turning.fingers, strict=True):
        assert point.point_m == pytest.approx(tuple(1e-3 * value for value in finger.position_mm))
        assert (turning.time_us - point.time_us) / 1000 == pytest.approx(finger.age_ms, abs=1e-3)


def test_a_finger_that_touches_nothing_has_a_wrench_of_zero_and_no_point(turning: HostStatus) -> None:
    finger = replace(
        turning.fingers[0], in_contact=False, position_mm=None, normal_force_N=None, shear_N=None
    )
    contents = HandContents(HAND, FRAMES).of_tick(replace(turning, fingers=(finger,)))
    assert not of_kind(contents, PointContent)
    (sent,) = of_kind(contents, WrenchContent)
    assert sent.force_N == sent.torque_Nm == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    "change", [{"valid": False}, {"normal_force_N": None}], ids=["rejected frame", "no force"]
)
def test_a_force_that_is_not_known_is_not_sent(turning: HostStatus, change) -> None:
    finger = replace(turning.fingers[0], **change)
    contents = HandContents(HAND, FRAMES).of_tick(replace(turning, fingers=(finger,)))
    assert not of_kind(contents, WrenchContent)


def test_joints_and_object(turning: HostStatus) -> None:
    joint = replace(turning.joints[0], torque_Nm=None)
    changed = replace(turning, joints=(joint, *turning.joints[1:]))
    contents = HandContents(HAND, FRAMES, "left/").of_tick(changed)
    (joints,) = of_kind(contents, JointContent)
    assert joints.names == tuple(one.name for one in turning.joints) and math.isnan(joints.effort[0])
    assert joints.position == tuple(one.position_rad for one in turning.joints)
    (pose,) = of_kind(contents, PoseContent)
    assert pose.frame == "left/hand"
    centre_m = HAND.pose(np.array(joints.position)).tip_centre_m.mean(axis=0)
    np.testing.assert_allclose(pose.position_m, centre_m)
    np.testing.assert_allclose(Rotation.from_quat(pose.quaternion).as_matrix(), turning.R_c, atol=1e-9)


def test_a_quaternion_is_that_of_scipy() -> None:
    for rotation in [*Rotation.random(50, random_state=2), Rotation.from_rotvec([0, np.pi, 0])]:
        again = Rotation.from_quat(quaternion(rotation.as_matrix()))
        assert (again * rotation.inv()).magnitude() < 1e-7


def test_mode_and_diagnosis_are_sent_when_they_change_and_once_a_second(statuses: list[HostStatus]) -> None:
    contents = HandContents(HAND, FRAMES)
    sent = [content for status in statuses for content in contents.of_tick(status)]
    modes = [content.text for content in of_kind(sent, TextContent)]
    assert all(one != other for one, other in pairwise(modes))
    assert set(modes) == {status.mode.value for status in statuses}
    assert len(of_kind(sent, DiagnosisContent)) >= len(modes)
    still = [replace(statuses[-1], time_us=statuses[-1].time_us + 10_000 * tick) for tick in range(1, 301)]
    times = [
        content.time_us for status in still for content in of_kind(contents.of_tick(status), DiagnosisContent)
    ]
    assert len(times) in (2, 3) and set(np.diff(times)) == {1_000_000}


def test_a_silent_host_is_reported_once_and_its_return_too(turning: HostStatus) -> None:
    contents = HandContents(HAND, FRAMES)
    contents.of_tick(turning)
    mode, diagnosis = contents.of_silence(5, "gone")
    assert mode == TextContent("mode", NO_HOST)
    assert isinstance(diagnosis, DiagnosisContent) and diagnosis.parts[0].level == STALE
    assert contents.of_silence(6, "gone") == []
    assert TextContent("mode", turning.mode.value) in contents.of_tick(turning)


def test_names_are_made_fit_for_topics() -> None:
    assert [topic_name(name) for name in ("finger-1", "2nd", "Daumen ü")] == ["finger_1", "_2nd", "Daumen__"]
