"""Length of a CAN FD frame on the wire, with the stuff bits of its real content.

Source: ISO 11898-1:2015, frame fields and stuffing. Stuffing by content ends with the data field. The CRC
field has a fixed stuff bit before its first bit and after each four bits, so its length depends on the data
length only. Frames have 11-bit identifiers and switch the bit rate (BRS recessive).
"""

from __future__ import annotations

from dataclasses import dataclass

from palpate_bus.load.bit_count import StuffState, frame_bits, stuff
from palpate_edge.can_bus.can_frame import FD_LENGTHS, CanFrame

# RRS, IDE, FDF, res, BRS behind the identifier.
_CONTROL = 0b00101
# Acknowledge slot and delimiter, end of frame (7), interframe space (3).
_TAIL_BITS = 12
_AFTER_BRS: StuffState = (1, 1)  # BRS is recessive, the bit before it dominant


@dataclass(frozen=True, slots=True)
class FdBits:
    """Bits at the nominal and at the data bit rate. BRS counts as nominal and the CRC delimiter as data: the
    rate switches at the sample point of both, so they are one bit of each rate together."""

    nominal: int
    data: int

    def nominal_bits(self, bitrate: int, data_bitrate: int) -> float:
        """Return the length in bit times of the nominal rate."""
        return self.nominal + self.data * bitrate / data_bitrate


def bit_times(frame: CanFrame, bitrate: int, data_bitrate: int | None) -> float:
    """Return the length of a classic or CAN FD frame in bit times of the nominal rate.

    data_bitrate: bit/s; None on a classic bus, which has no CAN FD frames.
    """
    if not frame.fd or data_bitrate is None:
        return frame_bits(frame)
    return fd_frame_bits(frame.can_id, frame.data).nominal_bits(bitrate, data_bitrate)


def fd_frame_bits(can_id: int, data: bytes) -> FdBits:
    """Return the bits from start of frame to the end of the interframe space.

    Raises ValueError if no DLC has the length of `data`.
    """
    dlc = FD_LENGTHS.index(len(data))
    _, header = stuff((1, 0), (can_id << 5) | _CONTROL, 17)
    *fields, (last, width) = [(dlc, 5), *((byte, 8) for byte in data)]  # ESI is dominant: a leading zero
    state, count = _AFTER_BRS, 0
    for bits, bits_wide in fields:
        state, sent = stuff(state, bits, bits_wide)
        count += sent
    # The fixed stuff bit replaces one after the last bit.
    _, sent = stuff(state, last >> 1, width - 1)
    return FdBits(header + _TAIL_BITS, count + sent + 1 + _crc_field_bits(len(data)))


def least_fd_bits(length: int) -> FdBits:
    """Return the bits of a frame of `length` bytes without stuff bits by content."""
    return FdBits(17 + _TAIL_BITS, 5 + 8 * length + _crc_field_bits(length))


def worst_fd_bits(length: int) -> FdBits:
    """Return an upper bound of the bits: a stuff bit after the first five bits and each four more.

    Bordoloi, Samii, RTSS 2014 have the same bound, less the stuff count (5 bits) that ISO 11898-1:2015 added.
    """
    least = least_fd_bits(length)
    return FdBits(least.nominal + 3, least.data + 2 * length)


def _crc_field_bits(length: int) -> int:
    """Return the bits of stuff count (4), CRC-17 or CRC-21, fixed stuff bits and CRC delimiter."""
    return 4 + 17 + 6 + 1 if length <= 16 else 4 + 21 + 7 + 1
