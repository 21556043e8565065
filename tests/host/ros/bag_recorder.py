"""Record topics of ROS 2 into an MCAP file of rosbag2's profile, each message in the bytes of DDS.

python bag_recorder.py BAG TOPIC=PACKAGE/msg/TYPE ...

The wheels of ROS 2 lack `ros2 bag record`. Prints ``recording``, then each topic at its first message; ends
when its standard input is closed. Runs in the real-time class where it may. Each message has the times of its
publication and of its arrival in the recorder.
"""

from __future__ import annotations

import re
import select
import sys
import time
from importlib import import_module
from pathlib import Path
from typing import Any

import rclpy
from mcap.writer import CompressionType, Writer
from rclpy.executors import SingleThreadedExecutor

from palpate_host.cli.ros import PRIORITY
from palpate_host.service.real_time import request_fifo

SHARE = Path(sys.prefix) / "share"
DEPTH = 10_000
SEPARATOR = "=" * 80


def main() -> None:
    """Record until standard input ends."""
    bag, *topics = sys.argv[1:]
    request_fifo(PRIORITY)
    rclpy.init()
    node = rclpy.create_node("recorder")
    with Path(bag).open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE)
        writer.start(profile="ros2", library="palpate's tests")
        for name, kind in (topic.split("=") for topic in topics):
            record(node, writer, name, kind)
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        print("recording", flush=True)
        while not select.select([sys.stdin], [], [], 0.0)[0]:
            executor.spin_once(timeout_sec=0.05)
        writer.finish()
    rclpy.shutdown()


def record(node: Any, writer: Writer, topic: str, kind: str) -> None:
    """Subscribe to a topic, and write each of its messages."""
    schema = writer.register_schema(kind, "ros2msg", definition(kind).encode())
    channel = writer.register_channel(f"/{topic}", "cdr", schema)
    package, _, name = kind.split("/")
    is_known = False

    def write(message: bytes, info: dict[str, int]) -> None:
        nonlocal is_known
        writer.add_message(channel, time.time_ns(), bytes(message), info["source_timestamp"])
        if not is_known:
            is_known = True
            print(topic, flush=True)

    message_type = getattr(import_module(f"{package}.msg"), name)
    node.create_subscription(message_type, topic, write, DEPTH, raw=True)


def definition(kind: str) -> str:
    """Return the .msg file of a type, and those of the types that it uses, as rosbag2 stores them."""
    texts: dict[str, str] = {}
    waiting = [kind]
    while waiting:
        package, _, name = waiting.pop(0).split("/")
        if (short := f"{package}/{name}") in texts:
            continue
        texts[short] = (SHARE / package / "msg" / f"{name}.msg").read_text()
        for used in re.findall(r"^([A-Z]\w*|\w+/[A-Z]\w*)(?:\[.*?\])? +\w", texts[short], re.MULTILINE):
            within, _, element = used.rpartition("/")
            waiting.append(f"{within or package}/msg/{element}")
    first, *others = texts.items()
    return first[1] + "".join(f"\n{SEPARATOR}\nMSG: {name}\n{text}" for name, text in others)


if __name__ == "__main__":
    main()
