"""Conversion between python-can messages and the hub's frames."""

from __future__ import annotations

import errno
import time

import can

from palpate_bus.hub.protocol import FrameFlag
from palpate_edge.can_bus.can_frame import MAX_DATA_BYTES, MAX_STANDARD_ID, CanFrame

_OWN = int(FrameFlag.OWN)


def classic_frame(msg: can.Message) -> CanFrame:
    """Return the frame of a message.

    Raises can.CanOperationError (EINVAL) for a message that is not a classic 11-bit frame.
    """
    if msg.is_fd or msg.is_extended_id or msg.is_error_frame:
        kind = "a CAN FD" if msg.is_fd else "an error" if msg.is_error_frame else "a 29-bit"
        raise can.CanOperationError(
            f"the CAN hub transmits classic 11-bit frames only, not {kind} frame (0x{msg.arbitration_id:X})",
            errno.EINVAL,
        )
    data = bytes(msg.dlc) if msg.is_remote_frame else bytes(msg.data)
    if not 0 <= msg.arbitration_id <= MAX_STANDARD_ID or len(data) > MAX_DATA_BYTES:
        raise can.CanOperationError(
            f"no CAN frame: identifier {msg.arbitration_id:#x}, {len(data)} data bytes: the maximum is"
            f" {MAX_STANDARD_ID:#x} and {MAX_DATA_BYTES} bytes",
            errno.EINVAL,
        )
    return CanFrame(msg.arbitration_id, data, msg.is_remote_frame)


def is_data_frame(frame: CanFrame) -> bool:
    """Return whether the frame is a classic 11-bit data frame."""
    return not frame.remote and 0 <= frame.can_id <= MAX_STANDARD_ID and len(frame.data) <= MAX_DATA_BYTES


def message(won_at_us: int, flags: int, frame: CanFrame, channel: str) -> can.Message:
    """Return the python-can message of a delivered frame."""
    return can.Message(
        timestamp=won_at_us / 1e6,
        arbitration_id=frame.can_id,
        is_extended_id=False,
        is_remote_frame=frame.remote,
        dlc=len(frame.data),
        data=frame.data,
        channel=channel,
        is_rx=not flags & _OWN,
    )


def error_frame(error_class: int, controller: int = 0) -> can.Message:
    """Return an error frame in the kernel's format: class in the identifier, controller detail in data[1]."""
    return can.Message(
        timestamp=time.time(),
        arbitration_id=error_class,
        is_extended_id=False,
        is_error_frame=True,
        dlc=8,
        data=bytes([0, controller, 0, 0, 0, 0, 0, 0]),
    )
