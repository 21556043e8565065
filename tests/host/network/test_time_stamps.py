"""1013h of the host: what it carries, when, and with which SYNC it belongs together."""

from __future__ import annotations

import pytest

from palpate_edge.can_bus.clock_sync import BusClock, ClockState
from palpate_host.network.nmt_master import SYNC, TIME_STAMP_ID, TimeStampProducer


def value(frame):
    return int.from_bytes(frame.data, "little")


def test_it_carries_when_the_sync_left_modulo_32_bits():
    producer = TimeStampProducer()
    producer.sync_left((7 << 32) + 123_456)
    (frame,) = producer.due((7 << 32) + 130_000)
    assert (frame.can_id, value(frame), len(frame.data)) == (0x1FF, 123_456, 4)
    assert producer.due((7 << 32) + 140_000) == []  # one stamp for each SYNC


def test_it_is_sent_twenty_times_a_second():
    producer = TimeStampProducer()
    sent = 0
    for tick_us in range(0, 1_000_000, 1_000):
        sent += len(producer.due(tick_us))
        producer.sync_left(tick_us + 80)
    assert sent == 20


def test_a_sync_that_has_not_left_before_the_tick_waits():
    producer = TimeStampProducer()
    producer.sync_left(10_000)
    assert producer.due(10_000) == []
    assert [value(frame) for frame in producer.due(20_000)] == [10_000]


@pytest.fixture(scope="module")
def log(bench):
    rig = bench.VirtualBench(*bench.load_table_4())
    rig.run(3.0)
    return rig.log


@pytest.mark.long
def test_on_the_bus_each_stamp_is_that_of_the_sync_before_it(log):
    stamps = 0
    sync_us = None
    for at_us, frame in log:
        if frame == SYNC:
            sync_us = at_us
        elif frame.can_id == TIME_STAMP_ID:
            assert value(frame) == sync_us & 0xFFFF_FFFF
            stamps += 1
    assert stamps == pytest.approx(60, abs=2)


def test_a_board_that_hears_it_keeps_the_hosts_time(log):
    """Its own clock is 5 s behind and runs 40 ppm fast; the bus delays nothing here."""
    clock = BusClock()

    def local_us(bus_us):
        return round(bus_us - 5_000_000 + 40e-6 * (bus_us - log[0][0]))

    for at_us, frame in log:
        if frame == SYNC:
            clock.sync(local_us(at_us))
        elif frame.can_id == TIME_STAMP_ID:
            clock.time_stamp(value(frame))
    end_us = log[-1][0]
    assert clock.state(local_us(end_us)) is ClockState.SYNCHRONISED
    assert clock.to_bus_us(local_us(end_us)) == pytest.approx(end_us, abs=3)
