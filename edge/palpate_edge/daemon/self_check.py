"""``palpate-edge check``: the state of a fingertip, part by part.

If the daemon runs, its health report is judged; otherwise camera and bus are tried for a second.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

from palpate_edge.can_bus.bus import open_bus
from palpate_edge.can_bus.clock_sync import BusClock
from palpate_edge.can_bus.simulated_clock import clock_of
from palpate_edge.capture.source import Source
from palpate_edge.common.contact import Contact
from palpate_edge.common.contact_quantities import SensorOutputs
from palpate_edge.common.errors import IlluminationError, PalpateError
from palpate_edge.common.sliding_window import DroppedFrames
from palpate_edge.daemon.capture_factory import AnyCalibration, open_source, requested_stream
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
from palpate_edge.daemon.config import FingertipConfig
from palpate_edge.daemon.estimator_factory import configured_calibration, make_estimator
from palpate_edge.daemon.health import (
    BeadHealth,
    BusHealth,
    CameraHealth,
    HealthReport,
)
from palpate_edge.daemon.health_report import clock_health, light_health, picture_health
from palpate_edge.daemon.loaded_configuration import configuration_digest
from palpate_edge.estimation.estimator import best_method
from palpate_edge.estimation.frame_estimator import FrameEstimator
from palpate_edge.estimation.pose.pose_calibration import PoseCalibration
from palpate_edge.estimation.uncalibrated import NO_CALIBRATION
from palpate_edge.illumination.client import IlluminationClient
from palpate_edge.illumination.controller_thread import LightState

TRY_S = 1.5
NOT_TRIED = CheckRow("camera", "not tried", "", Verdict.WARN, "this needs the calibration, see below")
SYNC_ID, TIME_STAMP_ID = 0x080, 0x1FF


def check(config: FingertipConfig, report: HealthReport | None) -> list[CheckRow]:
    """Check all parts. report: of the running daemon, None when none runs."""
    calibration, calibration_rows = _check_calibration(config)
    if report is None:
        is_usable = all(row.verdict is not Verdict.FAIL for row in calibration_rows)
        frames = _try_frames(config, calibration) if is_usable else [NOT_TRIED]
        rows = [*frames, *calibration_rows, *_try_bus(config)]
    else:
        rows = [
            judge_camera(report.camera, config.capture.timeout_ms),
            judge_beads(report.beads) if report.picture is None else judge_picture(report.picture),
            *calibration_rows,
            judge_bus(report.bus),
            judge_clock(report.clock),
        ]
    rows.append(_check_light(config, report))
    return rows if report is None else [*rows, *counter_rows(report), *_check_loaded(config, report)]


def _check_loaded(config: FingertipConfig, report: HealthReport) -> list[CheckRow]:
    """Compare what the daemon has loaded with the files; no row for a daemon that does not report it."""
    if not report.configuration:
        return []
    if report.configuration == configuration_digest(config):
        return [CheckRow("configuration", "as in the files", "loaded", Verdict.OK, "")]
    way_out = "configuration or calibration was changed: restart the fingertip, which then loads it"
    return [CheckRow("configuration", "differs from the files", "loaded", Verdict.WARN, way_out)]


def _check_light(config: FingertipConfig, report: HealthReport | None) -> CheckRow:
    """Judge the daemon's report, or else ask the controller, which answers two masters in turn."""
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


def _check_calibration(config: FingertipConfig) -> tuple[AnyCalibration | None, list[CheckRow]]:
    path = Path(config.estimator.calibration)
    try:
        calibration = configured_calibration(config)
        if calibration is None:
            return None, [CheckRow("calibration", "none", "", Verdict.WARN, NO_CALIBRATION)]
        estimator = make_estimator(config, calibration)
    except PalpateError as error:
        return None, [CheckRow("calibration", path.name, "intact, of this sensor", Verdict.FAIL, str(error))]
    rows = [CheckRow("calibration", f"{path.name} {calibration.checksum[:16]}", "intact", Verdict.OK, "")]
    return calibration, [*rows, _model_row(calibration), *_outputs_row(estimator.outputs)]


