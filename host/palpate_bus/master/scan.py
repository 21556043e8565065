"""Scan of the bus: every node that responds to SDO or sends a heartbeat, with its identity."""

# mypy: disallow-untyped-calls=False
# (the canopen package is typed in part)
from __future__ import annotations

import struct
import time
from collections.abc import Callable
from dataclasses import dataclass

import canopen
from canopen.sdo.client import SdoClient
from canopen.sdo.exceptions import SdoAbortedError, SdoCommunicationError

from palpate_bus.master.session import sdo_client

NODE_IDS = range(1, 128)
DEVICE_TYPE, DEVICE_NAME, IDENTITY = 0x1000, 0x1008, 0x1018
PAUSE_S = 0.001
_STATES = {0: "boot-up", 4: "stopped", 5: "operational", 0x7F: "pre-operational"}
# CiA's device profiles, by the low half of 1000h.
_PROFILES = {
    301: "none",
    401: "CiA 401 I/O",
    402: "CiA 402 drive",
    404: "CiA 404 measuring",
    405: "CiA 405 PLC",
    406: "CiA 406 encoder",
    408: "CiA 408 hydraulics",
    410: "CiA 410 inclinometer",
    418: "CiA 418 battery",
    419: "CiA 419 charger",
}

Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True)
class FoundNode:
    """One node id in use.

    state: NMT state by its heartbeat, empty without one. answers: number of responses to one SDO request;
    more than one means that several nodes have this id. identity: vendor, product, revision and serial, None
    where missing.
    """

    node_id: int
    state: str
    answers: int
    device_type: int | None
    name: str
    identity: tuple[int | None, ...]

    @property
    def profile(self) -> str:
        """The CiA profile given by 1000h."""
        if self.device_type is None:
            return ""
        number = self.device_type & 0xFFFF
        return _PROFILES.get(number, f"CiA {number}" if number else "none")

    @property
    def remark(self) -> str:
        """The problem with this node, empty for none."""
        if self.answers > 1:
            return f"{self.answers} nodes have this id"
        return "" if self.answers else "no SDO response"


class _Listener:
    """Subscriber that counts SDO responses and keeps the NMT states of heartbeats."""

    def __init__(self, network: canopen.Network) -> None:
        self.answers: dict[int, int] = {}
        self.states: dict[int, int] = {}
        for node_id in NODE_IDS:
            network.subscribe(0x580 + node_id, self._answer)
            network.subscribe(0x700 + node_id, self._heartbeat)

    def unsubscribe(self, network: canopen.Network) -> None:
        for node_id in NODE_IDS:
            network.unsubscribe(0x580 + node_id, self._answer)
            network.unsubscribe(0x700 + node_id, self._heartbeat)

    def _answer(self, can_id: int, _data: bytearray, _stamp: float) -> None:
        self.answers[can_id - 0x580] = self.answers.get(can_id - 0x580, 0) + 1

    def _heartbeat(self, can_id: int, data: bytearray, _stamp: float) -> None:
        if len(data) == 1:
            self.states[can_id - 0x700] = data[0] & 0x7F


def scan(
    network: canopen.Network, listen_s: float, timeout_s: float, progress: Progress = lambda _done, _of: None
) -> list[FoundNode]:
    """Return every node in the order of ids. listen_s: longer than the nodes' heartbeat time."""
    listener = _Listener(network)
    begin_s = time.monotonic()
    for node_id in NODE_IDS:
        network.send_message(0x600 + node_id, struct.pack("<BHB4x", 0x40, DEVICE_TYPE, 0))
        progress(node_id, len(NODE_IDS))
        time.sleep(PAUSE_S)
    time.sleep(max(timeout_s, listen_s - (time.monotonic() - begin_s)))
    listener.unsubscribe(network)
    return [
        _identify(network, node_id, listener, timeout_s)
        for node_id in sorted(listener.answers.keys() | listener.states.keys())
    ]


def _identify(network: canopen.Network, node_id: int, listener: _Listener, timeout_s: float) -> FoundNode:
    state = listener.states.get(node_id)
    answers = listener.answers.get(node_id, 0)
    numbers: list[int | None] = [None] * 5
    name = ""
    if answers == 1:
        client = sdo_client(network, node_id, timeout_s)
        name = (_read(client, DEVICE_NAME, 0) or b"").decode("latin-1").rstrip("\0")
        keys = [(DEVICE_TYPE, 0), *((IDENTITY, sub) for sub in range(1, 5))]
        found = [_read(client, index, sub) for index, sub in keys]
        numbers = [None if data is None else int.from_bytes(data, "little") for data in found]
    return FoundNode(
        node_id,
        "" if state is None else _STATES.get(state, f"{state:02X}h"),
        answers,
        numbers[0],
        name,
        tuple(numbers[1:]),
    )


def _read(client: SdoClient, index: int, subindex: int) -> bytes | None:
    """Return an object's bytes, None when the node does not have it or does not respond."""
    try:
        data: bytes = client.upload(index, subindex)
    except (SdoAbortedError, SdoCommunicationError):
        return None
    return data
