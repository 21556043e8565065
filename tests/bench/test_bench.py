"""The implementations compared by the benchmarks agree, and latency is split at the log's time stamps."""

from __future__ import annotations

from struct import pack

import numpy as np
import pytest
from bench.host import TABLE_4
from bench.latency import parts
from bench.tick import disagreement
from bench.vision import drawn, pins, pressed

from palpate_bus.logs.candump import LogRecord
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.vision.tracker import Tracker
from palpate_host.service.host import load_hand


def test_host_numpy_and_pinocchio_compute_the_same_tick() -> None:
    """The torques agree at 500 poses of Table 3's hand, where they are up to 0.2 N m."""
    assert disagreement() < 1e-12


def test_latency_is_split_at_the_time_stamps_of_the_log() -> None:
    """Exposed at 1 ms, published at 4 ms, on the bus at 5 ms, SYNC at 9 ms, last command at 9.5 ms."""
    config, _ = load_hand(TABLE_4)
    contact = CanFrame(0x380 + config.fingers[0].fingertip_node, pack("<IHH", 1_000, 7, 3_000))
    drive = CanFrame(0x200 + config.joints[0].drive_node, bytes(4))
    last = CanFrame(0x200 + config.joints[8].drive_node, bytes(4))
    later = [LogRecord(19_000, CanFrame(0x080)), LogRecord(19_200, drive)]
    records = [
        LogRecord(5_000, contact),
        LogRecord(9_000, CanFrame(0x080)),
        LogRecord(9_300, drive),
        LogRecord(9_500, last),
        *later,
    ]
    assert parts(records, config) == pytest.approx(np.array([[3.0, 1.0, 4.0, 0.5]]) * 1e-3)


def test_the_pins_whose_tracking_is_timed_are_numbered_right() -> None:
    """Nobody wants the time of a wrong answer."""
    tracker, random = Tracker(pins()), np.random.default_rng(1)
    for _ in range(3):
        place_px = pressed(random)
        tracker.reset()
        beads = tracker.follow(drawn(place_px))
        assert beads.found.mean() > 0.97
        assert np.linalg.norm(beads.position_px - place_px, axis=1)[beads.found].max() < 0.5
