"""Verdicts on the parts of a fingertip: value, limit and remedy of each, as rows of ``palpate-edge
check``."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from palpate_edge.can_bus.clock_sync import ClockState
from palpate_edge.common.contact import MIN_BEADS_SHARE
from palpate_edge.daemon.health import (
    BeadHealth,
    BusHealth,
    CameraHealth,
    ClockHealth,
    HealthReport,
    LightHealth,
    PictureHealth,
)

FEW_BEADS_SHARE = 0.9
LEAST_RATE_SHARE = 0.95
MOST_DROPPED_SHARE = 0.01
CLOCK_LIMIT_US = 200
DARK, MOST_SATURATED_SHARE = 40.0, 0.05


class Verdict(Enum):
    """The verdict on a part. ABSENT: the part is not configured, and not needed."""

    OK = "ok"
    WARN = "warn"
    FAIL = "fail"
    ABSENT = "absent"


@dataclass(frozen=True, slots=True)
class CheckRow:
    """One part. way_out: the remedy, empty when the part is in order."""

    part: str
    value: str
    limit: str
    verdict: Verdict
    way_out: str


def exit_status(rows: list[CheckRow]) -> int:
    """Return 1 when a part fails, else 0."""
    return int(any(row.verdict is Verdict.FAIL for row in rows))


def as_table(rows: list[CheckRow]) -> str:
    """Return text columns: one line for each part, and one for each remedy."""
    lines = []
    for row in rows:
        lines.append(f"{row.verdict.value:<7}{row.part:<13}{row.value:<46}  {row.limit}".rstrip())
        if row.way_out:
            lines.append(f"{'':<7}-> {row.way_out}")
    return "\n".join(lines)


def judge_camera(camera: CameraHealth, timeout_ms: int) -> CheckRow:
    """Judge the rate of the last second, and the frames dropped in the last minute."""
    limit = f"a frame each {timeout_ms} ms, <= {100 * MOST_DROPPED_SHARE:.0f} % dropped"
    if camera.wanted_fps is not None:
        limit = f">= {LEAST_RATE_SHARE * camera.wanted_fps:.1f} frames/s, {limit}"
    lately_percent = 100 * camera.dropped_share
    value = f"{camera.fps:.1f} frames/s, {camera.dropped} dropped, {lately_percent:.1f} % lately"
    if camera.age_ms is None or camera.age_ms > timeout_ms:
        way_out = f"{camera.source} gives no frames: check its cable, then the daemon's last log lines"
        return CheckRow("camera", value, limit, Verdict.FAIL, way_out)
    if camera.wanted_fps is not None and camera.fps < LEAST_RATE_SHARE * camera.wanted_fps - 1:
        way_out = "shorten capture.camera.exposure_us, or choose another capture.camera.format"
        return CheckRow("camera", value, limit, Verdict.WARN, way_out)
    if camera.dropped_share > MOST_DROPPED_SHARE:
        way_out = "the board is too slow for this rate, or USB too narrow: lower capture.camera.fps"
        return CheckRow("camera", value, limit, Verdict.WARN, way_out)
    return CheckRow("camera", value, limit, Verdict.OK, "")


def judge_beads(beads: BeadHealth) -> CheckRow:
    """Judge the last frame: the share of beads found, and whether it gave a valid contact."""
    value = f"{beads.found} of {beads.expected}, {beads.refused} frames refused"
    limit = f">= {100 * MIN_BEADS_SHARE:.0f} %"
    if beads.reason:
        way_out = f"{beads.reason}; see palpate-edge inspect FRAME --calibration FILE"
        return CheckRow("beads", value, limit, Verdict.FAIL, way_out)
    if beads.found < FEW_BEADS_SHARE * beads.expected:
        return CheckRow("beads", value, limit, Verdict.WARN, "clean the dome; check exposure and LED")
    return CheckRow("beads", value, limit, Verdict.OK, "")


def judge_picture(picture: PictureHealth) -> CheckRow:
    """Judge the picture of a fingertip without calibration: its light, and whether it shows beads."""
    value = (
        f"{picture.blobs} blobs, brightness {picture.brightness:.0f}, "
        f"{100 * picture.saturated_share:.1f} % saturated, sharpness {picture.sharpness:.3f}"
    )
    limit = f"brightness >= {DARK:.0f}, <= {100 * MOST_SATURATED_SHARE:.0f} % saturated, beads in sight"
    way_out = ""
    if picture.saturated_share > MOST_SATURATED_SHARE:
        way_out = "too bright: shorten capture.camera.exposure_us, or lower the LED level"
    elif picture.brightness < DARK:
        way_out = "too dark: lengthen capture.camera.exposure_us, or raise the LED level"
    elif not picture.blobs:
        way_out = "no beads in sight: focus the lens, and see palpate-edge inspect FRAME -o beads.png"
    return CheckRow("picture", value, limit, Verdict.WARN if way_out else Verdict.OK, way_out)


def judge_bus(bus: BusHealth) -> CheckRow:
    """Judge whether the bus carries frames."""
    value = f"{bus.interface} {bus.state}, {bus.sent} sent, {bus.received} received"
    limit = "up, nothing dropped lately"
    if bus.conflict:
        return CheckRow("bus", value, limit, Verdict.FAIL, bus.conflict)
    if bus.stuck:
        way_out = "the bus accepts no frame: check cabling, termination and bit rate; is there a second node?"
        return CheckRow("bus", value, limit, Verdict.FAIL, way_out)
    if bus.state != "up":
        return CheckRow("bus", value, limit, Verdict.FAIL, "check wiring, termination, bit rate; ip -s link")
    if bus.error_passive or bus.dropped_lately:
        dropped = f"{bus.dropped_lately} PDOs dropped in the last minute"
        trouble = "error passive" if bus.error_passive else dropped
        way_out = f"{trouble}: check wiring and termination, and the load (palpate-host bus budget)"
        return CheckRow("bus", value, limit, Verdict.WARN, way_out)
    return CheckRow("bus", value, limit, Verdict.OK, "")


def judge_clock(clock: ClockHealth) -> CheckRow:
    """Judge whether exposures are stamped with the time of the bus."""
    limit = f"synchronised, error <= {CLOCK_LIMIT_US} us"
    value = f"{clock.state}, error {clock.error_us} us, drift {clock.drift_ppm:+.1f} ppm"
    if clock.state == ClockState.FREE.value:
        way_out = "no SYNC with 1013h, so exposures have the board's own time: start palpate-host run"
        return CheckRow("clock", "own clock", limit, Verdict.WARN, way_out)
    if clock.state == ClockState.LOST.value:
        return CheckRow("clock", value, limit, Verdict.FAIL, "SYNC with 1013h has ended: does the host run?")
    if clock.error_us > CLOCK_LIMIT_US:
        return CheckRow("clock", value, limit, Verdict.WARN, "wait half a minute; is the bus overloaded?")
    return CheckRow("clock", value, limit, Verdict.OK, "")


def judge_light(light: LightHealth) -> CheckRow:
    """Judge the illumination controller and its temperatures."""
    if light.problem or light.led_degC is None:
        return CheckRow("temperature", "no answer", "", Verdict.FAIL, light.problem)
    silicone = "unknown" if light.silicone_degC is None else f"{light.silicone_degC:.1f} degC"
    value = f"silicone {silicone}, LED {light.led_degC:.1f} degC, level {light.level}"
    if light.faults:
        way_out = f"{light.faults}: see the faults in docs/illumination.md"
        return CheckRow("temperature", value, "no fault", Verdict.WARN, way_out)
    return CheckRow("temperature", value, "no fault", Verdict.OK, "")


def counter_rows(report: HealthReport) -> list[CheckRow]:
    """Return the counters of a running daemon, since its start; receive overruns of the last minute warn."""
    camera, beads, bus, clock, light = report.camera, report.beads, report.bus, report.clock, report.light
    frames = f"{camera.damaged} damaged, {report.recording_left_out} not recorded"
    of_beads = f"{beads.lost} lost, {beads.searches} image searches, {beads.drift_px:.2f} px drift"
    losses = f"{bus.restarts} recoveries, {bus.retries} retries, {bus.dropped} PDOs dropped"
    if bus.others_dropped:
        losses += f", {bus.others_dropped} other frames dropped"
    rows = [
        _counted("frame errors", frames),
        _counted("bead errors", of_beads),
        _bus_errors(bus),
        _counted("bus losses", losses),
        _counted("clock errors", f"{clock.steps} steps, {clock.rejected} time stamps rejected"),
    ]
    if light is not None:
        value = f"{light.losses} losses, {light.pec_errors} PEC errors, {light.triggers} triggers"
        rows.append(_counted("light errors", value))
    return rows


def _bus_errors(bus: BusHealth) -> CheckRow:
    value = f"{bus.receive_overruns} overruns, {bus.error_frames} error frames, {bus.foreign_frames} foreign"
    if bus.id_conflicts or bus.own_echoes:
        value += f", {bus.id_conflicts} with this node id, {bus.own_echoes} own"
    limit = "no overrun lately"
    if bus.overruns_lately:
        way_out = (
            f"the controller lost received frames {bus.overruns_lately} times in the last minute: "
            "lower the bus load (palpate-host bus budget)"
        )
        return CheckRow("bus errors", value, limit, Verdict.WARN, way_out)
    return CheckRow("bus errors", value, limit, Verdict.OK, "")


def _counted(part: str, value: str) -> CheckRow:
    return CheckRow(part, value, "", Verdict.OK, "")
