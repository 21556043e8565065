"""Length of a classic CAN frame on the wire in bits, with CRC-15 and the stuff bits of its real content.

Source: Bosch CAN Specification 2.0 (1991), part A: 3.1.1 (frame fields), 3.1.1 CRC field (generator
x^15+x^14+x^10+x^8+x^7+x^4+x^3+1), 5 (bit stuffing: start of frame to CRC sequence); ISO 11898-1, 10.
"""

from __future__ import annotations

from functools import cache

from palpate_edge.can_bus.can_frame import CanFrame

CRC_POLYNOMIAL = 0x4599
CRC_MASK = 0x7FFF
# CRC delimiter, acknowledge slot and delimiter, end of frame (7), interframe space (3): never stuffed.
TAIL_BITS = 1 + 1 + 1 + 7 + 3

# A stuffing state is (level of the last bit, how many equal bits in a row), a stuff bit included.
StuffState = tuple[int, int]
_IDLE: StuffState = (1, 0)


def frame_bits(frame: CanFrame) -> int:
    """Return the bits from start of frame to the end of the interframe space (3 bits), with stuff bits.

    47 + 8 n (n data bytes) plus 0 to floor((33 + 8 n) / 4) stuff bits. A remote frame has no data bits.
    """
    data = b"" if frame.remote else frame.data
    state, count, crc = _header(frame.can_id, frame.remote, len(frame.data))
    for byte in data:
        state, stuffed = stuff(state, byte, 8)
        count += stuffed
        crc = ((crc << 8) & CRC_MASK) ^ _crc_of_byte((crc >> 7) ^ byte)
    state, high = stuff(state, crc >> 8, 7)
    _, low = stuff(state, crc & 0xFF, 8)
    return count + high + low + TAIL_BITS


@cache
def _header(can_id: int, remote: bool, length: int) -> tuple[StuffState, int, int]:
    """Return (stuffing state, bits, CRC) after start of frame, identifier, RTR, IDE, r0 and DLC: 19 bits."""
    bits = (can_id << 7) | (int(remote) << 6) | length
    state, count = stuff(_IDLE, bits, 19)
    crc = 0
    for shift in (16, 8, 0):  # 24 bits: leading zeros do not change a CRC that starts at zero
        crc = ((crc << 8) & CRC_MASK) ^ _crc_of_byte(((crc >> 7) ^ (bits >> shift)) & 0xFF)
    return state, count, crc


@cache
def stuff(state: StuffState, bits: int, width: int) -> tuple[StuffState, int]:
    """Return (state, bits sent) after `width` bits, most significant first, with stuffing."""
    level, run = state
    sent = width
    for shift in range(width - 1, -1, -1):
        bit = (bits >> shift) & 1
        run = run + 1 if bit == level else 1
        level = bit
        if run == 5:  # the stuff bit is the opposite level and starts a run of its own
            level, run = 1 - bit, 1
            sent += 1
    return (level, run), sent


@cache
def _crc_of_byte(byte: int) -> int:
    crc = byte << 7
    for _ in range(8):
        crc <<= 1
        if crc & 0x8000:
            crc ^= 0x8000 | CRC_POLYNOMIAL
    return crc
