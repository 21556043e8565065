"""The figures of the bus on the hand's page, from a second of a whole hand's traffic."""

from __future__ import annotations

import pytest

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.node.fingertip_objects import Health
from palpate_host.console.bus_figures import BusFigures, FingertipLight


@pytest.fixture(scope="module")
def traffic(bench, table_4):
    """Configuration and (time, frame) of a hand's second second; the third fingertip has no thermistor."""
    virtual = bench.VirtualBench(*table_4)
    for tip, degC in zip(virtual.tips, (31.5, -4.0, None), strict=True):
        tip.report_health(Health(temperature_degC=degC, frames_dropped=0, led_level=200))
    virtual.run(1.0)
    before = len(virtual.log)
    virtual.run(1.0)
    return table_4[0], virtual.log[before:]


def figures_of(config, log):
    begun_us = log[0][0]
    figures = BusFigures(config, begun_us)
    for stamp_us, frame in log:
        figures.take(stamp_us, frame)
    return figures, begun_us


def test_the_load_is_between_the_shortest_and_the_longest_frames_of_iso_11898(traffic):
    config, log = traffic
    figures, begun_us = figures_of(config, log)
    assert figures.news(begun_us + 900_000).load is None
    end_us = log[-1][0]
    news = figures_of(config, log)[0].news(max(end_us, begun_us + 1_000_000))
    lengths = [47 + 8 * len(frame.data) for _, frame in log]
    most = sum(bits + (bits - 14) // 4 for bits in lengths) / config.bus.bitrate
    assert 0.9 * sum(lengths) / config.bus.bitrate < news.load < most  # a bin of 0.1 s may have left
    assert news.frames_s == len(log)


def test_temperatures_and_led_levels_are_those_that_the_nodes_publish(traffic):
    config, log = traffic
    figures, _ = figures_of(config, log)
    end_us = log[-1][0]
    expected = [FingertipLight(31.5, 200), FingertipLight(-4.0, 200), FingertipLight(None, 200)]
    assert figures.news(end_us).fingertips == expected
    odd = CanFrame(0x480 + config.fingers[0].fingertip_node, b"\x01")
    figures.take(end_us, odd)
    assert figures.news(end_us).fingertips == expected
    assert figures.news(end_us + 10_000_000).fingertips == [None] * 3
