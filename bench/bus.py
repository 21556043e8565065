"""Time of publishing a contact, and of sending a frame through the hub or python-can's in-process bus."""

from __future__ import annotations

import tempfile
import threading
import time
from pathlib import Path

import can
import numpy as np

from bench.timing import Row, table, time_both, time_each
from palpate_bus.hub.server import Hub
from palpate_edge.can_bus.bus import BusConfig, open_bus
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.contact import Contact
from palpate_edge.node.fingertip import FingertipNode
from palpate_edge.node.fingertip_objects import MethodCode
from palpate_edge.node.nmt import NMT_ID

ROUND_TRIPS = 1000
DRAINED_S = 0.002  # time in which the hub sends a burst's frames
BURST = [CanFrame(0x200 + node, bytes(8)) for node in range(1, 10)] + [CanFrame(0x080)]  # a host's tick
CONTACT = Contact(1, 0, True, True, (1.0, 2.0, 29.9), 1.0, (0.0, 0.1, -1.0), 1.0, "", 85, 85)


def report() -> str:
    """Return the table."""
    return table("Fingertip node and hub", rows())


def rows() -> list[Row]:
    """Return the rows; the first one is the reference for the ratios."""
    return [*_round_trips(), _node()]


def _node() -> Row:
    node = FingertipNode(0x10, MethodCode.CORRECTED, "0" * 16)
    node.process(0, [])
    node.process(0, [CanFrame(NMT_ID, bytes([1, 0x10]))])

    def publish(now_us: int) -> None:
        node.publish(CONTACT, 5000)
        node.process(now_us, [])

    return Row("fingertip node: contact to TPDO 1-3", time_each(publish, range(ROUND_TRIPS)))


def _round_trips() -> list[Row]:
    virtual = [can.Bus(interface="virtual", channel="bench") for _ in range(2)]
    try:
        plain = Row("frame and reply, python-can virtual (one process)", _ping(*virtual))
    finally:
        for bus in virtual:
            bus.shutdown()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "hub.sock"
        hub = Hub(path, bitrate=0, txqueuelen=128)
        thread = threading.Thread(target=hub.run)
        thread.start()
        buses = [can.Bus(interface="palpate", channel=str(path), name=name) for name in ("a", "b")]
        try:
            through = Row("frame and reply through the hub", _ping(*buses))
            burst = Row("a tick's ten frames to the hub, processor time", _bursts(path))
        finally:
            for bus in buses:
                bus.shutdown()
            hub.stop()
            thread.join()
            hub.close()
    return [plain, through, burst]


def _bursts(path: Path) -> np.ndarray:
    with open_bus(BusConfig(interface="palpate", channel=str(path)), "c") as bus:
        return time_both(lambda _: time.sleep(DRAINED_S), lambda _: bus.send(BURST), range(ROUND_TRIPS))[1]


def _ping(a: can.BusABC, b: can.BusABC) -> np.ndarray:
    message = can.Message(arbitration_id=0x123, data=b"palpate", is_extended_id=False)

    def trip(_number: int) -> None:
        a.send(message)
        received = b.recv(1.0)
        assert received is not None
        b.send(received)
        assert a.recv(1.0) is not None

    return time_each(trip, range(ROUND_TRIPS))
