"""Whatever comes over the bus, in whatever order: the slave does not raise and says nothing malformed."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.node.eds import load_eds
from palpate_edge.node.nmt import NmtState
from palpate_edge.node.parsed_eds import FINGERTIP_EDS
from palpate_edge.node.slave import Slave

DRIVE_EDS = Path(__file__).resolve().parents[3] / "host" / "palpate_bus" / "eds" / "cia402.eds"
DICTIONARIES = [load_eds(path, 0x10) for path in (FINGERTIP_EDS, DRIVE_EDS)]
INDICES = sorted({index for od in DICTIONARIES for index in od.indices})

anything = st.builds(CanFrame, st.integers(0, 0x7FF), st.binary(max_size=8), st.booleans())
nmt = st.builds(
    lambda cs, node: CanFrame(0, bytes([cs, node])),
    st.sampled_from([1, 2, 128, 129, 130]),
    st.sampled_from([0, 16]),
)
sdo = st.builds(
    lambda command, index, sub, data: CanFrame(
        0x610, bytes([command]) + index.to_bytes(2, "little") + bytes([sub]) + data
    ),
    st.integers(0, 255),
    st.sampled_from(INDICES),
    st.integers(0, 9),
    st.binary(min_size=4, max_size=4) | st.sampled_from([bytes(4), b"\x20\x00\x12\x20", b"\x90\x01\x00\xc0"]),
)
SEGMENTS = [0x00, 0x01, 0x10, 0x11, 0x60, 0x70]
BLOCKS = [0x02, 0x81, 0x82, 0xA1, 0xA2, 0xA3, 0xA4, 0xC1, 0xC5, 0xC6]
segment = st.builds(
    lambda command, data: CanFrame(0x610, bytes([command]) + data),
    st.sampled_from(SEGMENTS + BLOCKS),
    st.binary(min_size=7, max_size=7) | st.just(b"\x01\x7f" + bytes(5)),
)
lss = st.builds(
    lambda command, data: CanFrame(0x7E5, bytes([command]) + data),
    st.sampled_from([0x04, 0x11, 0x13, 0x15, 0x17, *range(0x40, 0x4D), 0x51, *range(0x5A, 0x5F)]),
    st.binary(min_size=7, max_size=7) | st.sampled_from([bytes(7), b"\x01" + bytes(6), b"\xff" + bytes(6)]),
)
rpdo = st.builds(CanFrame, st.sampled_from([0x210, 0x1FF, 0x100, 0x77F]), st.binary(max_size=8))
sync = st.builds(CanFrame, st.just(0x80), st.binary(max_size=1))
frames = nmt | sdo | segment | lss | rpdo | sync | anything


@pytest.mark.long
@settings(max_examples=300, deadline=None)
@given(
    st.sampled_from(DICTIONARIES),
    st.lists(st.tuples(st.integers(0, 2_000_000), st.lists(frames, max_size=4)), max_size=25),
)
def test_no_traffic_makes_the_slave_raise(od, traffic) -> None:
    slave = Slave(od)
    now_us = 0
    for pause_us, frames_in in traffic:
        now_us += pause_us
        slave.trigger((1, 2))
        output = slave.process(now_us, frames_in)
        assert now_us <= output.next_due_us <= now_us + 1_000_000
        assert (slave.state is NmtState.INITIALISING) is (slave.node_id == 255)
        for frame in output.frames_out:
            assert 0 <= frame.can_id <= 0x7FF
            assert len(frame.data) <= 8
            assert not frame.remote


@settings(max_examples=100, deadline=None)
@given(st.lists(frames, max_size=20))
def test_the_same_frames_give_the_same_answers(frames_in) -> None:
    def run() -> list[tuple[CanFrame, ...]]:
        slave = Slave(DICTIONARIES[1])
        return [slave.process(at, (frame,)).frames_out for at, frame in enumerate(frames_in)]

    assert run() == run()
