"""`palpate-host ros` as a process, with real subscribers and service clients (make ros-test)."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner
from tests.host.hand_on_hub import Running, patient, put_on_the_bus
from tests.host.ros.conftest import HAND, PATIENCE_S, PROJECT, Listener, wait_for

from palpate_host import Hand
from palpate_host.cli.main import cli
from palpate_host.common.command import CommandError
from palpate_host.common.mode import MOVING, STOPPED
from palpate_host.common.status import FingerStatus, HostStatus
from palpate_host.operator.client import OperatorClient
from palpate_host.operator.server import OperatorSocket
from palpate_host.recording.statuses import read_statuses
from palpate_host.service.host import load_hand

LOG = PROJECT / "tests" / "replay" / "virtual.log.gz"
TICK_S = 0.01
FRAME_TICKS = 3  # 33 frames a second
FORCE_N = 1.25


@pytest.fixture(scope="module")
def statuses() -> list[HostStatus]:
    return [s for s in read_statuses(LOG, *load_hand(HAND)) if s.mode in MOVING]


@pytest.fixture
def host(tmp_path: Path) -> Iterator[OperatorSocket]:
    with closing(OperatorSocket(tmp_path / "host.sock")) as socket:
        yield socket


def refuse(_command: object) -> None:
    raise CommandError("not now: wait")


def test_without_rclpy_the_command_names_what_installs_it(tmp_path: Path) -> None:
    try:
        import rclpy  # noqa: F401
    except ModuleNotFoundError:
        done = CliRunner().invoke(cli, ["ros", "--config", str(HAND)])
        assert "pip install ros-jazzy-rclpy" in str(done.exception)
        assert "\n" not in str(done.exception)
    done = CliRunner().invoke(cli, ["ros", "--config", str(HAND), "--urdf", "-"])
    assert done.exit_code == 0 and '<link name="tip_1"' in done.stdout


@pytest.mark.ros
def test_no_tick_is_lost_at_full_rate(bridge, host, listener: Listener, tmp_path, statuses, effort) -> None:
    """Every tick that the bridge received reaches a reliable subscriber, in order."""
    from geometry_msgs.msg import WrenchStamped
    from sensor_msgs.msg import JointState

    process = bridge(HAND, tmp_path / "host.sock")
    joints = listener.subscribe(JointState, "joint_states")
    wrenches = [listener.subscribe(WrenchStamped, f"finger_{number}/wrench") for number in (1, 2, 3)]
    serve_until(host, statuses[0], lambda: joints)
    wait_for(lambda: listener.node.count_publishers("finger_3/wrench"), "the third wrench")
    first = len(joints)
    sent = []
    source = itertools.cycle(statuses)
    for number in range(effort(500, 12_000)):
        status = replace(next(source), time_us=time.time_ns() // 1000)
        fingers = tuple(touching(finger, 10_000 + number // FRAME_TICKS) for finger in status.fingers)
        host.serve(refuse, replace(status, fingers=fingers))
        sent.append(status.time_us)
        time.sleep(TICK_S)
    wait_for(lambda: len(joints) >= first + len(sent), "the last tick")
    assert [stamp_us(message) for _, message in joints[first:]] == sent
    for received in wrenches:
        frames = [message for _, message in received if message.wrench.force.z == -FORCE_N]
        assert len(frames) == -(-len(sent) // FRAME_TICKS)
    assert process.poll() is None


def touching(finger: FingerStatus, sequence: int) -> FingerStatus:
    """The finger with a frame of this number, touched at its apex."""
    return replace(
        finger,
        sequence=sequence,
        valid=True,
        in_contact=True,
        position_mm=(0.0, 0.0, 30.0),
        normal_force_N=FORCE_N,
        shear_N=None,
        age_ms=20.0,
    )


def stamp_us(message) -> int:
    return message.header.stamp.sec * 1_000_000 + message.header.stamp.nanosec // 1000


def serve_until(host: OperatorSocket, status: HostStatus, condition) -> None:
    end_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end_s
        host.serve(refuse, replace(status, time_us=time.time_ns() // 1000))
        time.sleep(TICK_S)


@pytest.mark.ros
def test_a_silent_host_is_noticed_by_mode_and_by_deadline(
    bridge, host, listener: Listener, tmp_path, statuses
) -> None:
    """A late subscriber receives the URDF and the mode at once."""
    from rclpy.duration import Duration
    from rclpy.event_handler import SubscriptionEventCallbacks
    from rclpy.qos import DurabilityPolicy, QoSProfile
    from sensor_msgs.msg import JointState
    from std_msgs.msg import String

    bridge(HAND, tmp_path / "host.sock")
    missed = []
    events = SubscriptionEventCallbacks(deadline=missed.append)
    quality = QoSProfile(depth=10, deadline=Duration(seconds=0.2))
    joints = listener.subscribe(JointState, "joint_states", quality, event_callbacks=events)
    serve_until(host, statuses[0], lambda: joints)
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    modes = listener.subscribe(String, "mode", latched)
    urdfs = listener.subscribe(String, "robot_description", latched)
    serve_until(host, statuses[0], lambda: modes and urdfs)
    assert modes[-1][1].data == statuses[0].mode.value
    assert '<robot name="palpate_hand">' in urdfs[0][1].data
    before = len(missed)
    wait_for(lambda: modes[-1][1].data == "no host" and len(missed) > before, "the silence")
    serve_until(host, statuses[0], lambda: modes[-1][1].data == statuses[0].mode.value)


@pytest.mark.ros
def test_commands_that_may_move_are_offered_only_when_asked_for(
    bridge, host, listener: Listener, tmp_path, statuses
) -> None:
    bridge(HAND, tmp_path / "host.sock")
    wait_for(lambda: ("/stop", ["std_srvs/srv/Trigger"]) in services(listener), "the service stop")
    assert not {name for name, _ in services(listener)} & {"/grasp", "/release", "/recover"}
    assert listener.node.count_subscribers("turn") == 0


def services(listener: Listener):
    return listener.node.get_service_names_and_types()


@pytest.fixture
def running() -> Iterator[Running]:
    made = Running()
    yield made
    made.stop()


@pytest.mark.ros
def test_grasp_turn_and_stop_of_a_real_host(bridge, listener: Listener, tmp_path, running) -> None:
    """A host with drives and fingertips on the hub. A stop takes effect in the tick after its response."""
    from geometry_msgs.msg import Vector3

    path = tmp_path / "hand.toml"
    path.write_text(patient(HAND.read_text().replace("[bus]", f'[bus]\nchannel = "{tmp_path / "hub"}"', 1)))
    put_on_the_bus(running, path)
    with Hand.open(path, tmp_path / "s", timeout_s=PATIENCE_S) as hand:
        bridge(path, tmp_path / "s", "--commands", "--namespace", "left")
        refused = listener.call("/left/recover")
        assert not refused.success and "there is nothing to recover from" in refused.message
        assert listener.call("/left/grasp").success
        hand.wait_for(lambda s: s.mode.value == "grasp" and all(f.in_contact for f in s.fingers), 60, "grasp")
        publisher = listener.node.create_publisher(Vector3, "/left/turn", 1)
        wait_for(publisher.get_subscription_count, "the bridge's subscription")
        publisher.publish(Vector3(z=0.05))
        turned_deg = pytest.approx((0.0, 0.0, math.degrees(0.05)))
        hand.wait_for(lambda s: s.target_rpy_deg == turned_deg, PATIENCE_S, "turn")
        with OperatorClient(tmp_path / "s") as watcher:
            ticks = watcher.stream()
            next(ticks)
            assert listener.call("/left/stop").success
            seen = []
            for status in ticks:
                seen.append(status)
                if status.mode in STOPPED:
                    break
    asked = [status.inputs is not None and bool(status.inputs.events) for status in seen]
    assert asked.index(True) == len(seen) - 1, "the first tick after the command is the first in STOP"
