"""The state of a fingertip, part by part, with limits and the way out of what is not right.

Beside a running daemon its own words are judged (health.py); without one the parts are tried for a second.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from palpate_edge.calibration.calibration_file import load_calibration
from palpate_edge.can_bus.bus import open_bus
from palpate_edge.can_bus.clock_sync import BusClock, ClockState
from palpate_edge.can_bus.simulated_clock import clock_of
from palpate_edge.common.errors import IlluminationError, PalpateError
from palpate_edge.daemon.capture_factory import open_source
from palpate_edge.daemon.config import FingertipConfig
from palpate_edge.daemon.health import (
    BeadHealth,
    BusHealth,
    CameraHealth,
    ClockHealth,
    HealthReport,
    LightHealth,
)
from palpate_edge.daemon.health_report import clock_health, light_health
from palpate_edge.daemon.sliding_window import DroppedFrames
from palpate_edge.estimation.calibration import Calibration
from palpate_edge.estimation.estimator import MIN_BEADS_SHARE, Estimator, best_method
from palpate_edge.illumination.client import IlluminationClient
from palpate_edge.illumination.controller_thread import LightState

TRY_S = 1.5
FEW_BEADS_SHARE = 0.9
LEAST_RATE_SHARE = 0.95
MOST_DROPPED_SHARE = 0.01
CLOCK_LIMIT_US = 200
SYNC_ID, TIME_STAMP_ID = 0x080, 0x1FF


class Verdict(Enum):
    """ABSENT: not there, and nothing is missing."""

    OK = "ok"
    WARN = "warn"
    FAIL = "fail"
    ABSENT = "absent"


@dataclass(frozen=True, slots=True)
class CheckRow:
    """One part. way_out: empty when it is in order."""

    part: str
    value: str
    limit: str
    verdict: Verdict
    way_out: str


def check(config: FingertipConfig, report: HealthReport | None) -> list[CheckRow]:
    """All parts; report: what the running daemon says, None when none runs."""
    calibration, calibration_rows = _check_calibration(config)
    if report is None:
        rows = [*_try_frames(config, calibration), *calibration_rows, *_try_bus(config)]
    else:
        rows = [
            judge_camera(report.camera, config.capture.timeout_ms),
            judge_beads(report.beads),
            *calibration_rows,
            judge_bus(report.bus),
            judge_clock(report.clock),
        ]
    return [*rows, _check_light(config, report)]


def judge_light(light: LightHealth) -> CheckRow:
    """The LED ring's controller and its temperatures."""
    if light.problem or light.led_degC is None:
        return CheckRow("temperature", "no answer", "", Verdict.FAIL, light.problem)
    silicone = "unknown" if light.silicone_degC is None else f"{light.silicone_degC:.1f} degC"
    value = f"silicone {silicone}, LED {light.led_degC:.1f} degC, level {light.level}"
    if light.faults:
        way_out = f"{light.faults}: see the faults in docs/illumination.md"
        return CheckRow("temperature", value, "no fault", Verdict.WARN, way_out)
    return CheckRow("temperature", value, "no fault", Verdict.OK, "")


def _check_light(config: FingertipConfig, report: HealthReport | None) -> CheckRow:
    """By the daemon's word, or else asked for; the controller answers two masters in turn."""
    bus = config.illumination.i2c_bus
    if bus is None:
        return CheckRow("temperature", "no illumination controller", "", Verdict.ABSENT, "")
    if report is not None and report.light is not None:
        return judge_light(report.light)
    try:
        with closing(IlluminationClient.open(bus, config.illumination.address)) as controller:
            return judge_light(light_health(LightState(controller.state(), "")))
    except IlluminationError as error:
        return CheckRow("temperature", "no answer", "", Verdict.FAIL, str(error))


def exit_status(rows: list[CheckRow]) -> int:
    """0, or 1 when a part fails."""
    return int(any(row.verdict is Verdict.FAIL for row in rows))


def as_table(rows: list[CheckRow]) -> str:
    """Columns of text, a line for each part and one for each way out."""
    lines = []
    for row in rows:
        lines.append(f"{row.verdict.value:<7}{row.part:<13}{row.value:<46}  {row.limit}".rstrip())
        if row.way_out:
            lines.append(f"{'':<7}-> {row.way_out}")
    return "\n".join(lines)


