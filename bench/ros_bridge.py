"""The bridge to ROS 2: messages lost, latency part by part, and how soon a silent host is noticed.

.venv-ros/bin/python -m bench.ros_bridge --seconds 600

A control socket serves recorded ticks at 100 Hz with three fingertips at 33 frames/s. `palpate-host ros`,
the subscriber and the socket are three processes; ``--busy 4`` computes in four more meanwhile.
The last line of the table is what a user of ROS sees; the first is what the bridge adds.
`make ros-test` installs the environment.
"""

from __future__ import annotations

import itertools
import multiprocessing
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, field, replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import click
import numpy as np
import rclpy
from geometry_msgs.msg import WrenchStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from bench.host import TABLE_4
from palpate_edge.common.gc_freeze import long_lived
from palpate_host.cli.ros import PRIORITY
from palpate_host.operator.server import OperatorSocket
from palpate_host.recording.statuses import read_statuses
from palpate_host.service.host import load_hand
from palpate_host.service.real_time import become_real_time, request_fifo

LOG = Path(__file__).parents[1] / "tests" / "replay" / "virtual.log.gz"
TICK_US, FRAME_TICKS = 10_000, 3
WARM_UP_S, FINGERS = 3.0, 3
PERCENTILES = (50, 99, 99.9, 100)
BURN = "while True: pass"


@dataclass
class Arrivals:
    """Times of the messages that the subscriber received.

    joints: us of tick (the stamp), publication, arrival and callback. wrenches: finger -> us of arrival.
    """

    joints: list[tuple[int, int, int, int]] = field(default_factory=list)
    wrenches: list[list[int]] = field(default_factory=lambda: [[] for _ in range(FINGERS)])
    modes: list[tuple[int, str]] = field(default_factory=list)


@click.command()
@click.option("--seconds", default=60.0, show_default=True, help="Duration of the run.")
@click.option("--busy", default=0, show_default=True, help="Processes that compute meanwhile.")
@click.option("--real-time", is_flag=True, help="Socket, bridge and subscriber request SCHED_FIFO.")
def main(seconds: float, busy: int, real_time: bool) -> None:
    """Print messages sent and received, percentiles of the latency, and the time to notice a silent host.

    \b
    Example:
      .venv-ros/bin/python -m bench.ros_bridge --seconds 600
    """
    statuses = [one for one in read_statuses(LOG, *load_hand(TABLE_4)) if one.mode.value == "manipulate"]
    source = itertools.cycle(statuses)
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    with ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory())
        host = stack.enter_context(closing(OperatorSocket(Path(folder) / "s")))
        words = ["-m", "palpate_host.cli.main", "ros", "--config", str(TABLE_4), "--socket", f"{folder}/s"]
        words += ["--real-time"] * real_time
        bridge = stack.enter_context(running(*words, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL))
        assert bridge.stderr is not None
        bridge.stderr.readline()
        subscriber = context.Process(target=listen, args=(there, real_time))
        subscriber.start()
        here.recv()  # it has subscribed
        for _ in range(busy):
            stack.enter_context(running("-c", BURN))
        if real_time:
            become_real_time()
        serve(host, source, WARM_UP_S, 0)
        time.sleep(0.05)
        first_us = now_us()
        sent = serve(host, source, seconds, 1_000_000)
        last_us = now_us()
        load = os.getloadavg()[0]
        time.sleep(1.0)
        here.send("end")
        arrivals: Arrivals = here.recv()
        subscriber.join()
    report(arrivals, sent, first_us, last_us)
    print(
        f"{os.cpu_count()} cores, load average {load:.1f} at the end, {busy} busy processes"
        + ", real time" * real_time
    )


def report(arrivals: Arrivals, sent: int, first_us: int, last_us: int) -> None:
    """Print the result. sent: ticks from first_us to last_us."""
    joints = [times for times in arrivals.joints if times[0] >= first_us]
    wrenches = [sum(at_us >= first_us for at_us in finger) for finger in arrivals.wrenches]
    print(f"joint states received {len(joints)} of {sent}")
    print(f"wrenches received {wrenches} of {-(-sent // FRAME_TICKS)}")
    tick, published, arrived, called = np.array(joints).T / 1000
    parts = {
        "tick to publication (the bridge)": published - tick,
        "publication to arrival (DDS)": arrived - published,
        "arrival to callback (subscriber)": called - arrived,
        "tick to callback": called - tick,
    }
    print(f"{'latency, ms':34}" + "".join(f"{share:>8} %" for share in PERCENTILES))
    for name, latency in parts.items():
        print(f"{name:34}" + "".join(f"{value:10.2f}" for value in np.percentile(latency, PERCENTILES)))
    noticed_us = min(at_us for at_us, mode in arrivals.modes if mode == "no host" and at_us > last_us)
    print(f"silent host noticed after {(noticed_us - last_us) / 1000:.0f} ms")


def listen(pipe: Connection, real_time: bool) -> None:
    """Subscribe until a word comes through the pipe, then send the `Arrivals`. A process of its own."""
    arrivals = Arrivals()
    if real_time and (refusal := request_fifo(PRIORITY)):
        raise click.ClickException(f"no real-time class: {refusal}")
    rclpy.init()
    node = rclpy.create_node("bench")

    def moved(message: JointState, info: dict[str, Any]) -> None:
        stamp = message.header.stamp
        tick_us = stamp.sec * 1_000_000 + stamp.nanosec // 1000
        published_us, arrived_us = info["source_timestamp"] // 1000, info["received_timestamp"] // 1000
        arrivals.joints.append((tick_us, published_us, arrived_us, now_us()))

    node.create_subscription(JointState, "joint_states", moved, 10_000)
    for finger, times in enumerate(arrivals.wrenches, start=1):
        node.create_subscription(
            WrenchStamped, f"finger_{finger}/wrench", lambda _, times=times: times.append(now_us()), 10_000
        )
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    node.create_subscription(
        String, "mode", lambda message: arrivals.modes.append((now_us(), message.data)), latched
    )
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    pipe.send("subscribed")
    with long_lived():
        while not pipe.poll():
            executor.spin_once(timeout_sec=0.05)
    rclpy.shutdown()
    pipe.send(arrivals)


@contextmanager
def running(*words: str, **streams: Any) -> Iterator[subprocess.Popen[str]]:
    """Run Python with these words until the block ends."""
    process = subprocess.Popen([sys.executable, *words], text=True, **streams)
    try:
        yield process
    finally:
        process.terminate()
        process.wait()


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


def now_us() -> int:
    """Return Unix time in us."""
    return time.time_ns() // 1000


if __name__ == "__main__":
    main()
