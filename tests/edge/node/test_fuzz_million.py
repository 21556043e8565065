"""A million random and mutated frames: no exception, no hang, nothing malformed said, memory bounded."""

from __future__ import annotations

import gc
import random
import struct
import sys
import types
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import pytest

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.errors import BusError
from palpate_edge.node.eds import load_eds
from palpate_edge.node.events import NmtStateChanged, StoreRequested
from palpate_edge.node.nmt import NmtState
from palpate_edge.node.parsed_eds import FINGERTIP_EDS
from palpate_edge.node.sdo_block import crc16
from palpate_edge.node.slave import Slave, SlaveOutput

DRIVE_EDS = Path(__file__).resolve().parents[3] / "host" / "palpate_bus" / "eds" / "cia402.eds"
DICTIONARIES = {"fingertip": load_eds(FINGERTIP_EDS, 0x10), "drive": load_eds(DRIVE_EDS, 0x10)}
SIGNATURES = (b"save", b"load", b"zero")
FRAMES = 1_000_000
ROUNDS = 8

# First bytes of all that an SDO server says: the initiates, segments, ends and the abort of CiA 301.
SDO_ANSWERS = {0x80, 0x60, 0x20, 0x30, 0xA0, 0xA1, 0xA2, 0xA4, 0x40, 0x41, 0x42, 0x43, 0x47, 0x4B, 0x4F, 0xC6}
LSS_ANSWERS = {0x11, 0x13, 0x17, 0x44, 0x4F, 0x50, 0x5A, 0x5B, 0x5C, 0x5D, 0x5E}


class Traffic:
    """Frames for one slave: dialogues by the standard, some of them spoilt, and noise."""

    def __init__(self, rng: random.Random, slave: Slave, indices: list[int]) -> None:
        self._rng = rng
        self._slave = slave
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
        can_id = 0x600 + self._slave.node_id & 0x7FF
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
        """The standard's procedure for a TPDO, with objects by chance."""
        rng, number = self._rng, self._rng.randrange(4)
        own = 0x180 + 0x100 * number + self._slave.node_id
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
        return [CanFrame(0x000, bytes([command, self._rng.choice((0, self._slave.node_id))]))]

    def _lss(self) -> list[CanFrame]:
        rng = self._rng
        commands = (0x04, 0x04, 0x11, 0x13, 0x17, *range(0x40, 0x4D), 0x51, *range(0x5A, 0x5F))
        frames = [
            CanFrame(0x7E5, bytes([rng.choice((0x15, *commands)), rng.choice((0, 0, 1, 2))]) + bytes(6)),
            CanFrame(0x7E5, bytes([rng.choice(commands)]) + rng.randbytes(7)),
        ]
        if self._slave.node_id == 255 or rng.random() < 0.1:
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


