"""The slave core: cost of a frame beside the `canopen` package's slave, and from the estimate to the bus.

python -m bench.node
"""

from __future__ import annotations

import os
import random
import selectors
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path

import canopen
import numpy as np

from bench.timing import Row, table, time_each
from palpate_edge.bus import BusConfig, open_bus
from palpate_edge.can_frame import CanFrame
from palpate_edge.contact_type import Contact
from palpate_edge.node.fingertip import FingertipNode
from palpate_edge.node.fingertip_objects import Method
from palpate_edge.node.object_dictionary import FINGERTIP_EDS
from palpate_host.bus.hub import Hub

CALLS = 5000
BATCH = 64
ESTIMATES = 600
ESTIMATE_PERIOD_S = 1 / 120
CONTACT = Contact(1, 0, True, True, (1.0, 2.0, 29.9), 1.0, (0.0, 0.1, -1.0), None, 1.0, "", 85, 85)
READ_DEVICE_TYPE = bytes.fromhex("40 00 10 00 00 00 00 00")
START = CanFrame(0x000, b"\x01\x10")


def rows() -> list[Row]:
    """Costs of one frame; the yardstick is a slave of the `canopen` package at the same request."""
    return [
        Row("canopen LocalNode: SDO upload", time_each(_local_node(), range(CALLS))),
        Row("slave: SDO upload", time_each(_requests([CanFrame(0x610, READ_DEVICE_TYPE)]), range(CALLS))),
        Row(
            "slave: SYNC and time stamp",
            time_each(_requests([CanFrame(0x080), CanFrame(0x1FF, bytes(4))]), range(CALLS)) / 2,
        ),
        Row(
            "slave: traffic of a hand, batches of 64",
            time_each(_requests(_hand_traffic()), range(CALLS // 10)) / BATCH,
        ),
        Row(
            "slave: random frames, batches of 64",
            time_each(_requests(_random_frames()), range(CALLS // 10)) / BATCH,
        ),
    ]


def estimate_to_bus() -> Row:
    """Seconds from a finished estimate until TPDO 1 to 3 are sent, through a pipe, a thread and the hub.

    A thread gives an estimate every 1/120 s, as the pixel thread does; the bus loop publishes it.
    """
    given: list[float] = []
    sent: list[float] = []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "hub.sock"
        hub = Hub(path, bitrate=1_000_000, txqueuelen=128)
        serving = threading.Thread(target=hub.run)
        serving.start()
        config = BusConfig(interface="palpate", channel=str(path))
        try:
            with (
                open_bus(config, "fingertip") as bus,
                open_bus(config, "host", [0x190, 0x290, 0x390]) as host,
            ):
                _publish(bus, given, sent)
                assert len(host.receive(1.0)) > 0
        finally:
            hub.stop()
            serving.join()
            hub.close()
    return Row("estimate to TPDO 1-3 sent", np.array(sent) - np.array(given))


def _publish(bus, given: list[float], sent: list[float]) -> None:
    node = FingertipNode(0x10, Method.CORRECTED, "0" * 16)
    node.process(0, (START,))
    ready, estimated = os.pipe()

    def estimate() -> None:
        for _ in range(ESTIMATES):
            time.sleep(ESTIMATE_PERIOD_S)
            given.append(time.perf_counter())
            os.write(estimated, b".")

    pixels = threading.Thread(target=estimate)
    with selectors.DefaultSelector() as selector:
        selector.register(ready, selectors.EVENT_READ)
        selector.register(bus.fileno(), selectors.EVENT_READ)
        pixels.start()
        while len(sent) < ESTIMATES:
            for key, _ in selector.select():
                if key.fd == ready:
                    os.read(ready, 1)
                    node.publish(CONTACT, 5000)
                    bus.send(node.process(time.monotonic_ns() // 1000, ()).frames_out)
                    sent.append(time.perf_counter())
                else:
                    bus.receive(0)
    pixels.join()
    os.close(ready)
    os.close(estimated)


def _requests(frames: list[CanFrame]) -> Callable[[int], object]:
    node = FingertipNode(0x10, Method.CORRECTED, "0" * 16)
    node.process(0, (START,))
    return lambda number: node.process(1000 * number, frames)


def _local_node() -> Callable[[int], object]:
    network = canopen.Network()
    network.send_message = lambda *_args, **_kwargs: None  # type: ignore[method-assign]
    node = network.create_node(0x10, str(FINGERTIP_EDS))
    return lambda _number: node.sdo.on_request(0x610, bytearray(READ_DEVICE_TYPE), 0.0)


def _hand_traffic() -> list[CanFrame]:
    """What a fingertip of a hand sees without a filter: SYNC, time stamp, others' PDOs and heartbeats."""
    others = [CanFrame(base + node, bytes(8)) for base in (0x180, 0x200, 0x280) for node in range(1, 10)]
    others += [CanFrame(base + node, bytes(8)) for base in (0x180, 0x280, 0x380) for node in (0x11, 0x12)]
    heartbeats = [CanFrame(0x700 + node, b"\x05") for node in range(1, 10)]
    frames = [CanFrame(0x080), CanFrame(0x1FF, bytes(4)), *others, *heartbeats]
    return (frames * 2)[:BATCH]


def _random_frames() -> list[CanFrame]:
    rng = random.Random(0)
    can_ids = [0x000, 0x080, 0x1FF, 0x610, 0x610, 0x610, 0x610, 0x7E5, *range(0x100, 0x780, 0x111)]
    return [CanFrame(rng.choice(can_ids), rng.randbytes(8)) for _ in range(BATCH)]


def rate_line(row: Row) -> str:
    """Frames a second at the mean cost of a frame."""
    return f"{row.name}: {1 / float(np.mean(row.seconds)):,.0f} frames/s"


def main() -> None:
    costs = rows()
    print(table("Slave core, one frame, one core", costs))
    for row in costs[1:]:
        print(rate_line(row))
    print()
    print(
        table(
            f"From the estimate to the bus, {ESTIMATES} at 120 a second, hub at 1 Mbit/s", [estimate_to_bus()]
        )
    )


if __name__ == "__main__":
    main()
