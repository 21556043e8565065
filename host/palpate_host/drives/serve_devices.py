"""CiA 402 devices of this process on one bus: the loop around them."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable, Sequence

from palpate_edge.bus import Bus
from palpate_edge.errors import BusError
from palpate_edge.node.events import NodeIdConflict
from palpate_edge.node.slave import Output
from palpate_host.drives.cia402 import DriveState
from palpate_host.drives.cia402_device import Cia402Device

LONGEST_WAIT_S = 0.05


def serve_devices(
    bus: Bus,
    devices: Sequence[Cia402Device],
    stop: threading.Event,
    each_turn: Callable[[], None] = lambda: None,
) -> None:
    """Serve the devices until `stop` is set; `each_turn` is called after each, at least every LONGEST_WAIT_S.

    Raises BusError when the bus is gone or when another node has the id of one of the devices.
    """
    next_due_us = 0
    while not stop.is_set():
        wait_s = min(max(next_due_us - now_us(), 0) * 1e-6, LONGEST_WAIT_S)
        frames = tuple(frame for _, frame in bus.receive(wait_s))
        now = now_us()
        outputs = [device.process(now, frames) for device in devices]
        for device, output in zip(devices, outputs, strict=True):
            _check_conflict(device, output)
            bus.send(output.frames_out)
        next_due_us = min(output.next_due_us for output in outputs)
        each_turn()


def _check_conflict(device: Cia402Device, output: Output) -> None:
    for event in output.events:
        if isinstance(event, NodeIdConflict):
            raise BusError(
                f"node id {device.slave.node_id} is taken: frame {event.can_id:03X} came from another node; "
                "stop that node or give the drive another id"
            )


def states_line(devices: Iterable[Cia402Device]) -> str:
    """One line for a person: how many drives are in which state."""
    states = [device.state for device in devices]
    counts = [f"{states.count(state)} {state.value}" for state in DriveState if state in states]
    return ", ".join(counts)


def now_us() -> int:
    """Monotonic time in us: the devices need intervals alone."""
    return time.monotonic_ns() // 1000
