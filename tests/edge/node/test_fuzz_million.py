"""A million random and mutated frames: no exception, no hang, nothing malformed said, memory bounded."""

from __future__ import annotations

import gc
import random
import sys
import types
from collections import defaultdict
from pathlib import Path

import pytest
from tests.edge.node.hostile_traffic import Traffic

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.errors import BusError
from palpate_edge.node.eds import load_eds
from palpate_edge.node.events import NmtStateChanged, StoreRequested
from palpate_edge.node.nmt import NmtState
from palpate_edge.node.parsed_eds import FINGERTIP_EDS
from palpate_edge.node.slave import Slave, SlaveOutput

DRIVE_EDS = Path(__file__).resolve().parents[3] / "host" / "palpate_bus" / "eds" / "cia402.eds"
DICTIONARIES = {"fingertip": load_eds(FINGERTIP_EDS, 0x10), "drive": load_eds(DRIVE_EDS, 0x10)}
FRAMES = 1_000_000
ROUNDS = 8

# First bytes of all that an SDO server says: the initiates, segments, ends and the abort of CiA 301.
SDO_ANSWERS = {0x80, 0x60, 0x20, 0x30, 0xA0, 0xA1, 0xA2, 0xA4, 0x40, 0x41, 0x42, 0x43, 0x47, 0x4B, 0x4F, 0xC6}
LSS_ANSWERS = {0x11, 0x13, 0x17, 0x44, 0x4F, 0x50, 0x5A, 0x5B, 0x5C, 0x5D, 0x5E}


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
    traffic = iter(Traffic(rng, lambda: slave.node_id, sorted(od.indices)))
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
    slave.process(now_us, (CanFrame(0x000, b"\x80\x00"),))
    for request in (b"\x04\x01", b"\x11\x10", b"\x04\x00"):
        slave.process(now_us, (CanFrame(0x7E5, request.ljust(8, b"\x00")),))
    slave.process(now_us, (CanFrame(0x000, b"\x82\x00"),))
    answer = slave.process(now_us, (CanFrame(0x610, b"\x40\x00\x10".ljust(8, b"\x00")),))
    assert (
        CanFrame(0x590, b"\x43\x00\x10\x00" + int(slave.read(0x1000)).to_bytes(4, "little"))
        in answer.frames_out
    )
