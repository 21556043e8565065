"""A node of ROS 2 that subscribes to one hand. Needs rclpy: make ros-test."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from palpate_host.common.command import CommandError
from palpate_host.common.mode import MOVING
from palpate_host.common.status import HostStatus
from palpate_host.operator.server import OperatorSocket
from palpate_host.recording.statuses import read_statuses
from palpate_host.ros.message_contents import Transform
from palpate_host.service.host import load_hand

PROJECT = Path(__file__).resolve().parents[3]
HAND = PROJECT / "host" / "palpate_host" / "models" / "table4.toml"
LOG = PROJECT / "tests" / "replay" / "virtual.log.gz"
PATIENCE_S = 60.0
TICK_S = 0.01


class Listener:
    """A node whose subscriptions keep (time of arrival in us, message)."""

    def __init__(self) -> None:
        rclpy = pytest.importorskip("rclpy", reason="rclpy is not installed: make ros-test")
        from rclpy.executors import SingleThreadedExecutor

        self._context = rclpy.Context()
        rclpy.init(context=self._context)
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "module 'sre_.*' is deprecated")  # imported by ROS's parser
            self.node = rclpy.create_node("listener", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._thread = threading.Thread(target=self._executor.spin, daemon=True)
        self._thread.start()

    def subscribe(
        self, kind: Any, topic: str, quality: Any = 10_000, **options: Any
    ) -> list[tuple[int, Any]]:
        """Return the list that is filled with the topic's messages."""
        received: list[tuple[int, Any]] = []
        self.node.create_subscription(
            kind,
            topic,
            lambda message: received.append((time.time_ns() // 1000, message)),
            quality,
            **options,
        )
        return received

    def latched(self, kind: Any, topic: str) -> list[tuple[int, Any]]:
        """Subscribe to a topic that keeps its last message, which comes first."""
        from rclpy.qos import DurabilityPolicy, QoSProfile

        return self.subscribe(kind, topic, QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL))

    def call(self, name: str) -> Any:
        """Call a service of std_srvs/Trigger and return its response."""
        from std_srvs.srv import Trigger

        client = self.node.create_client(Trigger, name)
        assert client.wait_for_service(PATIENCE_S)
        answer = client.call_async(Trigger.Request())
        wait_for(answer.done, f"an answer of {name}")
        return answer.result()

    def close(self) -> None:
        self._executor.shutdown()
        self._thread.join()
        self.node.destroy_node()
        self._context.try_shutdown()


def wait_for(condition: Callable[[], Any], what: str) -> None:
    end_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end_s, f"{what} did not come"
        time.sleep(0.005)


def publish_until_heard(publish: Callable[[int], None], is_heard: Callable[[int], bool]) -> None:
    """Publish the messages 0, 1, ... a second apart until the last one has had its effect.

    Publisher and subscription learn of each other at different times, and a message between is lost.
    """
    for number in range(int(PATIENCE_S)):
        publish(number)
        end_s = time.monotonic() + 1.0
        while time.monotonic() < end_s:
            if is_heard(number):
                return
            time.sleep(TICK_S)
    raise AssertionError("no message has had an effect")


@pytest.fixture(autouse=True)
def own_domain(monkeypatch: pytest.MonkeyPatch) -> None:
    """Parallel test runs of one machine do not meet."""
    domain(monkeypatch)


def domain(monkeypatch: pytest.MonkeyPatch) -> None:
    """Select the domain of this test run, 1 to 100."""
    monkeypatch.setenv("ROS_DOMAIN_ID", str(os.getpid() % 100 + 1))


@pytest.fixture
def listener() -> Iterator[Listener]:
    made = Listener()
    yield made
    made.close()


@pytest.fixture
def bridge() -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """``bridge(config, socket, *options)``: a running ``palpate-host ros``."""
    with ExitStack() as stack:
        yield lambda *arguments: stack.enter_context(running_bridge(*arguments))


@contextmanager
def running_bridge(config: Path, socket: Path, *options: str) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-m", "palpate_host.cli.main", "ros", "--config", str(config)]
    process = subprocess.Popen(
        [*command, "--socket", str(socket), *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stderr is not None
        assert process.stderr.readline().startswith("ros: node /")
        yield process
    finally:
        process.terminate()
        process.communicate(timeout=PATIENCE_S)


@pytest.fixture(scope="module")
def statuses() -> list[HostStatus]:
    return [s for s in read_statuses(LOG, *load_hand(HAND)) if s.mode in MOVING]


@pytest.fixture
def host(tmp_path: Path) -> Iterator[OperatorSocket]:
    with closing(OperatorSocket(tmp_path / "host.sock")) as socket:
        yield socket


def refuse(_command: object) -> None:
    raise CommandError("not now: wait")


def serve_until(host: OperatorSocket, status: HostStatus, condition: Callable[[], Any]) -> None:
    end_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end_s
        host.serve(refuse, replace(status, time_us=time.time_ns() // 1000))
        time.sleep(TICK_S)


def stamp_us(message: Any) -> int:
    """Return a message's time stamp in us, Unix time."""
    return int(message.header.stamp.sec * 1_000_000 + message.header.stamp.nanosec // 1000)


def places(transforms: Iterable[Transform], root: str = "hand") -> dict[str, tuple[np.ndarray, Rotation]]:
    """Frame -> position (m) and orientation in the root, by the chain of transforms."""
    found = {root: (np.zeros(3), Rotation.identity())}
    waiting = list(transforms)
    while waiting:
        known = [one for one in waiting if one.parent in found]
        assert known, f"no way from {root} to {waiting[0].child}"
        waiting = [one for one in waiting if one.parent not in found]
        for one in known:
            position_m, rotation = found[one.parent]
            assert one.child not in found, "a frame with two parents"
            place_m = position_m + rotation.apply(one.position_m)
            found[one.child] = place_m, rotation * Rotation.from_quat(one.quaternion)
    return found
