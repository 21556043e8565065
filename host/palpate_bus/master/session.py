"""Session of a CANopen master on any bus, with the canopen package's exceptions converted to BusError."""

# mypy: disallow-untyped-calls=False
# (the canopen package is typed in part)
from __future__ import annotations

import errno
import logging
import time
from collections.abc import Iterator
from contextlib import contextmanager

import can
import canopen
from canopen.sdo.client import SdoClient
from canopen.sdo.exceptions import SdoAbortedError, SdoCommunicationError

from palpate_bus.decode.sdo_abort_text import abort_remedy, abort_text
from palpate_edge.can_bus.bus import BusConfig, open_error
from palpate_edge.common.errors import BusError

SDO_TIMEOUT_S = 1.0
_SEND_TRIES = 50
_SEND_AGAIN_S = 0.002
_INITIATIONS = (1, 2)  # client command specifiers of CiA 301: initiate download, initiate upload


class PatientNetwork(canopen.Network):
    """Network that retries when the transmit queue is full: a block of 127 segments exceeds most queues."""

    NOTIFIER_CYCLE = 0.1  # s

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:
        """Send one frame. Raises can.CanError when the queue stays full or the bus is lost."""
        for attempt in range(_SEND_TRIES):
            try:
                super().send_message(can_id, data, remote)
            except can.CanError as error:
                if error.error_code != errno.ENOBUFS or attempt == _SEND_TRIES - 1:
                    raise
                time.sleep(_SEND_AGAIN_S)
            else:
                return


class SharedSdoClient(SdoClient):
    """SDO client beside others of the same server, such as a running host that reads the node.

    A response to the initiation of a transfer is taken only if it names the object that was requested.
    """

    _requested: bytes | None = None

    def on_response(self, can_id: int, data: bytearray, timestamp: float) -> None:
        """Take a response; one with another object is ignored while a transfer is initiated."""
        if self._requested in (None, bytes(data[1:4])):
            super().on_response(can_id, data, timestamp)

    def request_response(self, sdo_request: bytearray) -> bytes:
        """Send a request and return the response; raises as the base class."""
        is_initiation = sdo_request[0] >> 5 in _INITIATIONS
        self._requested = bytes(sdo_request[1:4]) if is_initiation else None
        try:
            response: bytes = super().request_response(sdo_request)
        finally:
            self._requested = None
        return response


@contextmanager
def master(config: BusConfig, name: str) -> Iterator[canopen.Network]:
    """Yield a connected master. Raises BusError when the bus cannot be opened or is lost meanwhile."""
    logging.getLogger("canopen").setLevel(logging.CRITICAL)  # BusError reports every failure once
    options = {"name": name} if config.interface == "palpate" else {}
    channel = config.channel or ("can0" if config.interface == "socketcan" else None)
    try:
        bus = can.Bus(
            interface=config.interface, channel=channel, bitrate=config.bitrate, ignore_config=True, **options
        )
    except (can.CanError, OSError, ValueError) as error:
        raise open_error(config, name, error) from error
    network = PatientNetwork(bus)
    network.connect()
    try:
        yield network
        network.check()
    except can.CanError as error:
        raise BusError(f"the {config.interface} bus is lost: {' '.join(str(error).split())}") from error
    finally:
        if network.notifier is not None:
            network.notifier.stop(
                network.NOTIFIER_SHUTDOWN_TIMEOUT
            )  # its thread must end before the bus is closed
        bus.shutdown()


def sdo_client(network: canopen.Network, node_id: int, timeout_s: float) -> SdoClient:
    """Return a client of the node's default SDO server."""
    client = SharedSdoClient(0x600 + node_id, 0x580 + node_id, canopen.ObjectDictionary())
    client.network = network
    network.subscribe(client.tx_cobid, client.on_response)
    client.RESPONSE_TIMEOUT = timeout_s
    return client


@contextmanager
def sdo_errors(node_id: int, index: int, what: str, timeout_s: float) -> Iterator[None]:
    """Convert SDO exceptions to BusError with the node, the action `what` and the remedy. index: of the
    object."""
    try:
        yield
    except SdoAbortedError as error:
        raise BusError(
            f"node 0x{node_id:02X} aborts {what}: {error.code:08X}h, {abort_text(error.code)}: "
            f"{abort_remedy(index, error.code)}"
        ) from error
    except SdoCommunicationError as error:
        reason = str(error).rstrip(".")
        raise BusError(
            f"node 0x{node_id:02X}, {what}: {reason} within {timeout_s:g} s: it may be off, STOPPED "
            "or have another id; list the nodes with palpate-host bus scan"
        ) from error
