"""A node of ROS 2 that subscribes to one hand. Needs rclpy: make ros-test."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

PROJECT = Path(__file__).resolve().parents[3]
HAND = PROJECT / "host" / "palpate_host" / "models" / "table4.toml"
PATIENCE_S = 60.0


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


@pytest.fixture(autouse=True)
def own_domain(monkeypatch: pytest.MonkeyPatch) -> None:
    """Parallel test runs of one machine do not meet: each has a domain of its own, 1 to 100."""
    monkeypatch.setenv("ROS_DOMAIN_ID", str(os.getpid() % 100 + 1))


@pytest.fixture
def listener() -> Iterator[Listener]:
    made = Listener()
    yield made
    made.close()


@pytest.fixture
def bridge() -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """``bridge(config, socket, *options)``: a running ``palpate-host ros``."""
    started: list[subprocess.Popen[str]] = []

    def start(config: Path, socket: Path, *options: str) -> subprocess.Popen[str]:
        command = [sys.executable, "-m", "palpate_host.cli.main", "ros", "--config", str(config)]
        process = subprocess.Popen(
            [*command, "--socket", str(socket), *options],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        started.append(process)
        assert process.stderr is not None
        assert process.stderr.readline().startswith("ros: node /")
        return process

    yield start
    for process in started:
        process.terminate()
        process.communicate(timeout=PATIENCE_S)
