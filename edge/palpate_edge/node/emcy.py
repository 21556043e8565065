"""Emergency producer (CiA 301, 7.2.7): error code, error register 1001h, five manufacturer-specific bytes.

An error is reported once when it occurs and once when it is cleared (code 0x0000); 1003h keeps the last ones.
Messages are queued while the node may not send (INITIALISING, STOPPED, 1014h not valid, inhibit time 1015h).
The queue keeps the newest :data:`LONGEST_QUEUE`. Without an inhibit time :data:`BURST` messages may follow
each other, and one every :data:`PACE_US` after them: an error that flickers must not fill the bus.
"""

from __future__ import annotations

import struct
from collections import deque
from enum import IntEnum, IntFlag

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.node.cob_ids import CAN_ID_MASK, NOT_VALID, check_cob_id
from palpate_edge.node.nmt import SDO_STATES, NmtState
from palpate_edge.node.object_dictionary import Entry
from palpate_edge.node.object_store import ERROR_HISTORY, ObjectStore
from palpate_edge.node.sdo_abort import AbortCode, SdoAbortError

COB_ID, INHIBIT_TIME = 0x1014, 0x1015
ERROR_RESET = 0x0000
LONGEST_QUEUE = 32
INFO_BYTES = 5
BURST, PACE_US = 32, 10_000


class EmcyCode(IntEnum):
    """Codes of CiA 301 that the node core reports, and that of a recovered bus."""

    DATA_SET = 0x6300
    HEARTBEAT = 0x8130
    BUS_OFF_RECOVERED = 0x8140
    PDO_LENGTH = 0x8210
    PDO_LENGTH_EXCEEDED = 0x8220
    SYNC_LENGTH = 0x8240
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


def is_temperature(code: int) -> bool:
    """Return whether an error code is a temperature error: 4xxxh (CiA 301, 7.2.7.1)."""
    return code & 0xF000 == 0x4000


class EmergencyProducer:
    """Producer of EMCY messages; it keeps the active errors, 1001h and 1003h.

    An error is identified by its code and its `info`, the manufacturer-specific bytes (five at most).
    """

    def __init__(self, store: ObjectStore) -> None:
        self._store = store
        self._active: dict[tuple[int, bytes], ErrorRegister] = {}
        self._unsent: deque[bytes] = deque(maxlen=LONGEST_QUEUE)
        self._inhibited_until_us = 0
        self._paced_until_us = 0
        self._due_us: int | None = None
        self._history_length = sum(index == ERROR_HISTORY for index, _ in store.od.entries) - 1

    def reset(self) -> None:
        """Clear all errors and the queue, for an NMT reset."""
        self._active.clear()
        self._unsent.clear()
        self._inhibited_until_us = 0
        self._due_us = None
        self._update_register()

    def report(self, code: int, register: ErrorRegister, info: bytes = b"") -> None:
        """Report an error that has occurred; no effect while it is already active."""
        if (code, info) not in self._active:
            self._active[code, info] = register
            self._queue(code, info)
            self._remember(code, info)

    def clear(self, code: int, info: bytes = b"") -> None:
        """Report that an error no longer exists; no effect when it was not active."""
        if self._active and self._active.pop((code, info), None) is not None:
            self._queue(ERROR_RESET, b"")

    def check_write(self, entry: Entry, value: int) -> None:
        """Raise SdoAbortError for a value other than 0 in 1003h:00, or a changed id in a valid 1014h."""
        if entry.index == ERROR_HISTORY and value != 0:
            raise SdoAbortError(AbortCode.VALUE_INVALID)
        if entry.index == COB_ID:
            check_cob_id(value, flags=NOT_VALID)
            old = self._store.number(COB_ID)
            if not (old | value) & NOT_VALID and old != value:
                raise SdoAbortError(AbortCode.VALUE_INVALID)

    def can_id(self) -> int | None:
        """Return the identifier of this node's emergencies, None while 1014h is not valid."""
        cob_id = self._store.number(COB_ID)
        return None if cob_id & NOT_VALID else cob_id & CAN_ID_MASK

    def due_us(self) -> int | None:
        """Return the time at which the inhibit time of a queued message ends, None without one."""
        return self._due_us

    def poll(self, now_us: int, state: NmtState) -> list[CanFrame]:
        """Return the messages that may be transmitted now."""
        self._due_us = None
        can_id = self.can_id() if self._unsent and state in SDO_STATES else None
        if can_id is None:
            return []
        frames = []
        if now_us >= self._inhibited_until_us:
            inhibit_us = 100 * self._store.optional_number(INHIBIT_TIME)
            count = 1 if inhibit_us else self._paced(now_us)
            frames = [CanFrame(can_id, self._unsent.popleft()) for _ in range(count)]
            self._inhibited_until_us = now_us + inhibit_us
        if self._unsent:
            self._due_us = max(self._inhibited_until_us, self._paced_until_us - (BURST - 1) * PACE_US)
        return frames

    def _paced(self, now_us: int) -> int:
        """Return how many of the queued messages may be sent now, and take note of them."""
        from_us = max(now_us, self._paced_until_us)
        count = min(len(self._unsent), (now_us + BURST * PACE_US - from_us) // PACE_US)
        self._paced_until_us = from_us + count * PACE_US
        return count

    def _queue(self, code: int, info: bytes) -> None:
        register = self._update_register()
        self._unsent.append(struct.pack("<HB5s", code, register, info[:INFO_BYTES]))

    def _remember(self, code: int, info: bytes) -> None:
        """Insert the newest error as 1003h:01; its upper half holds the first two manufacturer bytes."""
        if self._history_length < 1:
            return
        fields = [self._store.number(ERROR_HISTORY, sub) for sub in range(1, self._history_length)]
        newest = code | int.from_bytes(info[:2], "little") << 16
        for subindex, field in enumerate([newest, *fields], 1):
            self._store.values[ERROR_HISTORY, subindex] = field
        count = min(self._history_length, self._store.number(ERROR_HISTORY) + 1)
        self._store.values[ERROR_HISTORY, 0] = count

    def _update_register(self) -> ErrorRegister:
        register = ErrorRegister(0)
        for bits in self._active.values():
            register |= bits | ErrorRegister.GENERIC
        self._store.values[0x1001, 0] = int(register)
        return register