def judge_camera(camera: CameraHealth, timeout_ms: int) -> CheckRow:
    """Frames of the last second against the rate that was asked for, and what the last minute dropped."""
    limit = f"a frame each {timeout_ms} ms, <= {100 * MOST_DROPPED_SHARE:.0f} % dropped"
    if camera.wanted_fps is not None:
        limit = f">= {LEAST_RATE_SHARE * camera.wanted_fps:.1f} frames/s, {limit}"
    lately_percent = 100 * camera.dropped_share
    value = f"{camera.fps:.1f} frames/s, {camera.dropped} dropped, {lately_percent:.1f} % lately"
    if camera.age_ms is None or camera.age_ms > timeout_ms:
        way_out = f"{camera.source} gives no frames: check its cable, then the daemon's last lines"
        return CheckRow("camera", value, limit, Verdict.FAIL, way_out)
    if camera.wanted_fps is not None and camera.fps < LEAST_RATE_SHARE * camera.wanted_fps - 1:
        way_out = "shorten capture.camera.exposure_us, or choose another capture.camera.format"
        return CheckRow("camera", value, limit, Verdict.WARN, way_out)
    if camera.dropped_share > MOST_DROPPED_SHARE:
        way_out = "the board is too slow for this rate, or USB too narrow: lower capture.camera.fps"
        return CheckRow("camera", value, limit, Verdict.WARN, way_out)
    return CheckRow("camera", value, limit, Verdict.OK, "")


def judge_beads(beads: BeadHealth) -> CheckRow:
    """Beads of the last frame, and whether it was believed."""
    value = f"{beads.found} of {beads.expected}, {beads.refused} frames refused"
    limit = f">= {100 * MIN_BEADS_SHARE:.0f} %"
    if beads.reason:
        way_out = f"{beads.reason}; look at palpate-edge inspect FRAME --calibration FILE"
        return CheckRow("beads", value, limit, Verdict.FAIL, way_out)
    if beads.found < FEW_BEADS_SHARE * beads.expected:
        return CheckRow("beads", value, limit, Verdict.WARN, "clean the dome; check exposure and LED")
    return CheckRow("beads", value, limit, Verdict.OK, "")


def judge_bus(bus: BusHealth) -> CheckRow:
    """Whether it carries frames."""
    value = f"{bus.interface} {bus.state}, {bus.sent} sent, {bus.received} received"
    limit = "up, nothing dropped lately"
    if bus.state != "up":
        return CheckRow("bus", value, limit, Verdict.FAIL, "check wiring, termination, bit rate; ip -s link")
    if bus.error_passive or bus.dropped_lately:
        dropped = f"{bus.dropped_lately} PDOs dropped in the last minute"
        trouble = "error passive" if bus.error_passive else dropped
        way_out = f"{trouble}: check wiring and termination, and the load (palpate-host bus budget)"
        return CheckRow("bus", value, limit, Verdict.WARN, way_out)
    return CheckRow("bus", value, limit, Verdict.OK, "")


def judge_clock(clock: ClockHealth) -> CheckRow:
    """Whether exposures are told on the bus's clock."""
    limit = f"synchronised, error <= {CLOCK_LIMIT_US} us"
    value = f"{clock.state}, error {clock.error_us} us, drift {clock.drift_ppm:+.1f} ppm"
    if clock.state == ClockState.FREE.value:
        way_out = "no SYNC with 1013h is heard: start palpate-host run, and the node"
        return CheckRow("clock", "own clock", limit, Verdict.WARN, way_out)
    if clock.state == ClockState.LOST.value:
        return CheckRow("clock", value, limit, Verdict.FAIL, "SYNC with 1013h has ended: does the host run?")
    if clock.error_us > CLOCK_LIMIT_US:
        return CheckRow("clock", value, limit, Verdict.WARN, "wait half a minute; is the bus overloaded?")
    return CheckRow("clock", value, limit, Verdict.OK, "")


