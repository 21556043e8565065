"""What a running fingertip says of itself: a small file, renewed each second, for ``palpate-edge check``."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from pathlib import Path

import msgspec

from palpate_edge.common.atomic_write import whole_file
from palpate_edge.common.errors import ConfigError

STALE_AFTER_S = 5.0
SYSTEM_FOLDER = Path("/run/palpate")  # RuntimeDirectory= of the service


class CameraHealth(msgspec.Struct, frozen=True, kw_only=True):
    """fps: of the last second; wanted_fps: asked for, None for a recording; age_ms: of the last frame.

    dropped: frames since the start; dropped_share: of the last minute's, 0 to 1.
    """

    source: str
    fps: float
    wanted_fps: float | None
    age_ms: float | None
    dropped: int
    dropped_share: float


class BeadHealth(msgspec.Struct, frozen=True, kw_only=True):
    """Of the last frame; refused: frames since the start; reason: of the last frame, when it was refused."""

    found: int
    expected: int
    refused: int
    reason: str


class BusHealth(msgspec.Struct, frozen=True, kw_only=True):
    """state: up, bus-off, down. dropped: PDOs that a full transmit queue cost since the start;
    dropped_lately: those of the last minute.
    """

    interface: str
    state: str
    sent: int
    received: int
    retries: int
    dropped: int
    dropped_lately: int
    restarts: int
    error_passive: bool


class ClockHealth(msgspec.Struct, frozen=True, kw_only=True):
    """state: free, synchronised, lost. local_us and bus_us are the same moment on both clocks."""

    state: str
    local_us: int
    bus_us: int
    drift_ppm: float
    error_us: int
    steps: int
    rejected: int


class LightHealth(msgspec.Struct, frozen=True, kw_only=True):
    """problem: why the controller does not answer, or empty; faults: names, joined."""

    level: int
    led_degC: float | None
    silicone_degC: float | None
    faults: str
    problem: str


class HealthReport(msgspec.Struct, frozen=True, kw_only=True):
    """written_at: CLOCK_MONOTONIC, s. latencies: as 2040h. recording: the folder, or empty."""

    name: str
    pid: int
    written_at: float
    node_id: int
    nmt_state: str
    frames: int
    method: str
    calibration: str
    emergencies: list[str]
    latencies: list[int]
    recording: str
    camera: CameraHealth
    beads: BeadHealth
    bus: BusHealth
    clock: ClockHealth
    light: LightHealth | None = None


def health_path(name: str, configured: str) -> Path:
    """Where a fingertip of this name writes: as configured, else under the service's or the user's runtime
    directory, else under the one for temporary files."""
    if configured:
        return Path(configured)
    folder = os.environ.get("RUNTIME_DIRECTORY") or os.environ.get("XDG_RUNTIME_DIR")
    return Path(folder or tempfile.gettempdir()) / f"palpate-{name}.json"


class HealthFile:
    """The file of a daemon that runs, removed by `close`. tell: gets each failure to write it once."""

    def __init__(self, path: Path, tell: Callable[[str], None]) -> None:
        self._path = path
        self._tell = tell
        self._failed = False

    def write(self, report: HealthReport) -> None:
        """A full disk is no reason to stop."""
        try:
            write_health(self._path, report)
        except ConfigError as error:
            if not self._failed:
                self._tell(str(error))
            self._failed = True
        else:
            self._failed = False

    def close(self) -> None:
        self._path.unlink(missing_ok=True)


def write_health(path: Path, report: HealthReport) -> None:
    """Raises ConfigError when the file system refuses."""
    with whole_file(path, ConfigError) as temporary:
        temporary.write_bytes(msgspec.json.encode(report))


def read_health(name: str, configured: str, now_s: float) -> HealthReport | None:
    """What a daemon of this name says now; None when none runs. now_s: CLOCK_MONOTONIC."""
    paths = [health_path(name, configured)]
    if not configured:
        paths.append(SYSTEM_FOLDER / f"palpate-{name}.json")
    for path in paths:
        try:
            report = msgspec.json.decode(path.read_bytes(), type=HealthReport)
        except (OSError, msgspec.DecodeError):  # none there, or of another version
            continue
        if 0 <= now_s - report.written_at <= STALE_AFTER_S:
            return report
    return None
