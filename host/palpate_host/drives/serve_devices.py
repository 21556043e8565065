"""The loop that serves the CiA 402 devices of this process on one bus."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Sequence

from palpate_bus.eds.cia402 import DriveState
from palpate_edge.can_bus.bus import Bus
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.errors import BusError
from palpate_edge.common.local_clock import monotonic_us
from palpate_edge.node.events import AcceptIdsChanged, Event, NodeIdConflict
from palpate_host.drives.cia402_device import DriveNode

LONGEST_WAIT_US = 50_000


def serve_devices(
    bus: Bus,
    devices: Sequence[DriveNode],
    stop: threading.Event,
    each_cycle: Callable[[], None] = lambda: None,
) -> None:
    """Serve the devices until `stop` is set; `each_cycle` is called at least every LONGEST_WAIT_US.

    Raises BusError when the bus is lost or when another node has the id of one of the devices.
    """
    nodes = [_Node(device) for device in devices]
    while not stop.is_set():
        wait_us = max(0, min(node.due_us for node in nodes) - monotonic_us())
        frames = [frame for _, frame in bus.receive(wait_us * 1e-6)]
        now_us = monotonic_us()
        for node in nodes:
            bus.send(node.process(now_us, frames))
        each_cycle()


class _Node:
    """One device: processed when a frame is for it, when it is due, at least every LONGEST_WAIT_US, and in
    every cycle while its motor follows a velocity or a position."""

    def __init__(self, device: DriveNode) -> None:
        self._device = device
        self._accept_ids = frozenset(device.slave.accept_ids())
        self.due_us = 0

    def process(self, now_us: int, frames: Sequence[CanFrame]) -> tuple[CanFrame, ...]:
        """Return the frames to send. Raises BusError when another node has the device's id."""
        device = self._device
        received = [frame for frame in frames if frame.can_id in self._accept_ids]
        if not received and now_us < self.due_us and not device.is_following:
            return ()
        output = device.process(now_us, received)
        self.due_us = min(output.next_due_us, now_us + LONGEST_WAIT_US)
        for event in output.events:
            if isinstance(event, AcceptIdsChanged):
                self._accept_ids = frozenset(event.can_ids)
        refuse_conflict(device, output.events)
        return output.frames_out


def refuse_conflict(device: DriveNode, events: Iterable[Event]) -> None:
    """Raise BusError when another node has the device's id."""
    for event in events:
        if isinstance(event, NodeIdConflict):
            raise BusError(
                f"node id 0x{device.slave.node_id:02X} is taken: frame 0x{event.can_id:03X} came from another"
                " node; stop that node or give the drive another id"
            )


def states_line(devices: Iterable[DriveNode]) -> str:
    """Return one line with the number of drives in each state."""
    states = [axis.state for device in devices for axis in device.axes]
    counts = [f"{states.count(state)} {state.value}" for state in DriveState if state in states]
    return ", ".join(counts)
