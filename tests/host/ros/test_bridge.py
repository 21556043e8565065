"""`palpate-host ros` as a process, with real subscribers and service clients (make ros-test)."""

from __future__ import annotations

import math
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner
from tests.host.hand_on_hub import CLI, Running, patient_hand, put_on_the_bus
from tests.host.ros.action_clients import ABORTED, SUCCEEDED, ActionClients
from tests.host.ros.conftest import (
    HAND,
    PATIENCE_S,
    TICK_S,
    Listener,
    publish_until_heard,
    refuse,
    serve_until,
    wait_for,
)

from palpate_host import Hand
from palpate_host.cli.main import cli
from palpate_host.common.command import Move
from palpate_host.common.mode import STOPPED
from palpate_host.operator.client import OperatorClient
from palpate_host.operator.server import OperatorSocket

NOTICED_MS = 200.0
"""Largest time from a host's death, or its last tick, to the publication of the mode `no host`."""


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
def test_a_silent_host_is_noticed_by_mode_and_by_deadline(
    bridge, host, listener: Listener, tmp_path, statuses
) -> None:
    """A late subscriber receives the URDF and the mode at once."""
    from rclpy.duration import Duration
    from rclpy.event_handler import SubscriptionEventCallbacks
    from rclpy.qos import QoSProfile
    from sensor_msgs.msg import JointState
    from std_msgs.msg import String

    bridge(HAND, tmp_path / "host.sock")
    missed = []
    events = SubscriptionEventCallbacks(deadline=missed.append)
    quality = QoSProfile(depth=10, deadline=Duration(seconds=0.2))
    joints = listener.subscribe(JointState, "joint_states", quality, event_callbacks=events)
    serve_until(host, statuses[0], lambda: joints)
    modes = listener.latched(String, "mode")
    urdfs = listener.latched(String, "robot_description")
    serve_until(host, statuses[0], lambda: modes and urdfs)
    assert modes[-1][1].data == statuses[0].mode.value
    assert '<robot name="palpate_hand">' in urdfs[0][1].data
    before = len(missed)
    wait_for(lambda: modes[-1][1].data == "no host" and len(missed) > before, "the silence")
    serve_until(host, statuses[0], lambda: modes[-1][1].data == statuses[0].mode.value)


@pytest.mark.ros
def test_a_silent_host_is_published_within_200_ms(
    bridge, host, listener: Listener, tmp_path, statuses
) -> None:
    """From the last tick to DDS's time stamp of the mode `no host`; the bridge is in the real-time class.

    The median of five, since the host here is an ordinary process, whose last tick may be late.
    """
    bridge(HAND, tmp_path / "host.sock", "--real-time")
    modes = published_modes(listener, "mode")
    silences_ms = []
    for _ in range(5):
        modes.clear()
        serve_until(host, statuses[0], lambda: statuses[0].mode.value in dict(modes))
        last_us = time.time_ns() // 1000
        host.serve(refuse, replace(statuses[0], time_us=last_us))
        wait_for(lambda: modes[-1][0] == "no host", "the silence")
        silences_ms.append((modes[-1][1] - last_us) / 1000)
    print("silent host published after, ms:", *(f"{one:.0f}" for one in silences_ms))
    assert sorted(silences_ms)[2] <= NOTICED_MS


