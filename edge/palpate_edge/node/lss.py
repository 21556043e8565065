"""LSS slave (CiA 305): the node id configured over the bus; 1018h identifies the node.

A node id takes effect with the next NMT reset communication. A node without an id boots up as soon as it has
one and LSS returns to the waiting state (switch state global). The bit rate is that of the interface, which
the node cannot change: a bit timing is refused, and its activation is ignored.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from enum import IntEnum

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.node.object_dictionary import UNCONFIGURED_NODE_ID
from palpate_edge.node.object_store import ObjectStore
from palpate_edge.node.stored_parameters import STORE

MASTER_ID, SLAVE_ID = 0x7E5, 0x7E4
FRAME_BYTES = 8
IDENTITY = 0x1018

OK, OUT_OF_RANGE, BIT_TIMING_NOT_SUPPORTED = 0, 1, 1
STORAGE_NOT_SUPPORTED, STORAGE_FAILED = 1, 2
SPECIFIC_ERROR = 0xFF
DEVICE_STATE = 1  # the specific error of this node, in the byte after SPECIFIC_ERROR

FASTSCAN_RESET = 0x80
HIGHEST_BIT = 31


class LssCommand(IntEnum):
    """Command specifiers: the first byte of a message."""

    SWITCH_GLOBAL = 0x04
    CONFIGURE_NODE_ID = 0x11
    CONFIGURE_BIT_TIMING = 0x13
    STORE = 0x17
    SELECT_FIRST, SELECT_LAST, SELECTED = 0x40, 0x43, 0x44
    IDENTIFY_FIRST, IDENTIFY_LAST = 0x46, 0x4B
    IDENTIFY_NON_CONFIGURED = 0x4C
    IDENTIFY_SLAVE = 0x4F
    NON_CONFIGURED_SLAVE = 0x50
    FASTSCAN = 0x51
    INQUIRE_FIRST, INQUIRE_LAST, INQUIRE_NODE_ID = 0x5A, 0x5D, 0x5E


class LssSlave:
    """The LSS states waiting and configuration, and the pending node id.

    store: called to store it; returns True when it is stored already, False when it is not possible now, None
    when `confirm_store` follows. may_change: returns whether the NMT state allows another node id.
    """

    def __init__(
        self,
        objects: ObjectStore,
        store: Callable[[int], bool | None],
        may_change: Callable[[], bool],
    ) -> None:
        self._objects = objects
        self._store = store
        self._may_change = may_change
        self.pending_node_id = objects.od.node_id
        self.configuring = False
        self._selected = 0
        self._identified = 0
        self._fastscan_part = 0

    @property
    def leaves_unconfigured(self) -> bool:
        """True when a node without an id has received one and LSS is waiting again: it may boot up."""
        unconfigured = self._objects.od.node_id == UNCONFIGURED_NODE_ID
        return unconfigured and not self.configuring and self.pending_node_id != UNCONFIGURED_NODE_ID

    def restart(self) -> None:
        """Return to the waiting state, after an NMT reset."""
        self.configuring = False
        self._selected = self._identified = self._fastscan_part = 0

    def confirm_store(self, stored: bool) -> list[CanFrame]:
        """Return the response to the store request."""
        return [answer(LssCommand.STORE, self._store_result(stored))]

    def receive(self, data: bytes) -> CanFrame | None:
        """Process one request and return its response, None for a request without one."""
        if len(data) != FRAME_BYTES:
            return None
        command = data[0]
        number: int = struct.unpack_from("<I", data, 1)[0]
        if command == LssCommand.SWITCH_GLOBAL:
            self._switch_global(data[1])
            return None
        if LssCommand.IDENTIFY_FIRST <= command <= LssCommand.IDENTIFY_LAST:
            return self._identify(command - LssCommand.IDENTIFY_FIRST, number)
        if command == LssCommand.IDENTIFY_NON_CONFIGURED:
            return answer(LssCommand.NON_CONFIGURED_SLAVE) if self._is_unconfigured else None
        return self._configure(command, data) if self.configuring else self._wait(command, number, data)

    def _wait(self, command: int, number: int, data: bytes) -> CanFrame | None:
        if LssCommand.SELECT_FIRST <= command <= LssCommand.SELECT_LAST:
            return self._select(command - LssCommand.SELECT_FIRST, number)
        if command == LssCommand.FASTSCAN and self._is_unconfigured:
            return self._fastscan(number, *data[5:8])
        return None

    @property
    def _is_unconfigured(self) -> bool:
        return self.pending_node_id == self._objects.od.node_id == UNCONFIGURED_NODE_ID

    def _identity(self, part: int) -> int:
        """Return one part of 1018h: 0 vendor, 1 product, 2 revision, 3 serial number."""
        return self._objects.number(IDENTITY, 1 + part)

    def _switch_global(self, mode: int) -> None:
        if mode in (0, 1):
            self.configuring = mode == 1
            self._selected = 0

    def _select(self, part: int, number: int) -> CanFrame | None:
        """Process one of the four select requests, one per part of the identity, in their order."""
        matches = part in (0, self._selected) and number == self._identity(part)
        self._selected = part + 1 if matches else 0
        if self._selected < 4:
            return None
        self._selected = 0
        self.configuring = True
        return answer(LssCommand.SELECTED)

    def _identify(self, step: int, number: int) -> CanFrame | None:
        """Process one of the six identify requests.

        Vendor, product, lowest and highest revision, lowest and highest serial number, in this order.
        """
        revision, serial = self._identity(2), self._identity(3)
        matches = (
            number == self._identity(0),
            number == self._identity(1),
            number <= revision,
            number >= revision,
            number <= serial,
            number >= serial,
        )[step]
        self._identified = step + 1 if matches and step in (0, self._identified) else 0
        if self._identified < 6:
            return None
        self._identified = 0
        return answer(LssCommand.IDENTIFY_SLAVE)

    def _fastscan(self, number: int, bit: int, part: int, next_part: int) -> CanFrame | None:
        """Respond if the bits from `bit` upwards of identity `part` are equal to those of `number`."""
        if bit == FASTSCAN_RESET:
            self._fastscan_part = 0
            return answer(LssCommand.IDENTIFY_SLAVE)
        if bit > HIGHEST_BIT or part > 3 or next_part > 3 or part != self._fastscan_part:
            return None
        if (self._identity(part) ^ number) >> bit:
            return None
        self._fastscan_part = next_part
        if bit == 0 and next_part < part:
            self.configuring = True
        return answer(LssCommand.IDENTIFY_SLAVE)

    def _configure(self, command: int, data: bytes) -> CanFrame | None:
        if LssCommand.INQUIRE_FIRST <= command <= LssCommand.INQUIRE_LAST:
            part = command - LssCommand.INQUIRE_FIRST
            return CanFrame(SLAVE_ID, struct.pack("<BI3x", command, self._identity(part)))
        match command:
            case LssCommand.INQUIRE_NODE_ID:
                return answer(command, self._objects.od.node_id)
            case LssCommand.CONFIGURE_BIT_TIMING:
                return answer(command, BIT_TIMING_NOT_SUPPORTED)
            case LssCommand.CONFIGURE_NODE_ID | LssCommand.STORE:
                return self._change(command, data)
        return None

    def _change(self, command: int, data: bytes) -> CanFrame | None:
        """Process a request that the NMT state may forbid; None while the node id is being stored."""
        if not self._may_change():
            return answer(command, SPECIFIC_ERROR, DEVICE_STATE)
        if command == LssCommand.CONFIGURE_NODE_ID:
            return answer(command, self._configure_node_id(data[1]))
        stored = self._store(self.pending_node_id)
        return None if stored is None else answer(command, self._store_result(stored))

    def _store_result(self, stored: bool) -> int:
        """Return the error code of a store request. A node without storage has 0 in 1010h:01."""
        if stored:
            return OK
        return STORAGE_FAILED if self._objects.optional_number(STORE, 1) else STORAGE_NOT_SUPPORTED

    def _configure_node_id(self, node_id: int) -> int:
        if not 1 <= node_id <= 127 and node_id != UNCONFIGURED_NODE_ID:
            return OUT_OF_RANGE
        self.pending_node_id = node_id
        return OK


def answer(command: int, value: int = 0, specific_error: int = 0) -> CanFrame:
    """Return a response with one byte of value, or SPECIFIC_ERROR and its reason."""
    return CanFrame(SLAVE_ID, struct.pack("<BBB5x", command, value, specific_error))
