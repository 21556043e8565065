"""Two hands on two hosts: network namespaces on one switch, joined by DDS over UDP alone (root)."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from pathlib import Path
from xml.etree import ElementTree

import pytest
from tests.host.ros.conftest import HAND, PATIENCE_S, PROJECT

from palpate_host.operator.server import OperatorSocket
from palpate_host.recording.statuses import read_statuses
from palpate_host.service.host import load_hand

HOSTS = ("left", "right", "third")
DOMAINS = {"left": "41", "right": "41", "third": "42"}
PREFIX = f"palpate-{os.getpid()}"
WATCH = """
import sys, time
import rclpy
from std_msgs.msg import String
from rclpy.qos import DurabilityPolicy, QoSProfile

wanted = set(sys.argv[1:])
rclpy.init()
node = rclpy.create_node("watch")
modes = {}
latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
for hand in ("left", "right", "third"):
    node.create_subscription(
        String, f"/{hand}/mode", lambda message, hand=hand: modes.__setitem__(hand, message.data), latched
    )
end_s = time.monotonic() + 60
while not modes.keys() >= wanted and time.monotonic() < end_s:
    rclpy.spin_once(node, timeout_sec=0.1)
for _ in range(20):
    rclpy.spin_once(node, timeout_sec=0.1)
print(sorted(modes), sorted(n for n, _ in node.get_topic_names_and_types() if "joint" in n))
"""

pytestmark = [
    pytest.mark.ros,
    pytest.mark.skipif(os.geteuid() != 0, reason="network namespaces need root"),
]


def ip(*words: str) -> None:
    subprocess.run(["ip", *words], check=True, capture_output=True)


@pytest.fixture
def inside() -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """``inside(host, *command)``: a process on one of three hosts of one switch.

    domain: the process's ROS domain; by default that of the host.
    """
    for package in ("rclpy", "tf2_msgs"):
        pytest.importorskip(package, reason=f"{package} is not installed: make ros-test")
    processes: list[subprocess.Popen[str]] = []
    with ExitStack() as stack:
        for name in (*HOSTS, "switch"):
            ip("netns", "add", f"{PREFIX}-{name}")
            stack.callback(ip, "netns", "delete", f"{PREFIX}-{name}")
        switch = f"{PREFIX}-switch"
        ip("-n", switch, "link", "add", "switch", "up", "type", "bridge")
        for number, name in enumerate(HOSTS, start=1):
            there = f"{PREFIX}-{name}"
            ip("-n", there, "link", "add", "lan", "type", "veth", "peer", "name", name, "netns", switch)
            ip("-n", switch, "link", "set", name, "master", "switch", "up")
            ip("-n", there, "address", "add", f"10.77.0.{number}/24", "dev", "lan")
            ip("-n", there, "link", "set", "lan", "up")
            ip("-n", there, "link", "set", "lo", "up")
            ip("-n", there, "route", "add", "default", "dev", "lan")

        def start(host: str, *command: str, domain: str = "") -> subprocess.Popen[str]:
            settings = {"ROS_DOMAIN_ID": domain or DOMAINS[host], "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"}
            process = subprocess.Popen(
                ["ip", "netns", "exec", f"{PREFIX}-{host}", *command],
                env=os.environ | settings,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
            )
            processes.append(process)
            return process

        yield start
        for process in processes:
            process.terminate()
            process.communicate(timeout=PATIENCE_S)


def watch(*hands: str) -> list[str]:
    """Return the command that prints the hands whose mode it receives; it waits for these."""
    return [sys.executable, "-c", WATCH, *hands]


def test_two_hands_see_each_other_and_nothing_of_a_third_domain(inside, tmp_path: Path) -> None:
    """The third hand is reached from the same host in its own domain, so the domain alone hides it."""
    status = next(iter(read_statuses(PROJECT / "tests" / "replay" / "virtual.log.gz", *load_hand(HAND))))
    ended = threading.Event()
    with ExitStack() as stack:
        sockets = [stack.enter_context(closing(OperatorSocket(tmp_path / name))) for name in HOSTS]

        def serve() -> None:
            while not ended.wait(0.01):
                for socket in sockets:
                    socket.serve(lambda _command: None, status)

        server = threading.Thread(target=serve)
        server.start()
        try:
            for name in HOSTS:
                process = inside(name, "sh", "-c", launched(side=name, options=f"--socket {tmp_path / name}"))
                assert process.stderr is not None
                assert f"/{name}/palpate" in process.stderr.readline()
            watches = [
                (inside(name, *watch(*seen), domain=domain), seen)
                for name, domain, seen in (
                    ("left", "41", ("left", "right")),
                    ("right", "41", ("left", "right")),
                    ("left", "42", ("third",)),
                )
            ]
            for process, seen in watches:
                output, errors = process.communicate(timeout=2 * PATIENCE_S)
                topics = [f"/{name}/joint_states" for name in seen]
                assert output.strip() == f"{list(seen)} {topics}", errors
        finally:
            ended.set()
            server.join()


def launched(**arguments: str) -> str:
    """The command of the launch file for a shell, with the arguments put in as ROS's launch does."""
    tree = ElementTree.parse(PROJECT / "ros" / "hand.launch.xml")
    assert {one.attrib["name"] for one in tree.iter("arg")} == {"config", *arguments}
    (executable,) = tree.iter("executable")
    assert executable.attrib["shell"] == "true"
    command = executable.attrib["cmd"].replace("palpate-host", f"{sys.executable} -m palpate_host.cli.main")
    for name, value in {"config": str(HAND), **arguments}.items():
        command = command.replace(f"$(var {name})", value)
    assert "$(" not in command
    return command
