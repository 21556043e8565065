"""The health report of a running fingertip: a JSON file, renewed each second, for ``palpate-edge check``."""

from __future__ import annotations

import logging
import os
from pathlib import Path

import msgspec

from palpate_edge.common.atomic_write import write_atomically
from palpate_edge.common.config_file import decoder_of
from palpate_edge.common.errors import ConfigError

STALE_AFTER_S = 5.0
SYSTEM_FOLDER = Path("/run/palpate")  # RuntimeDirectory= of the service

_log = logging.getLogger("palpate.health")


class CameraHealth(msgspec.Struct, frozen=True, kw_only=True):
    """The camera. fps: frames of the last second; wanted_fps: configured rate, None for a recording;
    age_ms: time since the last frame, None before the first.

    dropped: frames since the start; dropped_share: share of the last minute's frames, 0 to 1; damaged: frames
    since the start that were incomplete or undecodable.
    """

    source: str
    fps: float
    wanted_fps: float | None
    age_ms: float | None
    dropped: int
    dropped_share: float
    damaged: int = 0


class BeadHealth(msgspec.Struct, frozen=True, kw_only=True):
    """The beads of the last frame. reason: why the frame was refused, empty if it was valid.

    Since the start: refused, frames without a valid contact; lost, beads over all frames; searches, of the
    whole image. drift_px: of the untouched skin since the reference frames or the last tare.
    """

    found: int
    expected: int
    refused: int
    reason: str
    lost: int = 0
    searches: int = 0
    drift_px: float = 0.0


class BusHealth(msgspec.Struct, frozen=True, kw_only=True):
    """The CAN bus. state: up, bus-off, down. dropped: PDOs dropped by a full transmit queue or a lost bus.

    receive_overruns: reports that the controller lost received frames. error_frames: of any kind.
    foreign_frames: 29-bit and CAN FD frames. own_echoes: frames of this fingertip that it received after the
    bus was reopened. others_dropped: responses and heartbeats dropped by a full transmit queue. id_conflicts:
    frames of another node with an identifier of this node. Counters are since the start, dropped_lately and
    overruns_lately of the last minute. stuck: frames wait and the bus accepts none. conflict: text about
    another node with this node's id, empty when there is none.
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
    receive_overruns: int = 0
    overruns_lately: int = 0
    error_frames: int = 0
    foreign_frames: int = 0
    own_echoes: int = 0
    others_dropped: int = 0
    id_conflicts: int = 0
    stuck: bool = False
    conflict: str = ""


class ClockHealth(msgspec.Struct, frozen=True, kw_only=True):
    """The bus clock. state: free, synchronised, lost. local_us and bus_us: the same moment on both clocks.

    steps: jumps of the bus's time; rejected: time stamps that were not used; both since the start.
    """

    state: str
    local_us: int
    bus_us: int
    drift_ppm: float
    error_us: int
    steps: int
    rejected: int


class LightHealth(msgspec.Struct, frozen=True, kw_only=True):
    """The illumination controller. problem: why it does not answer, or empty; faults: names, joined.

    losses: times that it stopped answering since the start; triggers and pec_errors: the controller's own
    counters, modulo 2^16.
    """

    level: int
    led_degC: float | None
    silicone_degC: float | None
    faults: str
    problem: str
    losses: int = 0
    triggers: int = 0
    pec_errors: int = 0


class PictureHealth(msgspec.Struct, frozen=True, kw_only=True):
    """Measures of a recent picture of a fingertip without calibration, as `PictureMeasure`."""

    brightness: float
    saturated_share: float
    sharpness: float
    blobs: int


class HealthReport(msgspec.Struct, frozen=True, kw_only=True):
    """All parts of one fingertip. written_at: CLOCK_MONOTONIC, s. latencies: bins of 2040h. recording: folder
    of the present recording, or empty. light: None without an illumination controller. recording_left_out:
    frames that were not recorded because the disk was too slow, since the start. picture: None with a
    calibration. configuration: digest of what was loaded (loaded_configuration.py), empty when not known."""

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
    recording_left_out: int = 0
    picture: PictureHealth | None = None
    configuration: str = ""


def health_path(name: str, configured: str) -> Path:
    """Return the health file's path: as configured, else in the service's or the user's runtime directory,
    else in the directory for temporary files."""
    if configured:
        return Path(configured)
    folder = os.environ.get("RUNTIME_DIRECTORY") or os.environ.get("XDG_RUNTIME_DIR")
    if not folder:
        import tempfile  # noqa: PLC0415 - 10 M instructions; a service has its runtime directory

        folder = tempfile.gettempdir()
    return Path(folder) / f"palpate-{name}.json"


class HealthFile:
    """The health file of a running daemon, removed by `close`. A failure to write it is logged once."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._failed = False

    def write(self, report: HealthReport) -> None:
        """Write the report; a full disk does not stop the fingertip."""
        try:
            write_health(self._path, report)
        except ConfigError as error:
            if not self._failed:
                _log.warning(str(error))
            self._failed = True
        else:
            self._failed = False

    def close(self) -> None:
        """Remove the file."""
        self._path.unlink(missing_ok=True)


def write_health(path: Path, report: HealthReport) -> None:
    """Write the file in one step, without a flush. Raises ConfigError when the file system refuses."""
    content = msgspec.json.encode(report)
    write_atomically(path, content, ConfigError, sync_folder=False, sync_file=False)


def read_health(name: str, configured: str, now_s: float) -> HealthReport | None:
    """Return the report of the running daemon of this name; None when none runs. now_s: CLOCK_MONOTONIC."""
    paths = [health_path(name, configured)]
    if not configured:
        paths.append(SYSTEM_FOLDER / f"palpate-{name}.json")
    for path in paths:
        try:
            report = decoder_of(HealthReport).decode(path.read_bytes())
        except (OSError, msgspec.DecodeError):  # none there, or of another version
            continue
        if 0 <= now_s - report.written_at <= STALE_AFTER_S:
            return report
    return None
