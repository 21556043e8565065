"""LSS slave (CiA 305): node id and bit rate configured over the bus; 1018h identifies the node.

A node id takes effect with the next NMT reset communication. A node without an id boots up as soon as it has
one and LSS returns to the waiting state (switch state global).
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from enum import IntEnum

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.node.object_dictionary import UNCONFIGURED_NODE_ID
from palpate_edge.node.object_store import ObjectStore

MASTER_ID, SLAVE_ID = 0x7E5, 0x7E4
FRAME_BYTES = 8
IDENTITY = 0x1018

OK, OUT_OF_RANGE = 0, 1
STORAGE_FAILED = 2

BIT_RATES_KBIT_S = {0: 1000, 1: 800, 2: 500, 3: 250, 4: 125, 6: 50, 7: 20, 8: 10}
"""Bit timing table 0 of CiA 301, in kbit/s by table index; index 5 is reserved."""

FASTSCAN_RESET = 0x80
HIGHEST_BIT = 31


class LssCommand(IntEnum):
    """Command specifiers: the first byte of a message."""

    SWITCH_GLOBAL = 0x04
    CONFIGURE_NODE_ID = 0x11
    CONFIGURE_BIT_TIMING = 0x13
    ACTIVATE_BIT_TIMING = 0x15
    STORE = 0x17
    SELECT_FIRST, SELECT_LAST, SELECTED = 0x40, 0x43, 0x44
    IDENTIFY_FIRST, IDENTIFY_LAST = 0x46, 0x4B
    IDENTIFY_NON_CONFIGURED = 0x4C
    IDENTIFY_SLAVE = 0x4F
    NON_CONFIGURED_SLAVE = 0x50
    FASTSCAN = 0x51
    INQUIRE_FIRST, INQUIRE_LAST, INQUIRE_NODE_ID = 0x5A, 0x5D, 0x5E


class LssSlave:
    """The LSS states waiting and configuration, and the pending node id and bit rate.

    store: called to store both; returns True when both are stored already, False when it is not possible now,
    None when `confirm_store` follows. activate: called with the new bit
    rate in kbit/s and the switch delay in us.
    """

    def __init__(
        self,
        objects: ObjectStore,
        store: Callable[[int, int | None], bool | None],
        activate: Callable[[int, int], None],
    ) -> None:
        self._objects = objects
        self._store = store
        self._activate = activate
        self.pending_node_id = objects.od.node_id
        self.pending_bit_rate_kbit_s: int | None = None
        self.configuring = False
        self._selected = 0
        self._identified = 0
        self._fastscan_part = 0

    @property
    def leaves_unconfigured(self) -> bool:
        """True when a node without an id has received one and LSS is waiting again: it may boot up."""
        unconfigured = self._objects.od.node_id == UNCONFIGURED_NODE_ID
        return unconfigured and not self.configuring and self.pending_node_id != UNCONFIGURED_NODE_ID

    def confirm_store(self, stored: bool) -> list[CanFrame]:
        """Return the response to the store request."""
        return [answer(LssCommand.STORE, OK if stored else STORAGE_FAILED)]

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
            case LssCommand.CONFIGURE_NODE_ID:
                return answer(command, self._configure_node_id(data[1]))
            case LssCommand.CONFIGURE_BIT_TIMING:
                return answer(command, self._configure_bit_timing(data[1], data[2]))
            case LssCommand.ACTIVATE_BIT_TIMING:
                if self.pending_bit_rate_kbit_s is not None:
                    delay_ms: int = struct.unpack_from("<H", data, 1)[0]
                    self._activate(self.pending_bit_rate_kbit_s, 1000 * delay_ms)
            case LssCommand.STORE:
                stored = self._store(self.pending_node_id, self.pending_bit_rate_kbit_s)
                if stored is not None:
                    return answer(command, OK if stored else STORAGE_FAILED)
        return None

    def _configure_node_id(self, node_id: int) -> int:
        if not 1 <= node_id <= 127 and node_id != UNCONFIGURED_NODE_ID:
            return OUT_OF_RANGE
        self.pending_node_id = node_id
        return OK

    def _configure_bit_timing(self, table: int, index: int) -> int:
        bit_rate_kbit_s = BIT_RATES_KBIT_S.get(index)
        if table != 0 or bit_rate_kbit_s not in self._objects.od.bit_rates_kbit_s:
            return OUT_OF_RANGE
        self.pending_bit_rate_kbit_s = bit_rate_kbit_s
        return OK


def answer(command: int, value: int = 0) -> CanFrame:
    """Return a response with one byte of value."""
    return CanFrame(SLAVE_ID, struct.pack("<BB6x", command, value))
