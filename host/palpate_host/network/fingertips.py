"""From a fingertip's TPDOs 1-3 to one time-stamped contact (docs: the fingertip on the bus).

TPDO 1 carries position and normal force, TPDO 2 shear, torsion, flags and quality, TPDO 3 exposure time,
sequence and latency. A node sends the three of a frame one after the other; only a whole, coherent triple
counts. What the bus dropped, doubled or delayed is counted by name and never mixed into another frame's
contact.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.contact_quantities import AI_INPUT, BASE_TPDOS, fields_of
from palpate_edge.common.errors import BusError
from palpate_edge.node.eds import load_eds
from palpate_edge.node.fingertip_objects import (
    EXPOSURE_TIME,
    FLAGS,
    LATENCY,
    QUALITY,
    SEQUENCE,
    ContactFlag,
)
from palpate_edge.node.parsed_eds import FINGERTIP_EDS
from palpate_edge.node.pdo_codec import PdoCodec, PdoDirection, pdo_codec
from palpate_host.common.tip_contact import TipContact

# The three parts leave the node together; on a 1 Mbit/s bus they arrive within a few of its frame times.
TRIPLE_WINDOW_US = 10_000
BUS_CLOCK_WRAP_US = 1 << 32
SEQUENCE_WRAP = 1 << 16
# After so many refused triples in a row the node must have begun a new count of its own.
EARLY_LIMIT_US = 5_000  # of a part before its frame was published, for clocks that differ
RESYNCHRONISE_AFTER = 5
# So many refused triples within the window are no disturbance: two devices send with one node id.
CROWD = 10
CROWD_WINDOW_US = 1_000_000


@dataclass(slots=True)
class TripleCounters:
    """What happened to a fingertip's parts. lost_frames is what the sequence numbers say is missing."""

    complete: int = 0
    incomplete: int = 0
    out_of_order: int = 0
    duplicates: int = 0
    late: int = 0
    lost_frames: int = 0
    resynchronised: int = 0


class Fingertip:
    """Assembles one node's triples."""

    def __init__(self, node_id: int, name: str) -> None:
        od = load_eds(FINGERTIP_EDS, node_id)
        self.name = name
        self._node_id = node_id
        self.counters = TripleCounters()
        self._codecs = [pdo_codec(od, PdoDirection.TRANSMIT, number) for number in BASE_TPDOS]
        self._parts: list[tuple[int, bytes]] = []
        self._last_part: tuple[int, int, bytes] | None = None
        self._last_sequence: int | None = None
        self._begun_since_last = 0
        self._refused_in_a_row = 0
        self._crowded_us: deque[int] = deque(maxlen=CROWD)

    @property
    def receive_ids(self) -> tuple[int, ...]:
        """The identifiers that `receive` understands."""
        return tuple(codec.cob_id for codec in self._codecs)

    def forget(self) -> None:
        """The node booted anew: its sequence begins again."""
        self._parts.clear()
        self._last_part = None
        self._last_sequence = None
        self._begun_since_last = 0
        self._crowded_us.clear()

    def receive(self, stamp_us: int, frame: CanFrame) -> TipContact | None:
        """Take one TPDO in; returns a contact when it completes a coherent triple.

        BusError, naming node and PDO, when its length is not the EDS's; and when the sequence numbers are
        those of two devices.
        """
        number = self.receive_ids.index(frame.can_id)
        codec = self._codecs[number]
        if len(frame.data) != codec.length_bytes:
            codec.decode(frame.data)
        if self._is_duplicate(number, stamp_us, frame.data):
            self.counters.duplicates += 1
            return None
        self._last_part = (number, stamp_us, frame.data)
        if number == 0:
            self.counters.incomplete += bool(self._parts)
            self._parts = [(stamp_us, frame.data)]
            self._begun_since_last += 1
            return None
        if len(self._parts) != number:
            self.counters.out_of_order += 1
            self._parts.clear()
            return None
        if stamp_us - self._parts[0][0] > TRIPLE_WINDOW_US:
            self.counters.late += 1
            self._parts.clear()
            return None
        self._parts.append((stamp_us, frame.data))
        return self._complete() if number == 2 else None

    def _is_duplicate(self, number: int, stamp_us: int, data: bytes) -> bool:
        if self._last_part is None:
            return False
        last_number, last_stamp_us, last_data = self._last_part
        same = last_number == number and last_data == data
        return same and stamp_us - last_stamp_us <= TRIPLE_WINDOW_US

    def _complete(self) -> TipContact | None:
        """The contact, unless a part is another frame's: one that came before TPDO 3 says the frame was
        published, or one that the sequence numbers tell."""
        contact = decode_triple(self._codecs, self._parts)
        published_us = contact.exposed_at_us + contact.latency_us
        is_whole = self._parts[0][0] >= published_us - EARLY_LIMIT_US
        self._parts.clear()
        if not is_whole:
            self.counters.late += 1
            return None
        if not self._is_next(contact.sequence):
            self.counters.late += 1
            self._note_refusal(contact.received_at_us)
            return None
        self.counters.complete += 1
        return contact

    def _note_refusal(self, now_us: int) -> None:
        self._crowded_us.append(now_us)
        if len(self._crowded_us) == CROWD and now_us - self._crowded_us[0] <= CROWD_WINDOW_US:
            raise BusError(
                f"{self.name}: two devices send as node 0x{self._node_id:02X}: disconnect one, or give it"
                " another id (palpate-host bus lss)"
            )

    def _is_next(self, sequence: int) -> bool:
        """Whether the sequence number fits the frames begun since the last one.

        Each TPDO 1 begins a frame. A TPDO 3 that a delay pushed into the next frame's triple therefore
        carries a number that is too small, as has everything older than what is known.
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


def decode_triple(codecs: list[PdoCodec], parts: list[tuple[int, bytes]]) -> TipContact:
    """The contact in three (stamp, payload) parts, in engineering units."""
    values: dict[tuple[int, int], int] = {}
    for codec, (_, data) in zip(codecs, parts, strict=True):
        values |= codec.decode(data)
    stamp_us = parts[-1][0]
    flags = values[FLAGS, 0]
    valid = bool(flags & ContactFlag.VALID)
    return TipContact(
        received_at_us=stamp_us,
        exposed_at_us=unwrap_us(values[EXPOSURE_TIME, 0], stamp_us),
        sequence=values[SEQUENCE, 0],
        latency_us=values[LATENCY, 0],
        **fields_of({subindex: raw for (index, subindex), raw in values.items() if index == AI_INPUT}),
        valid=valid,
        in_contact=valid and bool(flags & ContactFlag.CONTACT),
        slip=bool(flags & ContactFlag.SLIP),
        quality=values[QUALITY, 0],
    )


def unwrap_us(bus_clock_us: int, near_us: int) -> int:
    """The epoch time nearest to `near_us` that the 32-bit bus clock (epoch us modulo 2^32) can mean."""
    half = BUS_CLOCK_WRAP_US // 2
    return near_us + (bus_clock_us - near_us + half) % BUS_CLOCK_WRAP_US - half
