"""Time per frame of the slave core, compared with a slave of the `canopen` package.

python -m bench node
"""

from __future__ import annotations

import random
import time
from collections.abc import Callable

import canopen

from bench.timing import Row, table, time_each
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.node.eds import load_eds
from palpate_edge.node.fingertip import FingertipNode
from palpate_edge.node.fingertip_objects import MethodCode
from palpate_edge.node.parsed_eds import FINGERTIP_EDS

CALLS = 5000
BATCH = 64
HOSTILE_FRAMES = 40_000
READ_DEVICE_TYPE = bytes.fromhex("40 00 10 00 00 00 00 00")
START = CanFrame(0x000, b"\x01\x10")


def rows() -> list[Row]:
    """Return the times per frame; the reference is a slave of the `canopen` package with the same request."""
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
    ]


def _requests(frames: list[CanFrame]) -> Callable[[int], object]:
    node = FingertipNode(0x10, MethodCode.CORRECTED, "0" * 16)
    node.process(0, (START,))
    return lambda number: node.process(1000 * number, frames)


def _local_node() -> Callable[[int], object]:
    network = canopen.Network()
    network.send_message = lambda *_args, **_kwargs: None  # type: ignore[method-assign]
    node = network.create_node(0x10, str(FINGERTIP_EDS))
    return lambda _number: node.sdo.on_request(0x610, bytearray(READ_DEVICE_TYPE), 0.0)


def _hand_traffic() -> list[CanFrame]:
    """Return the traffic of a hand without acceptance filter: SYNC, time stamp, PDOs and heartbeats."""
    others = [CanFrame(base + node, bytes(8)) for base in (0x180, 0x200, 0x280) for node in range(1, 10)]
    others += [CanFrame(base + node, bytes(8)) for base in (0x180, 0x280, 0x380) for node in (0x11, 0x12)]
    heartbeats = [CanFrame(0x700 + node, b"\x05") for node in range(1, 10)]
    frames = [CanFrame(0x080), CanFrame(0x1FF, bytes(4)), *others, *heartbeats]
    return (frames * 2)[:BATCH]


def _hostile_frames() -> list[CanFrame]:
    """Return random frames: half SDO requests to objects of the EDS, then NMT, SYNC, LSS, RPDOs and noise."""
    rng = random.Random(0)
    indices = sorted(load_eds(FINGERTIP_EDS, 0x10).indices)
    first_bytes = bytes.fromhex("40 22 23 2b 2f 21 60 70 00 11 a4 a3 a2 c6 c1")

    def sdo() -> CanFrame:
        key = rng.choice(indices).to_bytes(2, "little") + bytes([rng.randrange(8)])
        return CanFrame(0x610, bytes([rng.choice(first_bytes)]) + key + rng.randbytes(4))

    others = (
        lambda: CanFrame(0x000, bytes([rng.choice((0x01, 0x01, 0x02, 0x80, 0x82)), 0])),
        lambda: CanFrame(0x080),
        lambda: CanFrame(0x1FF, rng.randbytes(4)),
        lambda: CanFrame(0x7E5, bytes([rng.choice((0x04, 0x40, 0x46, 0x4C, 0x51, 0x5A)), *rng.randbytes(7)])),
        lambda: CanFrame(rng.randrange(0x800), rng.randbytes(8), rng.random() < 0.1),
    )
    return [sdo() if rng.random() < 0.5 else rng.choice(others)() for _ in range(HOSTILE_FRAMES)]


def hostile_rate() -> str:
    """Return the rate of random frames per second of processor time, with four frames per call."""
    frames = _hostile_frames()
    node = FingertipNode(0x10, MethodCode.CORRECTED, "0" * 16)
    begin = time.process_time()
    for at in range(0, HOSTILE_FRAMES, 4):
        node.process(100 * at, frames[at : at + 4])
    seconds = time.process_time() - begin
    return (
        f"slave: hostile frames, half of them SDO: {HOSTILE_FRAMES / seconds:,.0f} frames/s of processor time"
    )


def report() -> str:
    """Return the table and the rate."""
    return f"{table('Slave core, one frame, one core', rows())}\n{hostile_rate()}"
