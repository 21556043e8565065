"""Lengths of CAN FD frames against the standard's fields as text, and against a published bound."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.bus.load.bits_on_paper import fd_bits

from palpate_bus.load.fd_bit_count import fd_frame_bits, least_fd_bits, worst_fd_bits
from palpate_edge.can_bus.can_frame import FD_LENGTHS, padded

PAYLOADS = st.sampled_from(FD_LENGTHS).flatmap(
    lambda n: st.one_of(
        st.binary(min_size=n, max_size=n), st.sampled_from([bytes(n), b"\xff" * n, b"\x78" * n])
    )
)


@given(st.integers(0, 0x7FF), PAYLOADS)
def test_length_is_that_of_the_standard(can_id, data):
    bits = fd_frame_bits(can_id, data)
    assert (bits.nominal, bits.data) == fd_bits(can_id, data)


@given(st.integers(0, 0x7FF), PAYLOADS)
def test_length_is_within_its_bounds(can_id, data):
    bits, least, worst = fd_frame_bits(can_id, data), least_fd_bits(len(data)), worst_fd_bits(len(data))
    assert least.nominal <= bits.nominal <= worst.nominal
    assert least.data <= bits.data <= worst.data


@pytest.mark.parametrize("length", FD_LENGTHS)
def test_the_worst_case_is_the_published_one(length):
    """Bordoloi, Samii (RTSS 2014): 32 nominal and 28 + 5 ceil((p - 16) / 64) + 10 p data bits, before ISO
    11898-1:2015 added a stuff count of 4 bits with its fixed stuff bit."""
    worst = worst_fd_bits(length)
    published = 28 + 5 * math.ceil((length - 16) / 64) + 10 * length
    assert (worst.nominal, worst.data) == (32, published + 5)


def test_64_bytes_without_stuff_bits_at_1_and_5_Mbit_per_s():
    bits = fd_frame_bits(0x555, b"\x55" * 64)
    assert (bits.nominal, bits.data) == (29, 550)
    assert bits.nominal_bits(1_000_000, 5_000_000) == 29 + 110


def test_a_length_between_two_codes_is_padded():
    assert padded(bytes(33)) == bytes(48)
    with pytest.raises(ValueError):
        fd_frame_bits(0x181, bytes(33))
