"""Assembles the TPDOs of a fingertip into one time-stamped contact (docs/bus.md).

TPDO 1 carries position and normal force, TPDO 2 shear, torsion, flags and quality, TPDO 3 exposure time,
sequence and latency. A node sends the set of a frame back to back, TPDO 3 last; only a whole, coherent set
counts. TPDO 5 to 9 carry further quantities and the sequence. Each belongs to the set of a node that sends
it; the contacts of a node that does not send it are complete without it. Parts that were lost, duplicated or
delayed are counted by name and never mixed into another frame's contact. On a CAN FD bus TPDO 10 alone is the
set.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.contact_quantities import (
    AI_INPUT,
    BASE_TPDOS,
    CONTACT_TPDOS,
    EXTRA_TPDOS,
    FD_TPDO,
    POSE_TPDOS,
    fields_of,
)
from palpate_edge.common.errors import BusError
from palpate_edge.node.eds import load_eds
from palpate_edge.node.fd_bus import on_fd_bus
from palpate_edge.node.fingertip_objects import (
    EXPOSURE_TIME,
    FLAGS,
    LATENCY,
    QUALITY,
    SEQUENCE,
    VALID_FLAGS,
    ContactFlag,
)
from palpate_edge.node.object_dictionary import ObjectKey
from palpate_edge.node.parsed_eds import FINGERTIP_EDS
from palpate_edge.node.pdo_codec import PdoCodec, PdoDirection, pdo_codec
from palpate_host.common.tip_contact import TipContact

FIRST_TPDOS, LAST_TPDOS = (BASE_TPDOS[0], FD_TPDO), (BASE_TPDOS[-1], FD_TPDO)
# The parts leave the node together; on a 1 Mbit/s bus they arrive within a few of its frame times.
SET_WINDOW_US = 10_000
BUS_CLOCK_WRAP_US = 1 << 32
SEQUENCE_WRAP = 1 << 16
EARLY_LIMIT_US = 5_000  # of a part before its frame was published, for clocks that differ
# After so many sets in a row: with a sequence that does not fit, the node has restarted its count; without a
# TPDO that it sent before, the TPDO has been disabled.
RESYNCHRONISE_AFTER = 5
# So many refused sets within the window are no disturbance: two devices send with one node id.
CROWD = 10
CROWD_WINDOW_US = 1_000_000


@dataclass(slots=True)
class ContactCounters:
    """Counters of a fingertip's contacts and of the parts that made none.

    lost_frames: gaps in the sequence. extra_tpdos: TPDO 5 to 9 taken with their contact; extra_missing: sets
    refused because one that the node sends was lost; extra_mixed: because one is of another frame.
    """

    complete: int = 0
    incomplete: int = 0
    out_of_order: int = 0
    duplicates: int = 0
    late: int = 0
    lost_frames: int = 0
    resynchronised: int = 0
    extra_tpdos: int = 0
    extra_missing: int = 0
    extra_mixed: int = 0


class Fingertip:
    """Assembles one node's sets of TPDOs."""

    def __init__(self, node_id: int, name: str, *, poses: bool = True, fd: bool = False) -> None:
        """poses: False when another node of the hand has the identifiers of the poses' classic TPDOs.

        fd: on a CAN FD bus.
        """
        od = load_eds(FINGERTIP_EDS, node_id)
        numbers = [number for number in CONTACT_TPDOS if poses or number not in POSE_TPDOS]
        numbers = [FD_TPDO] if fd else numbers
        self.name = name
        self._node_id = node_id
        self.counters = ContactCounters()
        self._codecs = {number: pdo_codec(od, PdoDirection.TRANSMIT, number) for number in numbers}
        self._fd_with_poses: PdoCodec | None = None
        if fd:
            self._fd_with_poses = pdo_codec(on_fd_bus(od, poses=True), PdoDirection.TRANSMIT, FD_TPDO)
        self._numbers = {codec.cob_id: number for number, codec in self._codecs.items()}
        self._started_us = 0  # first TPDO of the set that is being assembled
        self._parts: dict[int, bytes] = {}  # of that set, by TPDO number
        self._last_part: tuple[int, int, bytes] | None = None
        self._last_sequence: int | None = None
        self._begun_since_last = 0
        self._refused_in_a_row = 0
        self._missing_in_a_row: dict[int, int] = {}  # of each extra TPDO that the node sends
        self._crowded_us: deque[int] = deque(maxlen=CROWD)

    @property
    def receive_ids(self) -> tuple[int, ...]:
        """The identifiers that `receive` understands."""
        return tuple(self._numbers)

    def forget(self) -> None:
        """Start again: the node has booted and restarts its sequence."""
        self._parts.clear()
        self._last_part = None
        self._last_sequence = None
        self._begun_since_last = 0
        self._missing_in_a_row.clear()
        self._crowded_us.clear()

    def receive(self, stamp_us: int, frame: CanFrame) -> TipContact | None:
        """Take one TPDO; return a contact when the TPDO completes a coherent set.

        Raises BusError, with node and PDO, when the length is not that of the EDS, and when the sequence
        numbers are those of two devices.
        """
        number = self._numbers[frame.can_id]
        codec = self._codec(number, frame.data)
        if len(frame.data) != codec.length_bytes:
            codec.decode(frame.data)
        if self._is_duplicate(number, stamp_us, frame.data):
            self.counters.duplicates += 1
            return None
        self._last_part = (number, stamp_us, frame.data)
        if number in FIRST_TPDOS:
            self.counters.incomplete += bool(self._parts)
            self._started_us, self._parts = stamp_us, {}
            self._begun_since_last = 1 if number == FD_TPDO else self._begun_since_last + 1
        elif not self._is_expected(number):
            self.counters.out_of_order += 1
            self._parts.clear()
            return None
        elif stamp_us - self._started_us > SET_WINDOW_US:
            self.counters.late += 1
            self._parts.clear()
            return None
        self._parts[number] = frame.data
        if number not in LAST_TPDOS:
            return None
        parts, self._parts = self._parts, {}
        return self._complete(stamp_us, parts)

    def _codec(self, number: int, data: bytes) -> PdoCodec:
        """Return the codec of a TPDO. TPDO 10 of a sensor that gives poses is longer than that of others."""
        poses = self._fd_with_poses
        return poses if poses is not None and len(data) == poses.length_bytes else self._codecs[number]

    def _is_duplicate(self, number: int, stamp_us: int, data: bytes) -> bool:
        if self._last_part is None:
            return False
        last_number, last_stamp_us, last_data = self._last_part
        same = last_number == number and last_data == data
        return same and stamp_us - last_stamp_us <= SET_WINDOW_US

    def _is_expected(self, number: int) -> bool:
        """Return whether a part continues the set: base TPDOs in their order, extra TPDOs between them."""
        if number in EXTRA_TPDOS:
            return bool(self._parts) and number not in self._parts
        base = [part for part in self._parts if part in BASE_TPDOS]
        return len(base) == BASE_TPDOS.index(number)

    def _complete(self, stamp_us: int, parts: dict[int, bytes]) -> TipContact | None:
        """Return the contact, unless a part is missing or belongs to another frame.

        A part belongs to another frame when it arrived before the frame of TPDO 3 was published, when an
        extra TPDO has another sequence, or when the sequence does not follow the last one.
        """
        values = {number: self._codec(number, data).decode(data) for number, data in parts.items()}
        extra = [number for number in values if number in EXTRA_TPDOS]
        contact = decode_contact(
            {key: raw for part in values.values() for key, raw in part.items()}, stamp_us
        )
        if self._started_us < contact.exposed_at_us + contact.latency_us - EARLY_LIMIT_US:
            self.counters.late += 1
            return None
        if any(values[number][SEQUENCE, 0] != contact.sequence for number in extra):
            self.counters.extra_mixed += 1
            self._note_refusal(stamp_us)
            return None
        if self._misses_one(extra):
            self.counters.extra_missing += 1
            return None
        if not self._is_next(contact.sequence):
            self.counters.late += 1
            self._note_refusal(stamp_us)
            return None
        self._missing_in_a_row.update(dict.fromkeys(extra, 0))
        self.counters.extra_tpdos += len(extra)
        self.counters.complete += 1
        return contact

    def _misses_one(self, extra: list[int]) -> bool:
        """Return whether the set lacks an extra TPDO that the node sends.

        A TPDO that is missing from RESYNCHRONISE_AFTER sets in a row has been disabled; then it is not
        required.
        """
        missing = [number for number in self._missing_in_a_row if number not in extra]
        for number in missing:
            self._missing_in_a_row[number] += 1
        disabled = [number for number in missing if self._missing_in_a_row[number] >= RESYNCHRONISE_AFTER]
        for number in disabled:
            del self._missing_in_a_row[number]
        return len(disabled) < len(missing)

    def _note_refusal(self, now_us: int) -> None:
        self._crowded_us.append(now_us)
        if len(self._crowded_us) == CROWD and now_us - self._crowded_us[0] <= CROWD_WINDOW_US:
            raise BusError(
                f"{self.name}: two devices send as node 0x{self._node_id:02X}: disconnect one, or give it"
                " another id (palpate-host bus lss)"
            )

    def _is_next(self, sequence: int) -> bool:
        """Return whether the sequence number fits the frames begun since the last contact.

        Each TPDO 1 or 10 begins a frame. A TPDO 3 that was delayed into the next frame's set therefore
        carries a number that is too small, as does every part older than the last contact.
        """
        if self._last_sequence is not None:
            step = (sequence - self._last_sequence) % SEQUENCE_WRAP
            if not self._begun_since_last <= step < SEQUENCE_WRAP // 2:
                self._refused_in_a_row += 1
                if self._refused_in_a_row < RESYNCHRONISE_AFTER:
                    return False
                self.counters.resynchronised += 1
            else:
                self.counters.lost_frames += step - 1
        self._last_sequence = sequence
        self._begun_since_last = 0
        self._refused_in_a_row = 0
        return True


