"""Bus load from a log."""

from __future__ import annotations

import pytest

from palpate_bus.logs.candump import LogRecord
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_twin.demo.traffic import id_name, traffic

START_US = 1_700_000_000_000_000
# 0x555 without data is 47 bits (start 1, identifier 11, RTR, IDE, r0, length 4, CRC 15, tail and interframe
# space 13) and 1 to 8 stuff bits: one after the five zeros RTR, IDE, r0 and length, (33 - 1) / 4 at most.
FEWEST_BITS, MOST_BITS = 48, 47 + 8


def test_load_of_an_even_stream(hand_config):
    records = [LogRecord(START_US + 1000 * n, CanFrame(0x555)) for n in range(1001)]
    result = traffic(records, 100_000, hand_config)
    assert (result.frames, result.duration_s, len(result.bin_percent)) == (1001, 1.0, 10)
    assert 1001 * FEWEST_BITS <= result.bits <= 1001 * MOST_BITS
    bits_a_frame = result.bits / 1001
    # 100 frames in 0.1 s of 10,000 bits
    assert result.bin_percent == pytest.approx([bits_a_frame] * 10)
    assert result.peak_percent == pytest.approx(bits_a_frame)
    assert result.mean_percent == pytest.approx(bits_a_frame * 1.001)


def test_identifiers_add_up_to_the_bus(hand_config):
    frames = [CanFrame(0x080), CanFrame(0x190, bytes(8)), CanFrame(0x201, bytes(5)), CanFrame(0x080)]
    records = [LogRecord(START_US + 250_000 * n, frame) for n, frame in enumerate(frames)]
    result = traffic(records, 1_000_000, hand_config)
    assert [(load.can_id, load.frames) for load in result.ids] == [(0x080, 2), (0x190, 1), (0x201, 1)]
    assert sum(load.load_percent for load in result.ids) == pytest.approx(result.mean_percent)


@pytest.mark.parametrize(
    ("can_id", "function"),
    [
        (0x000, "NMT"),
        (0x080, "SYNC"),
        (0x090, "EMCY"),
        (0x190, "TPDO 1"),
        (0x201, "RPDO 1"),
        (0x291, "TPDO 2"),
        (0x392, "TPDO 3"),
        (0x490, "TPDO 4"),
        (0x310, "TPDO 5"),  # a fingertip has no RPDO 2
        (0x301, "RPDO 2"),
        (0x581, "SDO response"),
        (0x601, "SDO request"),
        (0x77F, "heartbeat"),
    ],
)
def test_names_are_those_of_the_predefined_connection_set(hand_config, can_id, function):
    """CiA 301, table of the predefined connection set."""
    assert id_name(can_id, hand_config).startswith(function)


def test_names_contain_the_node(hand_config):
    assert "finger-2" in id_name(0x191, hand_config)
    assert "curl_1" in id_name(0x203, hand_config)
    assert id_name(0x77F, hand_config).endswith("host")
    assert id_name(0x1A5, hand_config).endswith("node 0x25")
