"""The `HealthReport` of a running fingertip, made from its parts."""

from __future__ import annotations

import os
import time

import msgspec

from palpate_edge.can_bus.clock_sync import BusClock
from palpate_edge.can_bus.reconnecting_bus import ReconnectingBus
from palpate_edge.daemon.capture_thread import CaptureThread
from palpate_edge.daemon.config import CaptureConfig, FingertipConfig
from palpate_edge.daemon.fingertip_core import FingertipCore
from palpate_edge.daemon.frame_monitor import FrameMonitor
from palpate_edge.daemon.health import (
    BeadHealth,
    BusHealth,
    CameraHealth,
    ClockHealth,
    HealthReport,
    LightHealth,
    PictureHealth,
)
from palpate_edge.daemon.recording_control import RecordingControl
from palpate_edge.estimation.frame_estimator import EstimatorHealth
from palpate_edge.illumination.controller_thread import LightController, LightState
from palpate_edge.illumination.registers import Fault
from palpate_edge.node.fingertip_objects import Counter, Health
from palpate_edge.vision.picture_measure import PictureMeasure


class FingertipParts(msgspec.Struct, frozen=True, kw_only=True):
    """The parts of a running fingertip that are reported. light: None without an illumination controller.

    wanted_fps: the rate that the camera is asked for. loaded: digest of configuration and calibration.
    """

    config: FingertipConfig
    core: FingertipCore
    bus: ReconnectingBus
    capture: CaptureThread
    recording: RecordingControl
    light: LightController | None
    wanted_fps: float
    loaded: str = ""


def board_health(parts: FingertipParts) -> Health:
    """Return the board's health as the node publishes it."""
    source, bus, clock = parts.capture.source, parts.bus, parts.core.clock
    estimator, counters = parts.capture.estimator.health, parts.bus.counters
    light = parts.light.latest if parts.light else None
    state = light.state if light else None
    return Health(
        temperature_degC=light.temperature_degC if light else None,
        frames_dropped=source.dropped,
        led_level=light.level if light else 0,
        skin_drift_px=estimator.drift_px,
        exposure_us=source.exposure_us,
        counters={
            Counter.WHOLE_IMAGE_SEARCHES: estimator.searches,
            Counter.TRANSMIT_RETRIES: bus.retries,
            Counter.BUS_RESTARTS: bus.restarts,
            Counter.PDOS_DROPPED: bus.dropped,
            Counter.RECEIVE_OVERRUNS: counters.receive_overruns,
            Counter.BUS_ERROR_FRAMES: counters.error_frames,
            Counter.FOREIGN_FRAMES: counters.foreign_frames,
            Counter.FRAMES_DAMAGED: source.damaged,
            Counter.BEADS_NOT_FOUND: estimator.beads_lost,
            Counter.BUS_CLOCK_STEPS: clock.steps,
            Counter.TIME_STAMPS_REJECTED: clock.rejected,
            Counter.FRAMES_NOT_RECORDED: parts.recording.frames_left_out,
            Counter.LIGHT_CONTROLLER_LOSSES: light.losses if light else 0,
            Counter.LIGHT_CONTROLLER_PEC_ERRORS: state.pec_errors if state else 0,
            Counter.CAMERA_TRIGGERS: state.triggers if state else 0,
            Counter.ID_CONFLICTS: parts.core.conflict.frames,
        },
    )


