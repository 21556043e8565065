"""The emergency producer (CiA 301, 7.2.7): error code, error register 1001h, five bytes of the manufacturer.

An error is reported once when it appears and once when it goes (code 0x0000). What appears while the node may
not send (INITIALISING, STOPPED) is sent when it may again.
"""

from __future__ import annotations

import struct
from enum import IntEnum, IntFlag

from palpate_edge.can_frame import CanFrame
from palpate_edge.node.nmt import SDO_STATES, NmtState
from palpate_edge.node.object_store import ObjectStore

ERROR_RESET = 0x0000


class EmcyCode(IntEnum):
    """The codes of CiA 301 that the core itself reports."""

    PDO_LENGTH = 0x8210
    PDO_LENGTH_EXCEEDED = 0x8220
    RPDO_TIMEOUT = 0x8250


class ErrorRegister(IntFlag):
    """Bits of 1001h. GENERIC is set with every error."""

    GENERIC = 0x01
    CURRENT = 0x02
    VOLTAGE = 0x04
    TEMPERATURE = 0x08
    COMMUNICATION = 0x10
    DEVICE_PROFILE = 0x20
    MANUFACTURER = 0x80


class EmergencyProducer:
    """Keeps the active errors and 1001h."""

    def __init__(self, store: ObjectStore) -> None:
        self._store = store
        self._active: dict[int, ErrorRegister] = {}
        self._unsent: list[CanFrame] = []

    def reset(self) -> None:
        """After an NMT reset nothing is active."""
        self._active.clear()
        self._unsent.clear()
        self._update_register()

    def report(self, code: int, register: ErrorRegister) -> None:
        """An error has appeared; does nothing while it is already active."""
        if code not in self._active:
            self._active[code] = register
            self._queue(code)

    def clear(self, code: int) -> None:
        """An error has gone; does nothing when it was not active."""
        if self._active.pop(code, None) is not None:
            self._queue(ERROR_RESET)

    def poll(self, state: NmtState) -> list[CanFrame]:
        if state not in SDO_STATES:
            return []
        frames, self._unsent = self._unsent, []
        return frames

    def _queue(self, code: int) -> None:
        register = self._update_register()
        can_id = self._store.number(0x1014) & 0x7FF
        self._unsent.append(CanFrame(can_id, struct.pack("<HB5x", code, register)))

    def _update_register(self) -> ErrorRegister:
        register = ErrorRegister(0)
        for bits in self._active.values():
            register |= bits | ErrorRegister.GENERIC
        self._store.write(0x1001, 0, int(register))
        return register