def decode_contact(values: Mapping[ObjectKey, int], stamp_us: int) -> TipContact:
    """Return the contact in the raw values of a set, in engineering units.

    stamp_us: when the last part of the set arrived, on the host's clock.
    """
    flags = values[FLAGS, 0]
    valid = bool(flags & VALID_FLAGS)
    return TipContact(
        received_at_us=stamp_us,
        exposed_at_us=unwrap_us(values[EXPOSURE_TIME, 0], stamp_us),
        sequence=values[SEQUENCE, 0],
        latency_us=values[LATENCY, 0],
        **fields_of({subindex: raw for (index, subindex), raw in values.items() if index == AI_INPUT}),
        valid=valid,
        in_contact=valid and bool(flags & ContactFlag.CONTACT),
        slip=bool(flags & ContactFlag.SLIP),
        slip_begins=bool(flags & ContactFlag.SLIP_BEGINS),
        quality=values[QUALITY, 0],
    )


def unwrap_us(bus_clock_us: int, near_us: int) -> int:
    """Return the epoch time nearest to `near_us` that a 32-bit bus clock (epoch us modulo 2^32) can mean."""
    half = BUS_CLOCK_WRAP_US // 2
    return near_us + (bus_clock_us - near_us + half) % BUS_CLOCK_WRAP_US - half