def health_report(
    parts: FingertipParts, dropped_share: float, pdos_dropped_lately: int, overruns_lately: int, now_us: int
) -> HealthReport:
    """Return the report. dropped_share: of the last minute's frames; lately: in the last minute; now_us:
    local time."""
    config, core, bus, capture = parts.config, parts.core, parts.bus, parts.capture
    monitor = core.monitor
    counters = bus.counters
    measure = capture.estimator.picture
    return HealthReport(
        name=config.name,
        pid=os.getpid(),
        written_at=time.monotonic(),
        node_id=config.node.id,
        nmt_state=core.state.name.lower().replace("_", "-"),
        frames=monitor.frames,
        method="none" if capture.estimator.method is None else capture.estimator.method.value,
        calibration=config.estimator.calibration,
        emergencies=core.emergencies.names(),
        latencies=core.latencies(),
        recording=parts.recording.folder,
        camera=camera_health(config.capture, capture, monitor, parts.wanted_fps, dropped_share, now_us),
        beads=bead_health(monitor, capture.estimator.health),
        bus=BusHealth(
            interface=config.bus.interface,
            state=bus.state.value,
            sent=counters.sent,
            received=counters.received,
            retries=bus.retries,
            dropped=bus.dropped,
            dropped_lately=pdos_dropped_lately,
            restarts=bus.restarts,
            error_passive=bus.error_passive,
            receive_overruns=counters.receive_overruns,
            overruns_lately=overruns_lately,
            error_frames=counters.error_frames,
            foreign_frames=counters.foreign_frames,
            own_echoes=counters.own_echoes,
            others_dropped=bus.others_dropped,
            id_conflicts=core.conflict.frames,
            stuck=bus.is_stuck(now_us),
            conflict=core.conflict_problem,
        ),
        clock=clock_health(core.clock, now_us),
        light=None if parts.light is None else light_health(parts.light.latest),
        recording_left_out=parts.recording.frames_left_out,
        picture=None if measure is None else picture_health(measure),
        configuration=parts.loaded,
    )


def camera_health(
    config: CaptureConfig,
    capture: CaptureThread,
    monitor: FrameMonitor,
    wanted_fps: float,
    dropped_share: float,
    now_us: int,
) -> CameraHealth:
    """Return the report of the camera. dropped_share: of the last minute's frames; without a calibration it
    is left out, since the search for blobs drops frames."""
    return CameraHealth(
        source=config.path or config.camera.usb_serial,
        fps=monitor.fps(now_us),
        wanted_fps=wanted_fps if config.source == "v4l2" else None,
        age_ms=None if monitor.last_us is None else (now_us - monitor.last_us) / 1000,
        dropped=capture.source.dropped,
        dropped_share=0.0 if capture.estimator.method is None else dropped_share,
        damaged=capture.source.damaged,
    )


def bead_health(monitor: FrameMonitor, estimator: EstimatorHealth) -> BeadHealth:
    """Return the report of the beads in the last frame, and of the estimator since its start."""
    contact = monitor.last_contact
    return BeadHealth(
        found=contact.beads_found if contact else 0,
        expected=contact.beads_expected if contact else 0,
        refused=monitor.refused,
        reason=contact.reason if contact else "no frame yet",
        lost=estimator.beads_lost,
        searches=estimator.searches,
        drift_px=estimator.drift_px,
    )


def picture_health(measure: PictureMeasure) -> PictureHealth:
    """Return the report of a picture's measures."""
    return PictureHealth(
        brightness=measure.brightness,
        saturated_share=measure.saturated_share,
        sharpness=measure.sharpness,
        blobs=measure.blobs,
    )


def clock_health(clock: BusClock, now_us: int) -> ClockHealth:
    """Return the clock's report. now_us: local time, on the clock that `clock` was fed with."""
    return ClockHealth(
        state=clock.state(now_us).value,
        local_us=now_us,
        bus_us=clock.to_bus_us(now_us),
        drift_ppm=clock.drift_ppb / 1000,
        error_us=clock.error_us(now_us),
        steps=clock.steps,
        rejected=clock.rejected,
    )


def light_health(light: LightState) -> LightHealth:
    """Return the report of an illumination controller."""
    state = light.state
    faults = Fault(0) if state is None else state.faults
    return LightHealth(
        level=light.level,
        led_degC=None if state is None else state.led_degC,
        silicone_degC=light.temperature_degC,
        faults=", ".join((fault.name or "").lower().replace("_", " ") for fault in faults),
        problem=light.problem,
        losses=light.losses,
        triggers=0 if state is None else state.triggers,
        pec_errors=0 if state is None else state.pec_errors,
    )