def _check_calibration(config: FingertipConfig) -> tuple[Calibration | None, list[CheckRow]]:
    path = Path(config.estimator.calibration)
    try:
        calibration = load_calibration(path)
        method = Estimator(calibration).method.value
    except PalpateError as error:
        return None, [CheckRow("calibration", path.name, "whole, of this sensor", Verdict.FAIL, str(error))]
    rows = [CheckRow("calibration", f"{path.name} {calibration.checksum[:16]}", "whole", Verdict.OK, "")]
    if calibration.model:
        rows.append(CheckRow("model", f"{len(calibration.model) / 1e6:.1f} MB, {method}", "", Verdict.OK, ""))
    else:
        way_out = "run palpate-edge calibrate without --no-model"
        rows.append(CheckRow("model", f"none, {best_method(calibration).value}", "", Verdict.WARN, way_out))
    return calibration, rows


def _try_frames(config: FingertipConfig, calibration: Calibration | None) -> list[CheckRow]:
    """Read and estimate frames for a second."""
    if calibration is None:
        return [CheckRow("camera", "not tried", "", Verdict.WARN, "needs a calibration, see below")]
    notes: list[str] = []
    try:
        clock = clock_of(config.bus)
        source = open_source(config, calibration, clock, notes.append)
        try:
            estimator = Estimator(calibration)
            begin_s = time.monotonic()
            contacts = []
            dropped_frames, dropped_share = DroppedFrames(), 0.0
            while time.monotonic() < begin_s + TRY_S and (frame := source.read()) is not None:
                contacts.append(estimator.estimate(frame))
                dropped_share = dropped_frames.share(clock.now_us(), len(contacts), source.dropped)
            fps = len(contacts) / (time.monotonic() - begin_s)
        finally:
            source.close()
    except PalpateError as error:
        return [CheckRow("camera", "not usable", "", Verdict.FAIL, str(error))]
    wanted = config.capture.camera.fps or calibration.sensor.camera.fps
    camera = CameraHealth(
        source=config.capture.path or config.capture.camera.usb_serial,
        fps=fps,
        wanted_fps=wanted if config.capture.source == "v4l2" else None,
        age_ms=0.0 if contacts else None,
        dropped=source.dropped,
        dropped_share=dropped_share,
    )
    rows = [judge_camera(camera, config.capture.timeout_ms)]
    rows += [CheckRow("camera", "", "", Verdict.WARN, note) for note in notes]
    if contacts:
        last = contacts[-1]
        refused = sum(not contact.valid for contact in contacts)
        rows.append(
            judge_beads(
                BeadHealth(
                    found=last.beads_found, expected=last.beads_expected, refused=refused, reason=last.reason
                )
            )
        )
    return rows


def _try_bus(config: FingertipConfig) -> list[CheckRow]:
    """Listen for a second; nothing is sent."""
    clock, received = BusClock(), 0
    try:
        local = clock_of(config.bus)
        with open_bus(config.bus, f"{config.name}-check") as bus:
            end_s = time.monotonic() + TRY_S
            while (left_s := end_s - time.monotonic()) > 0:
                for stamp_us, frame in bus.receive(left_s):
                    received += 1
                    _tell(clock, local.at_unix_us, stamp_us, frame.can_id, frame.data)
            passive = bus.error_passive
    except PalpateError as error:
        return [CheckRow("bus", config.bus.interface, "up", Verdict.FAIL, str(error))]
    now_us = local.now_us()
    bus_row = judge_bus(
        BusHealth(
            interface=config.bus.interface,
            state="up",
            sent=0,
            received=received,
            retries=0,
            dropped=0,
            dropped_lately=0,
            restarts=0,
            error_passive=passive,
        )
    )
    return [bus_row, judge_clock(clock_health(clock, now_us))]


def _tell(
    clock: BusClock, to_local_us: Callable[[int], int], stamp_us: int, can_id: int, data: bytes
) -> None:
    if can_id == SYNC_ID:
        clock.sync(to_local_us(stamp_us))
    elif can_id == TIME_STAMP_ID and len(data) == 4:
        clock.time_stamp(int.from_bytes(data, "little"))
