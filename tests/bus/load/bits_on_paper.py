"""Lengths of frames from the standard's fields written as text; shares no code with `palpate_bus.load`."""

from __future__ import annotations

import re

from palpate_edge.can_bus.can_frame import FD_LENGTHS, CanFrame

GENERATOR = "1100010110011001"  # x^15+x^14+x^10+x^8+x^7+x^4+x^3+1, Bosch CAN 2.0 part A, 3.1.1


def remainder(bits: str) -> str:
    """Return the CRC of classic CAN by polynomial long division."""
    digits = [int(bit) for bit in bits] + [0] * 15
    for place in range(len(bits)):
        if digits[place]:
            for offset, bit in enumerate(GENERATOR):
                digits[place + offset] ^= int(bit)
    return "".join(map(str, digits[-15:]))


def stuffed(bits: str) -> str:
    """Return the bits with one of the other level after each five equal ones, from left to right."""
    start = 0
    while (match := re.compile("00000|11111").search(bits, start)) is not None:
        other = "1" if match[0][0] == "0" else "0"
        bits = bits[: match.end()] + other + bits[match.end() :]
        start = match.end()
    return bits


def classic_bits(frame: CanFrame) -> int:
    """Return the length of a frame of classic CAN with the interframe space."""
    data = "" if frame.remote else "".join(f"{byte:08b}" for byte in frame.data)
    fields = f"0{frame.can_id:011b}{int(frame.remote)}00{len(frame.data):04b}{data}"
    delimiter_ack_eof_interframe = 1 + 2 + 7 + 3
    return len(stuffed(fields + remainder(fields))) + delimiter_ack_eof_interframe


def fd_bits(can_id: int, data: bytes) -> tuple[int, int]:
    """Return the nominal and the data bits of a CAN FD frame: the stuffed text is cut behind the BRS bit."""
    fields = f"0{can_id:011b}00101"
    text = fields + f"0{FD_LENGTHS.index(len(data)):04b}" + "".join(f"{byte:08b}" for byte in data)
    start, header_end = 0, len(fields)
    while (match := re.compile("00000|11111").search(text, start)) and match.end() < len(text):
        start = match.end()
        text = text[:start] + ("1" if match[0][0] == "0" else "0") + text[start:]
        header_end += start < header_end
    crc_field = 4 + (17 if len(data) <= 16 else 21)
    fixed = len(range(0, crc_field, 4))  # before the first bit and after each fourth
    return header_end + 2 + 7 + 3, len(text) - header_end + crc_field + fixed + 1
