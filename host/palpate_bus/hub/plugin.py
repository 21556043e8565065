"""The hub as a python-can interface, for other programs; palpate itself uses `HubPort`.

``can.Bus(interface="palpate", channel="/run/hub.sock", name="finger-1")``
"""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager

import can
from can.typechecking import CanFilters

from palpate_bus.hub.can_message import frame_of, message
from palpate_bus.hub.connection import HubGoneError, HubSilentError
from palpate_bus.hub.port import HubPort
from palpate_edge.can_bus.link import LinkSettings
from palpate_edge.common.errors import BusError, BusOffError


class HubBus(can.BusABC):
    """A port on the local CAN hub, for frames with 11-bit identifiers, which is all that CANopen uses.

    channel: path of the hub's socket; None for the default one. name: the port's name for faults and
    statistics. bitrate: 0 or None for the hub's; a different one is rejected. fd: send and receive CAN FD
    frames too, with the hub's data bit rate; a different data_bitrate is rejected. Thread-safe: one thread
    may receive while others send. Raises can.CanInitializationError when there is no hub or the hub rejects
    the connection.
    """

    def __init__(
        self,
        channel: str | os.PathLike[str] | None = None,
        can_filters: CanFilters | None = None,
        *,
        name: str = "",
        bitrate: int | None = None,
        receive_own_messages: bool = False,
        fd: bool = False,
        data_bitrate: int | None = None,
        **kwargs: object,  # noqa: ARG002 (python-can hands every option of its configuration to every bus)
    ) -> None:
        settings = LinkSettings(
            channel=str(channel or ""),
            name=name or f"process-{os.getpid()}",
            bitrate=bitrate or 0,
            data_bitrate=(data_bitrate or 0) if fd else None,
            echo=receive_own_messages,
        )
        try:
            self._port = HubPort(settings)
        except BusError as error:
            raise can.CanInitializationError(str(error)) from error
        self.channel_info = f"palpate hub {self._port.path}"
        try:
            super().__init__(channel=str(self._port.path), can_filters=can_filters)
        except can.CanError as error:
            self._port.close()
            raise can.CanInitializationError(str(error)) from error

    @property
    def state(self) -> can.BusState:
        """ACTIVE, or ERROR while the port is bus-off."""
        return can.BusState.ERROR if self._port.is_off else can.BusState.ACTIVE

    @state.setter
    def state(self, new_state: can.BusState) -> None:
        raise can.CanOperationError(
            f"the state of a hub port cannot be set to {new_state.name}: only the hub changes it"
        )

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Queue one frame; with a timeout (s) wait up to that long for space in the transmit queue.

        Raises can.CanOperationError: ENOBUFS queue full, ENETDOWN bus-off, EINVAL not a frame that the bus
        carries (29-bit, error frame, CAN FD on a classic port, wrong length), EPIPE hub stopped, ETIMEDOUT
        the hub does not reply.
        """
        with _operation():
            frame = frame_of(msg)
            if timeout:
                self._port.wait_for_room(timeout)
            if not self._port.try_send([frame]):
                raise can.CanOperationError(
                    f"the transmit queue of {self._port.name} is full, frame 0x{frame.can_id:03X} was not "
                    "sent: retry",
                    errno.ENOBUFS,
                )

    def fileno(self) -> int:
        """Return a descriptor that polls readable when `can.BusABC.recv` has a message or an error."""
        return self._port.fileno()

    def shutdown(self) -> None:
        """Close the connection; a second call has no effect."""
        super().shutdown()
        self._port.close()

    def _apply_filters(self, filters: CanFilters | None) -> None:
        pairs: list[tuple[int, int]] | None = None
        if filters:  # python-can: an empty sequence accepts everything
            pairs = [
                (entry["can_id"] & 0xFFFFFFFF, entry["can_mask"] & 0xFFFFFFFF)
                for entry in filters
                if not entry.get("extended", False)
            ]
        with _operation():
            self._port.set_filters(pairs)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        with _operation():
            arrival = self._port.next_arrival(timeout)
        return None if arrival is None else message(arrival, str(self._port.path)), True


@contextmanager
def _operation() -> Iterator[None]:
    """Convert a BusError to the error of python-can with its code."""
    try:
        yield
    except BusError as error:
        raise can.CanOperationError(str(error), _code(error)) from error


def _code(error: BusError) -> int:
    if isinstance(error, BusOffError):
        return errno.ENETDOWN
    if isinstance(error, HubSilentError):
        return errno.ETIMEDOUT
    return errno.EPIPE if isinstance(error, HubGoneError) else errno.EINVAL
