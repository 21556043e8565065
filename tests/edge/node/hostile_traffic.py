"""Hostile CANopen traffic: SDO, LSS, NMT, SYNC and PDO dialogues, cut and damaged at random, and noise."""

from __future__ import annotations

import random
import struct
from collections.abc import Callable, Iterator, Sequence

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.node.sdo_block import crc16

SIGNATURES = (b"save", b"load", b"zero")


class Traffic:
    """Frames for one node: dialogues by the standard, 5 % of the frames damaged, and noise."""

    def __init__(self, rng: random.Random, node_id: Callable[[], int], indices: Sequence[int]) -> None:
        """node_id: returns the present id of the node, 255 without one; indices: of its objects."""
        self._rng = rng
        self._node_id = node_id
        self._indices = indices
        self._sources = (
            [self._sdo_dialogue] * 10
            + [self._sdo_noise] * 4
            + [self._nmt, self._lss, self._pdo]
            + [self._noise] * 3
        )

    def __iter__(self) -> Iterator[CanFrame]:
        while True:
            for frame in self._rng.choice(self._sources)():
                yield self._spoilt(frame) if self._rng.random() < 0.05 else frame

    def _spoilt(self, frame: CanFrame) -> CanFrame:
        data = bytearray(frame.data)
        match self._rng.randrange(4):
            case 0 if data:
                data[self._rng.randrange(len(data))] ^= 1 << self._rng.randrange(8)
            case 1:
                del data[self._rng.randrange(len(data) + 1) :]
            case 2:
                return CanFrame(frame.can_id ^ 1 << self._rng.randrange(11), frame.data)
            case _:
                return CanFrame(frame.can_id, frame.data, remote=True)
        return CanFrame(frame.can_id, bytes(data))

    def _key(self) -> bytes:
        return struct.pack(
            "<HB", self._rng.choice(self._indices), self._rng.choice((0, 0, 1, 1, 2, 3, 5, 6, 9))
        )

    def _value(self) -> bytes:
        rng = self._rng
        return rng.choice((rng.randbytes(4), bytes(4), bytes([rng.randrange(256), 0, 0, 0]), *SIGNATURES))

    def _sdo(self, *requests: bytes) -> list[CanFrame]:
        can_id = 0x600 + self._node_id() & 0x7FF
        return [CanFrame(can_id, request.ljust(8, b"\x00")) for request in requests]

    def _sdo_dialogue(self) -> list[CanFrame]:
        rng, key = self._rng, self._key()
        text = bytes(rng.choices(b"abc", k=rng.choice((1, 2, 4, 17, 60, 70, 300))))
        parts = [text[at : at + 7] for at in range(0, len(text), 7)]
        match rng.randrange(6):
            case 0:
                return self._sdo(bytes([rng.choice((0x22, 0x23, 0x2B, 0x2F))]) + key + self._value())
            case 1:
                return self._sdo(
                    b"\x40" + key, *(bytes([0x60 | n % 2 << 4]) for n in range(rng.randrange(5)))
                )
            case 2:
                head = rng.choice((b"\x21", b"\x20")) + key + struct.pack("<I", len(text))
                segments = [
                    bytes([n % 2 << 4 | 7 - len(part) << 1 | (n == len(parts) - 1)]) + part
                    for n, part in enumerate(parts)
                ]
                return self._sdo(head, *segments)
            case 3:
                head = rng.choice((b"\xc6", b"\xc4", b"\xc2")) + key + struct.pack("<I", len(text))
                segments = [
                    bytes([n % 127 + 1 | (0x80 if n == len(parts) - 1 else 0)]) + part
                    for n, part in enumerate(parts)
                ]
                end = struct.pack("<BH", 0xC1 | -len(text) % 7 << 2, crc16(text))
                return self._sdo(head, *segments, end)
            case 4:
                blocks = bytes([rng.choice((1, 2, 127, 0, 200)), rng.choice((0, 0, 20))])
                acks = [
                    bytes([0xA2, rng.randrange(4), rng.choice((1, 3, 127))]) for _ in range(rng.randrange(4))
                ]
                return self._sdo(b"\xa4" + key + blocks, b"\xa3", *acks, b"\xa1")
            case _:
                return self._remapping()

    def _remapping(self) -> list[CanFrame]:
        """Return the standard's procedure for the mapping of a TPDO, with random objects."""
        rng, number = self._rng, self._rng.randrange(4)
        own = 0x180 + 0x100 * number + self._node_id()
        words = [rng.choice((0x71300110, 0x20100008, 0x20120020, 0x60410010, 0x10010008)) for _ in range(3)]
        index = struct.pack("<H", 0x1A00 + number)
        communication = struct.pack("<H", 0x1800 + number)
        slots = [
            b"\x23" + index + bytes([slot]) + struct.pack("<I", word) for slot, word in enumerate(words, 1)
        ]
        return self._sdo(
            b"\x23" + communication + b"\x01" + struct.pack("<I", 0xC000_0000 | own),
            b"\x2f" + index + b"\x00\x00",
            *slots,
            b"\x2f" + index + b"\x00" + bytes([rng.randrange(4)]),
            b"\x2f" + communication + b"\x02" + bytes([rng.choice((0, 1, 5, 240, 254, 255))]),
            b"\x23" + communication + b"\x01" + struct.pack("<I", 0x4000_0000 | own),
        )

    def _sdo_noise(self) -> list[CanFrame]:
        return self._sdo(self._rng.randbytes(8))

    def _nmt(self) -> list[CanFrame]:
        command = self._rng.choice((0x01, 0x01, 0x01, 0x02, 0x80, 0x81, 0x82, 0x7F))
        return [CanFrame(0x000, bytes([command, self._rng.choice((0, self._node_id()))]))]

    def _lss(self) -> list[CanFrame]:
        rng = self._rng
        commands = (0x04, 0x04, 0x11, 0x13, 0x17, *range(0x40, 0x4D), 0x51, *range(0x5A, 0x5F))
        frames = [
            CanFrame(0x7E5, bytes([rng.choice((0x15, *commands)), rng.choice((0, 0, 1, 2))]) + bytes(6)),
            CanFrame(0x7E5, bytes([rng.choice(commands)]) + rng.randbytes(7)),
        ]
        if self._node_id() == 255 or rng.random() < 0.1:
            given = bytes([0x11, rng.choice((0x10, 0x10, 0x7F, 0xFF))])
            frames += [CanFrame(0x7E5, one.ljust(8, b"\x00")) for one in (b"\x04\x01", given, b"\x04\x00")]
        return frames

    def _pdo(self) -> list[CanFrame]:
        rng = self._rng
        sync = CanFrame(0x080, rng.choice((b"", b"", b"\x01", b"\x05")))
        rpdo = CanFrame(rng.choice((0x1FF, 0x210, 0x77F, 0x100)), rng.randbytes(rng.randrange(9)))
        return [sync, rpdo, sync]

    def _noise(self) -> list[CanFrame]:
        rng = self._rng
        return [CanFrame(rng.randrange(0x800), rng.randbytes(rng.randrange(9)), rng.random() < 0.1)]
