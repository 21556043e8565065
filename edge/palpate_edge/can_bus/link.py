"""Interface between `Bus` and a CAN interface: the kernel's sockets, the local hub, or python-can.

Another package adds an interface under the entry-point group ``palpate_edge.links``, as a function of the
type `LinkOpener`. An interface without a link of its own is opened by python-can.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from enum import Enum
from typing import Protocol, TypeAlias

import msgspec

from palpate_edge.can_bus.can_frame import CanFrame, check_frame
from palpate_edge.common.errors import BusError

GROUP = "palpate_edge.links"

BUS_DATA_BITRATE = 0
"""A data bit rate for tools that listen: CAN FD at the bus's own rate where it has one, else classic CAN."""

# linux/can/error.h: class bits of an error frame's identifier.
CAN_ERR_CRTL = 0x004
CAN_ERR_BUSOFF = 0x040
CAN_ERR_RESTARTED = 0x100
# data[1] of a CAN_ERR_CRTL frame.
CRTL_RECEIVE_OVERFLOW = 0x01
CRTL_PASSIVE = 0x30
CRTL_ACTIVE = 0x40

CAN_FD_FLAGS = 0x01 | 0x04
"""linux/can.h, flags of a canfd_frame with a fast data phase: CANFD_BRS, CANFD_FDF."""

CAN_PATIENCE_S = 0.05
"""`patience_s` of a real bus: 128 frames drain in 17 ms at 1 Mbit/s. Short against a heartbeat time."""


class Marks(Enum):
    """Meaning of a link's mark on a received frame.

    PROGRAM: this program sent it; MACHINE: some program of this machine did (MSG_DONTROUTE). NONE: the link
    marks nothing.
    """

    NONE = "none"
    PROGRAM = "program"
    MACHINE = "machine"


class ErrorReport(msgspec.Struct, frozen=True):
    """An error frame of the controller. error_class: CAN_ERR_* bits; controller: CRTL_* bits."""

    error_class: int
    controller: int = 0


# Epoch time in us; the frame, a report, or None for a frame that CANopen does not use (29 bits, or CAN FD on
# a classic bus); whether the frame has the link's mark.
Arrival: TypeAlias = tuple[int, CanFrame | ErrorReport | None, bool]


class LinkSettings(msgspec.Struct, frozen=True, kw_only=True):
    """Settings with which a link is opened.

    channel: empty for the interface's default. name: of the program. bitrate, data_bitrate: bit/s; without a
    data_bitrate the link carries classic frames only. accept_ids: the 11-bit identifiers to receive, None for
    all. echo: receive also this program's own frames.
    """

    channel: str
    name: str
    bitrate: int
    data_bitrate: int | None = None
    accept_ids: tuple[int, ...] | None = None
    echo: bool = False


class Link(Protocol):
    """An open CAN interface. Every failure is a `BusError` whose text is the reason alone.

    patience_s: how long `Bus.send` tries a full transmit queue again.
    """

    marks: Marks
    patience_s: float

    def try_send(self, frames: Sequence[CanFrame]) -> int:
        """Queue the leading frames without waiting; return how many: fewer when the transmit queue is full.

        Raises BusError for a frame that the bus cannot carry, and when the bus is off or down; if frames were
        queued before, only the next call raises.
        """

    def receive(self, timeout_s: float) -> Iterator[Arrival]:
        """Wait up to `timeout_s` for a first arrival, then yield all that are pending.

        What is not taken from the iterator stays pending. Raises BusError when the bus is down, after the
        frames received before.
        """

    def accept(self, can_ids: Sequence[int]) -> None:
        """Receive only these 11-bit identifiers from now on. Raises BusError."""

    def fileno(self) -> int:
        """Return a descriptor that polls readable when `receive` has something, or BusError without one."""

    def close(self) -> None:
        """Close the link; a second call does nothing."""


LinkOpener: TypeAlias = Callable[[LinkSettings], Link]
"""Opens a link. Raises BusError with the remedy, or OSError."""


def send_each(frames: Sequence[CanFrame], send: Callable[[CanFrame], bool], *, fd: bool) -> int:
    """Queue the leading frames one by one, for `Link.try_send`; return how many.

    send: queues one frame; returns False when the transmit queue is full, raises BusError when it is refused.
    fd: whether the bus carries CAN FD frames.
    """
    for count, frame in enumerate(frames):
        try:
            check_frame(frame, fd=fd)
            if not send(frame):
                return count
        except BusError:
            if count:
                return count
            raise
    return len(frames)
