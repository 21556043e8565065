"""Record a running hand: every frame of its bus and the host's status of every tick."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from palpate_bus.logs.candump import LogRecord
from palpate_edge.can_bus.bus import open_bus
from palpate_host.config.hand_config import HandConfig
from palpate_host.control.kinematics import HandKinematics
from palpate_host.recording.bounds import Bounds
from palpate_host.recording.segments import SegmentedRecording
from palpate_host.recording.status_follower import StatusFollower
from palpate_host.service.host import bus_time

WAIT_S = 0.02


def record_hand(
    folder: Path,
    config: HandConfig,
    hand: HandKinematics,
    bounds: Bounds,
    socket_path: Path,
    has_ended: Callable[[], bool],
    begun: Callable[[], None],
) -> SegmentedRecording:
    """Record to `folder` until `has_ended`; return the closed recording with its counts.

    Sends nothing on the bus. begun: called once the bus and the files are open. Raises ConfigError, BusError,
    LogError.
    """
    now_us = bus_time(config.bus)
    with (
        open_bus(config.bus, "record") as bus,
        SegmentedRecording(folder, config, hand, bounds) as recording,
        StatusFollower(socket_path) as follower,
    ):
        begun()
        while not has_ended():
            records = [LogRecord(stamp_us, frame) for stamp_us, frame in bus.receive(WAIT_S)]
            recording.write(now_us(), records, follower.take())
    return recording
