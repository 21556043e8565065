"""Events of a fingertip's page: what the script in page/watch.js draws."""

from __future__ import annotations

from pathlib import Path

import msgspec

from palpate_edge.common.contact import Contact
from palpate_edge.daemon.check_rows import (
    CheckRow,
    Verdict,
    counter_rows,
    judge_beads,
    judge_bus,
    judge_camera,
    judge_clock,
    judge_light,
    judge_picture,
)
from palpate_edge.daemon.health import BeadHealth, CameraHealth, HealthReport, LightHealth, PictureHealth
from palpate_edge.daemon.watching.watch_messages import BeadsShown
from palpate_edge.estimation.uncalibrated import NO_CALIBRATION


class ConsoleState(msgspec.Struct, frozen=True):
    """The connection to the fingertip. text: how it is seen, or why not and what to do."""

    connected: bool
    text: str


class ConsoleFrame(msgspec.Struct, frozen=True):
    """A picture with what was estimated from it. size_px: width and height that `beads` refer to; jpeg: the
    picture, of the same or a smaller size."""

    contact: Contact
    latency_ms: float
    beads: BeadsShown | None
    size_px: tuple[int, int]
    jpeg: bytes


class ConsoleHealth(msgspec.Struct, frozen=True, kw_only=True):
    """Figures of a fingertip, each second. nmt_state: empty without a daemon; recording: its folder, or
    empty; rows: as of ``palpate-edge check``."""

    fps: float
    dropped: int
    nmt_state: str
    recording: str
    light: LightHealth | None
    rows: list[CheckRow]


def health_of_daemon(report: HealthReport, timeout_ms: int) -> ConsoleHealth:
    """Return the health of a running daemon. timeout_ms: capture.timeout_ms of its configuration."""
    rows = [
        *sensor_rows(report.camera, report.beads, report.picture, timeout_ms),
        calibration_row(report.calibration, report.method),
        judge_bus(report.bus),
        judge_clock(report.clock),
        *light_rows(report.light),
        *counter_rows(report),
    ]
    return ConsoleHealth(
        fps=report.camera.fps,
        dropped=report.camera.dropped,
        nmt_state=report.nmt_state,
        recording=report.recording,
        light=report.light,
        rows=rows,
    )


def sensor_rows(
    camera: CameraHealth, beads: BeadHealth, picture: PictureHealth | None, timeout_ms: int
) -> list[CheckRow]:
    """Return the rows of camera and beads. picture: None with a calibration."""
    return [
        judge_camera(camera, timeout_ms),
        judge_beads(beads) if picture is None else judge_picture(picture),
    ]


def calibration_row(path: str, method: str) -> CheckRow:
    """Return the row of a calibration that is in use, or of none."""
    if method == "none":
        return CheckRow("calibration", "none", "", Verdict.WARN, NO_CALIBRATION)
    return CheckRow("calibration", f"{Path(path).name}, {method}", "intact", Verdict.OK, "")


def light_rows(light: LightHealth | None) -> list[CheckRow]:
    """Return the row of the illumination controller."""
    if light is None:
        return [CheckRow("temperature", "no illumination controller", "", Verdict.ABSENT, "")]
    return [judge_light(light)]