def lengths_by_id(slave: Slave) -> dict[int, set[int]]:
    """Every identifier that the node may send with now, by its objects, and the lengths that go with it."""
    lengths = defaultdict(set, {0x7E4: {8}, 0x700 + slave.node_id: {1}, int(slave.read(0x1200, 2)): {8}})
    emcy = int(slave.read(0x1014))
    if not emcy >> 31:
        lengths[emcy & 0x7FF].add(8)
    for number in range(512):
        try:
            cob_id = int(slave.read(0x1800 + number, 1))
        except BusError:  # the fingertip has five TPDOs, the drive two
            break
        words = [
            int(slave.read(0x1A00 + number, 1 + slot)) for slot in range(int(slave.read(0x1A00 + number)))
        ]
        if not cob_id >> 31:
            lengths[cob_id & 0x7FF].add(sum(word & 0xFF for word in words) // 8)
    return lengths


def check(
    slave: Slave, before: dict[int, set[int]], was: NmtState, output: SlaveOutput, now_us: int
) -> dict[int, set[int]]:
    """Everything that was said is whole, of this node, and allowed in its state."""
    assert now_us <= output.next_due_us <= now_us + 1_000_000
    if not output.frames_out and not output.events:
        return before
    after = lengths_by_id(slave)
    states = {was, slave.state} | {
        event.state for event in output.events if isinstance(event, NmtStateChanged)
    }
    sdo_ids = {int(slave.read(0x1200, 2))}
    for frame in output.frames_out:
        assert not frame.remote
        assert len(frame.data) in before[frame.can_id] | after[frame.can_id], frame
        if frame.can_id == 0x7E4:
            assert frame.data[0] in LSS_ANSWERS
        elif frame.can_id == 0x700 + slave.node_id:
            assert frame.data[0] in (0, 4, 5, 127)
        elif frame.can_id in sdo_ids:
            assert states & {NmtState.PRE_OPERATIONAL, NmtState.OPERATIONAL}
        elif len(frame.data) != 8 or frame.can_id not in (
            int(slave.read(0x1014)) & 0x7FF,
            0x80 + slave.node_id,
        ):
            assert NmtState.OPERATIONAL in states
    return after


def reachable_bytes(slave: Slave) -> int:
    """All that the slave holds, without code and classes."""
    gc.collect()
    seen: dict[int, object] = {}
    waiting: list[object] = [slave]
    while waiting:
        item = waiting.pop()
        if id(item) in seen or isinstance(
            item, type | types.ModuleType | types.FunctionType | types.CodeType
        ):
            continue
        seen[id(item)] = item
        waiting += gc.get_referents(item)
    return sum(sys.getsizeof(item) for item in seen.values())


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(ROUNDS))
def test_random_and_mutated_frames(seed: int) -> None:
    bulk("drive" if seed % 4 == 3 else "fingertip", seed, FRAMES // ROUNDS)


@pytest.mark.parametrize("device", DICTIONARIES)
def test_a_few_frames(device: str) -> None:
    bulk(device, 99, 20_000)


def bulk(device: str, seed: int, count: int) -> None:
    rng = random.Random(seed)
    od = DICTIONARIES[device]
    slave = Slave(od)
    traffic = iter(Traffic(rng, slave, sorted(od.indices)))
    now_us, sizes = 0, []
    lengths = lengths_by_id(slave)
    sdo_answers = set()
    for number in range(count):
        now_us += rng.choice((0, 10, 100, 1_000, 20_000))
        if number % 7 == 0:
            slave.trigger((1, 2))
        was = slave.state
        output = slave.process(now_us, (next(traffic),))
        lengths = check(slave, lengths, was, output, now_us)
        sdo_answers |= {frame.data[0] for frame in output.frames_out if frame.can_id == 0x590}
        for event in output.events:
            if isinstance(event, StoreRequested) and rng.random() < 0.9:
                slave.store_finished(rng.random() < 0.8)
        if number % (count // 10) == count // 10 - 1:
            sizes.append(reachable_bytes(slave))
    assert max(sizes) < 1.2 * sizes[0]
    assert sdo_answers >= {0x80, 0x60, 0x20, 0x30, 0xA1, 0xA2, 0xA4, 0x41, 0x43, 0x4B, 0x4F, 0xC6}
    assert_alive(slave, now_us + 1_000_000)


def assert_alive(slave: Slave, now_us: int) -> None:
    """After all that, a reset node brings it back to what it was."""
    for request in (b"\x04\x01", b"\x11\x10", b"\x04\x00"):
        slave.process(now_us, (CanFrame(0x7E5, request.ljust(8, b"\x00")),))
    slave.process(now_us, (CanFrame(0x000, b"\x82\x00"),))
    answer = slave.process(now_us, (CanFrame(0x610, b"\x40\x00\x10".ljust(8, b"\x00")),))
    assert (
        CanFrame(0x590, b"\x43\x00\x10\x00" + int(slave.read(0x1000)).to_bytes(4, "little"))
        in answer.frames_out
    )