def _model_row(calibration: AnyCalibration) -> CheckRow:
    if isinstance(calibration, PoseCalibration):
        return CheckRow("model", f"pose: {', '.join(calibration.labels)}", "", Verdict.OK, "")
    method = best_method(calibration).value
    if calibration.model:
        return CheckRow("model", f"{len(calibration.model) / 1e6:.1f} MB, {method}", "", Verdict.OK, "")
    way_out = "run palpate-edge calibrate without --no-model"
    return CheckRow("model", f"none, {method}", "", Verdict.WARN, way_out)


def _outputs_row(outputs: SensorOutputs) -> list[CheckRow]:
    """Name what the calibration never gives, which a hand may need; no row when it gives all."""
    lacking = [name for name, given in (("place", outputs.place), ("force", outputs.force)) if not given]
    if not lacking:
        return []
    way_out = "a hand that needs it refuses this fingertip: see palpate-host check"
    return [CheckRow("contact", f"{' and '.join(lacking)} unknown", "", Verdict.WARN, way_out)]


def _try_frames(config: FingertipConfig, calibration: AnyCalibration | None) -> list[CheckRow]:
    """Read and estimate frames for a second and judge camera and beads."""
    notes: list[str] = []
    try:
        clock = clock_of(config.bus)
        source = open_source(config, calibration, clock, notes.append)
        try:
            estimator = make_estimator(config, calibration)
            contacts = _first_contact(source, estimator)
            begin_s = time.monotonic()
            dropped_frames, dropped_share = DroppedFrames(), 0.0
            while time.monotonic() < begin_s + TRY_S and (frame := source.read()) is not None:
                contacts.append(estimator.estimate(frame))
                dropped_share = dropped_frames.share(clock.now_us(), len(contacts), source.dropped)
            fps = max(0, len(contacts) - 1) / (time.monotonic() - begin_s)
        finally:
            source.close()
    except PalpateError as error:
        return [CheckRow("camera", "not usable", "", Verdict.FAIL, str(error))]
    wanted = requested_stream(config, calibration)[2]
    camera = CameraHealth(
        source=config.capture.path or config.capture.camera.usb_serial,
        fps=fps,
        wanted_fps=wanted if config.capture.source == "v4l2" else None,
        age_ms=0.0 if contacts else None,
        dropped=source.dropped,
        dropped_share=0.0 if calibration is None else dropped_share,  # the search for blobs drops frames
        damaged=source.damaged,
    )
    rows = [judge_camera(camera, config.capture.timeout_ms)]
    rows += [CheckRow("camera", "", "", Verdict.WARN, note) for note in notes]
    if estimator.picture is not None:
        rows.append(judge_picture(picture_health(estimator.picture)))
    elif contacts:
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


def _first_contact(source: Source, estimator: FrameEstimator) -> list[Contact]:
    """Return the contact of the first frame, which takes longer than the following; empty without a frame."""
    frame = source.read()
    return [] if frame is None else [estimator.estimate(frame)]


def _try_bus(config: FingertipConfig) -> list[CheckRow]:
    """Listen to the bus for a second, without sending, and judge bus and clock."""
    clock, received = BusClock(), 0
    try:
        local = clock_of(config.bus)
        with open_bus(config.bus, f"{config.name}-check") as bus:
            end_s = time.monotonic() + TRY_S
            while (left_s := end_s - time.monotonic()) > 0:
                for stamp_us, frame in bus.receive(left_s):
                    received += 1
                    _feed_clock(clock, local.at_unix_us, stamp_us, frame.can_id, frame.data)
            passive, counters = bus.error_passive, bus.counters
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
            receive_overruns=counters.receive_overruns,
            error_frames=counters.error_frames,
            foreign_frames=counters.foreign_frames,
        )
    )
    return [bus_row, judge_clock(clock_health(clock, now_us))]


def _feed_clock(
    clock: BusClock, to_local_us: Callable[[int], int], stamp_us: int, can_id: int, data: bytes
) -> None:
    if can_id == SYNC_ID:
        clock.sync(to_local_us(stamp_us))
    elif can_id == TIME_STAMP_ID and len(data) == 4:
        clock.time_stamp(int.from_bytes(data, "little"))
