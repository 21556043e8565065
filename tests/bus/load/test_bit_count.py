"""Frame lengths against a statement of the standard that shares no code: text and long division."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.bus.load.bits_on_paper import classic_bits, remainder

from palpate_bus.load.bit_count import frame_bits
from palpate_edge.can_bus.can_frame import CanFrame

FRAMES = st.builds(
    CanFrame,
    can_id=st.integers(0, 0x7FF),
    data=st.one_of(st.binary(max_size=8), st.sampled_from([b"\0" * 8, b"\xff" * 8, b"\xf0\xf0\xf0\xf0"])),
    remote=st.booleans(),
)


def test_long_division_gives_the_catalogued_check_value_of_crc15_can():
    text = "".join(f"{byte:08b}" for byte in b"123456789")
    assert int(remainder(text), 2) == 0x059E


@given(FRAMES)
def test_length_is_that_of_the_standard(frame):
    assert frame_bits(frame) == classic_bits(frame)


@given(FRAMES)
def test_length_is_within_the_published_bounds(frame):
    """47 + 8 n without stuff bits; at most 55 + 10 n (Davis et al., Real-Time Systems 35, 2007)."""
    n = 0 if frame.remote else len(frame.data)
    assert 47 + 8 * n <= frame_bits(frame) <= 55 + 10 * n


def test_34_dominant_bits_take_6_stuff_bits():
    """Identifier 0, no data: the CRC of zeros is zero, so 34 equal bits: a stuff bit after the 5th; the stuff
    bit breaks the run, so one more after each further 5: 34 // 5 = 6."""
    assert frame_bits(CanFrame(0)) == 34 + 6 + 13


@pytest.mark.parametrize("length", range(9))
def test_a_remote_frame_carries_its_dlc_and_no_data(length):
    frame = CanFrame(0x2A5, bytes(length), remote=True)
    assert 47 <= frame_bits(frame) <= 55
