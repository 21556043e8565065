"""Conversion between python-can messages and the hub's frames."""

from __future__ import annotations

import can

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.can_bus.link import Arrival, ErrorReport
from palpate_edge.can_bus.python_can_link import message_of
from palpate_edge.common.errors import BusError


def frame_of(msg: can.Message) -> CanFrame:
    """Return the frame of a message. Raises BusError for a 29-bit or an error frame."""
    if msg.is_extended_id or msg.is_error_frame:
        kind = "an error" if msg.is_error_frame else "a 29-bit"
        raise BusError(
            f"the CAN hub transmits 11-bit frames only, not {kind} frame (0x{msg.arbitration_id:X})"
        )
    data = bytes(msg.dlc) if msg.is_remote_frame else bytes(msg.data)
    return CanFrame(msg.arbitration_id, data, msg.is_remote_frame, msg.is_fd)


def message(arrival: Arrival, channel: str) -> can.Message:
    """Return the python-can message of a delivered frame or of a report, which is an error frame."""
    stamp_us, frame, is_own = arrival
    if isinstance(frame, CanFrame):
        return message_of(frame, timestamp=stamp_us / 1e6, channel=channel, is_rx=not is_own)
    report = frame or ErrorReport(0)  # the hub delivers no other frames
    return can.Message(
        timestamp=stamp_us / 1e6,
        arbitration_id=report.error_class,
        is_extended_id=False,
        is_error_frame=True,
        dlc=8,
        data=bytes([0, report.controller, 0, 0, 0, 0, 0, 0]),
    )