def published_modes(listener: Listener, topic: str) -> list[tuple[str, int]]:
    """Return the list that is filled with modes and DDS's times of their publication, epoch us."""
    from rclpy.qos import DurabilityPolicy, QoSProfile
    from std_msgs.msg import String

    modes: list[tuple[str, int]] = []
    listener.node.create_subscription(
        String,
        topic,
        lambda message, info: modes.append((message.data, info["source_timestamp"] // 1000)),
        QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL),
    )
    return modes


@pytest.mark.ros
def test_commands_that_may_move_are_offered_only_when_asked_for(
    bridge, host, listener: Listener, tmp_path, statuses
) -> None:
    bridge(HAND, tmp_path / "host.sock")
    wait_for(lambda: ("/stop", ["std_srvs/srv/Trigger"]) in services(listener), "the service stop")
    assert not {name for name, _ in services(listener)} & {"/grasp", "/release", "/recover"}
    assert listener.node.count_subscribers("turn") == listener.node.count_subscribers("move") == 0


def services(listener: Listener):
    return listener.node.get_service_names_and_types()


@pytest.mark.ros
def test_a_move_reaches_the_host_and_its_response_the_operator(
    bridge, host, listener: Listener, tmp_path, statuses
) -> None:
    from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion
    from std_msgs.msg import Header, String

    bridge(HAND, tmp_path / "host.sock", "--commands", "--frame-prefix", "left/")
    publisher = listener.node.create_publisher(PoseStamped, "move", 1)
    responses = listener.latched(String, "response")
    wait_for(lambda: publisher.get_subscription_count() and responses, "the bridge's topics")
    asked: list[object] = []

    def pose_in(frame: str) -> PoseStamped:
        turn = Quaternion(z=math.sin(0.1), w=math.cos(0.1))
        return PoseStamped(
            header=Header(frame_id=frame), pose=Pose(position=Point(x=0.002, z=-0.001), orientation=turn)
        )

    def response_to(frame: str, execute) -> str:
        before = len(responses)
        publisher.publish(pose_in(frame))
        end_s = time.monotonic() + PATIENCE_S
        while len(responses) == before:
            assert time.monotonic() < end_s
            host.serve(execute, statuses[0])
            time.sleep(TICK_S)
        return responses[-1][1].data

    publish_until_heard(
        lambda number: publisher.publish(pose_in(f"frame_{number}")),
        lambda number: f"the frame is frame_{number}:" in responses[-1][1].data,
    )
    assert response_to("left/hand", asked.append) == "move: accepted"
    assert response_to("", refuse) == "move: not now: wait"
    assert "the frame is right/hand: a pose of move is in left/hand" in response_to("right/hand", refuse)
    (command,) = asked
    assert isinstance(command, Move)
    assert command.xyz_mm == pytest.approx((2.0, 0.0, -1.0))
    assert command.rpy_deg == pytest.approx((0.0, 0.0, math.degrees(0.2)))


BRIDGE_OF_ANOTHER_USER = """
import os, sys
from pathlib import Path
from palpate_host.ros.bridge import RosBridge
from palpate_host.ros.goal_requests import GoalRules

bridge = RosBridge(Path(sys.argv[1]), "", 0.1, rules=GoalRules("hand", 3.0, ()), may_move=True)
os.setgroups([])
os.setresgid(65534, 65534, 65534)
os.setresuid(65534, 65534, 65534)
print("ready", flush=True)
sys.stdin.read()
bridge.close()
"""


NOT_ALLOWED = "only root, the host's user and its group may command the hand"


@pytest.fixture
def over_udp(monkeypatch: pytest.MonkeyPatch) -> None:
    """Processes of two users cannot use one shared memory, which Fast DDS prefers on one machine."""
    monkeypatch.setenv("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")


@pytest.mark.ros
@pytest.mark.skipif(os.geteuid() != 0, reason="to become another user needs root")
@pytest.mark.usefixtures("over_udp")
def test_without_the_sockets_permission_no_command_passes(listener: Listener, statuses) -> None:
    """Every service responds with the host's reason, every goal is rejected, and the host executes nothing.

    The socket's file is opened to all users here, so that the host itself has to refuse.
    """
    executed: list[object] = []
    ended = threading.Event()
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        folder.chmod(0o755)
        host = stack.enter_context(closing(OperatorSocket(folder / "s")))
        (folder / "s").chmod(0o666)

        def serve() -> None:
            while not ended.wait(TICK_S):
                host.serve(executed.append, statuses[0])

        server = threading.Thread(target=serve)
        server.start()
        stack.callback(server.join)
        stack.callback(ended.set)
        command = [sys.executable, "-W", "ignore", "-c", BRIDGE_OF_ANOTHER_USER, str(folder / "s")]
        other = stack.enter_context(
            subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        )
        assert other.stdout is not None and other.stdout.readline() == "ready\n"
        for name in ("stop", "grasp", "release", "recover"):
            response = listener.call(name)
            assert not response.success
            assert NOT_ALLOWED in response.message
        actions = ActionClients(listener)
        for name in ("grasp", "turn", "move", "release"):
            assert not actions.send(name).accepted
            wait_for(lambda: any(NOT_ALLOWED in text.data for _, text in actions.refusals), "the reason")
            assert actions.refusals.pop()[1].data.startswith(f"{name}: ")
        assert not executed


@pytest.fixture
def running() -> Iterator[Running]:
    made = Running()
    yield made
    made.stop()


@pytest.mark.ros
@pytest.mark.usefixtures("real_time")
def test_grasp_turn_release_and_stop_of_a_real_host(bridge, listener: Listener, tmp_path, running) -> None:
    """A host with drives and fingertips on the hub. A stop takes effect in the tick after its response."""
    from geometry_msgs.msg import Vector3
    from std_msgs.msg import String

    path = patient_hand(tmp_path)
    put_on_the_bus(running, path)
    with Hand.open(path, tmp_path / "s", timeout_s=PATIENCE_S) as hand:
        bridge(path, tmp_path / "s", "--commands", "--namespace", "left")
        refused = listener.call("/left/recover")
        assert not refused.success and "there is nothing to recover from" in refused.message
        assert listener.call("/left/grasp").success
        hand.wait_for(lambda s: s.mode.value == "grasp" and all(f.in_contact for f in s.fingers), 60, "grasp")
        publisher = listener.node.create_publisher(Vector3, "/left/turn", 1)
        responses = listener.latched(String, "/left/response")
        wait_for(lambda: publisher.get_subscription_count() and responses, "the bridge's topics")
        publish_until_heard(
            lambda _number: publisher.publish(Vector3(z=0.05)),
            lambda _number: responses[-1][1].data == "turn: accepted",
        )
        turned_deg = pytest.approx((0.0, 0.0, math.degrees(0.05)))
        hand.wait_for(lambda s: s.target_rpy_deg == turned_deg, PATIENCE_S, "turn")
        assert listener.call("/left/release").success
        hand.wait_for(lambda s: s.mode.value in ("release", "ready"), PATIENCE_S, "release")
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


@pytest.mark.ros
@pytest.mark.usefixtures("real_time")
def test_goals_of_a_real_host_that_is_killed(bridge, listener: Listener, tmp_path, running) -> None:
    """Grasp and release succeed on the hub; SIGKILL of the host aborts a turn, and the mode is `no host`."""
    path = patient_hand(tmp_path)
    put_on_the_bus(running, path)
    run = [*CLI, "run", "--config", str(path), "--start", "command", "--socket", str(tmp_path / "s")]
    running.processes["host"] = subprocess.Popen(run, stderr=subprocess.PIPE, text=True)
    wait_for((tmp_path / "s").exists, "the control socket")
    with Hand.open(path, tmp_path / "s", timeout_s=PATIENCE_S):
        bridge(path, tmp_path / "s", "--commands", "--namespace", "left", "--real-time")
        modes = published_modes(listener, "/left/mode")
        actions = ActionClients(listener, "/left/")
        for name, success in (("grasp", "grasped"), ("release", "released"), ("grasp", "grasped")):
            status, result = actions.result(actions.send(name, timeout=PATIENCE_S))
            assert (status, getattr(result, success), result.reason) == (SUCCEEDED, True, "")
        turn = actions.turn(0.1, duration=60.0)
        wait_for(lambda: actions.feedback, "feedback")
    assert modes[-1][0] != "no host"
    killed_us = time.time_ns() // 1000
    running.kill("host")
    wait_for(lambda: modes[-1][0] == "no host", "the mode of a dead host")
    noticed_ms = (modes[-1][1] - killed_us) / 1000
    print(f"killed host published after {noticed_ms:.0f} ms")
    assert 0.0 < noticed_ms <= NOTICED_MS
    status, result = actions.result(turn)
    assert (status, result.reached) == (ABORTED, False)
    assert result.reason.startswith(f"no host: the host on {tmp_path / 's'} has closed the connection")
