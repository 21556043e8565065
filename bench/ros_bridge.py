"""The bridge to ROS 2 under load: messages lost, latency, and how soon a silent host is noticed.

.venv-ros/bin/python -m bench.ros_bridge --seconds 600

A control socket serves recorded ticks at 100 Hz with three fingertips at 33 frames/s. `palpate-host ros` is
one process, socket and subscriber are another. `make ros-test` installs the environment.
"""

from __future__ import annotations

import itertools
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import click
import numpy as np
import rclpy
from geometry_msgs.msg import WrenchStamped
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from bench.host import TABLE_4
from palpate_host.operator.server import OperatorSocket
from palpate_host.recording.statuses import read_statuses
from palpate_host.service.host import load_hand

LOG = Path(__file__).parents[1] / "tests" / "replay" / "virtual.log.gz"
TICK_US, FRAME_TICKS = 10_000, 3


@click.command()
@click.option("--seconds", default=60.0, show_default=True, help="Duration of the run.")
def main(seconds: float) -> None:
    """Print messages sent and received, percentiles of the latency, and the time to notice a silent host.

    \b
    Example:
      .venv-ros/bin/python -m bench.ros_bridge --seconds 600
    """
    statuses = [one for one in read_statuses(LOG, *load_hand(TABLE_4)) if one.mode.value == "manipulate"]
    with tempfile.TemporaryDirectory() as folder, closing(OperatorSocket(Path(folder) / "s")) as host:
        command = [sys.executable, "-m", "palpate_host.cli.main", "ros", "--config", str(TABLE_4)]
        bridge = subprocess.Popen(
            [*command, "--socket", f"{folder}/s"],
            stderr=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            text=True,
        )
        assert bridge.stderr is not None
        bridge.stderr.readline()
        rclpy.init()
        node = rclpy.create_node("bench")
        latency_us: list[int] = []
        wrenches = [0, 0, 0]
        modes: list[tuple[int, str]] = []

        def arrived(message: JointState) -> None:
            stamp = message.header.stamp
            latency_us.append(now_us() - stamp.sec * 1_000_000 - stamp.nanosec // 1000)

        def touched(finger: int) -> None:
            wrenches[finger] += 1

        node.create_subscription(JointState, "joint_states", arrived, 10_000)
        for finger in range(3):
            node.create_subscription(
                WrenchStamped, f"finger_{finger + 1}/wrench", lambda _, finger=finger: touched(finger), 10_000
            )
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        node.create_subscription(
            String, "mode", lambda message: modes.append((now_us(), message.data)), latched
        )
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        threading.Thread(target=spin, args=(executor,), daemon=True).start()
        source = itertools.cycle(statuses)
        serve(host, source, 3.0, 0)
        time.sleep(0.05)
        latency_us.clear()
        before = list(wrenches)
        sent = serve(host, source, seconds, 1_000_000)
        last_us = now_us()
        time.sleep(1.0)
        noticed_us = [at_us for at_us, mode in modes if mode == "no host" and at_us > last_us]
        bridge.terminate()
        bridge.wait()
        rclpy.shutdown()
    received = [now - then for now, then in zip(wrenches, before, strict=True)]
    print(f"ticks sent {sent}, joint states received {len(latency_us)}")
    print(f"frames sent {-(-sent // FRAME_TICKS)}, wrenches received {received}")
    shares = np.percentile(latency_us, [50, 99, 99.9, 100]) / 1000
    print(
        "latency from tick to subscriber, ms: " + ", ".join(f"{value:.2f}" for value in shares),
        "(50, 99, 99.9, 100 %)",
    )
    print(f"silent host noticed after {(noticed_us[0] - last_us) / 1000:.0f} ms")


def serve(host: OperatorSocket, source, seconds: float, first: int) -> int:
    """Serve ticks on a grid of 10 ms; return their number. first: number of the first frame."""
    start_us, ticks = now_us(), 0
    while ticks < seconds * 1e6 / TICK_US:
        due_us = start_us + ticks * TICK_US
        time.sleep(max(0, due_us - now_us()) * 1e-6)
        status = next(source)
        fingers = tuple(
            replace(one, sequence=first + ticks // FRAME_TICKS, valid=True) for one in status.fingers
        )
        host.serve(lambda _command: None, replace(status, time_us=now_us(), fingers=fingers))
        ticks += 1
    return ticks


def spin(executor: SingleThreadedExecutor) -> None:
    """Handle the node's messages until ROS is shut down."""
    try:
        executor.spin()
    except ExternalShutdownException:
        return


def now_us() -> int:
    """Return Unix time in us."""
    return time.time_ns() // 1000


if __name__ == "__main__":
    main()
