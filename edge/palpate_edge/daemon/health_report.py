"""From the parts of a running fingertip to its `HealthReport`."""

from __future__ import annotations

import os
import time

from palpate_edge.can_bus.clock_sync import BusClock
from palpate_edge.can_bus.reconnecting_bus import ReconnectingBus
from palpate_edge.daemon.capture_thread import CaptureThread
from palpate_edge.daemon.config import FingertipConfig
from palpate_edge.daemon.fingertip_core import FingertipCore
from palpate_edge.daemon.health import (
    BeadHealth,
    BusHealth,
    CameraHealth,
    ClockHealth,
    HealthReport,
    LightHealth,
)
from palpate_edge.illumination.controller_thread import LightState
from palpate_edge.illumination.registers import Fault


def health_report(
    config: FingertipConfig,
    core: FingertipCore,
    link: ReconnectingBus,
    pixels: CaptureThread,
    fps: float,
    recording: str,
    light: LightState | None,
    dropped_share: float,
    pdos_dropped_lately: int,
    now_us: int,
) -> HealthReport:
    """fps: that a camera was asked for; recording: its folder, or empty; light: None without a
    controller; dropped_share: of the last minute's frames; now_us: on the daemon's clock."""
    monitor = core.monitor
    contact = monitor.last_contact
    return HealthReport(
        name=config.name,
        pid=os.getpid(),
        written_at=time.monotonic(),
        node_id=config.node.id,
        nmt_state=core.state.name.lower().replace("_", "-"),
        frames=monitor.frames,
        method=pixels.estimator.method.value,
        calibration=config.estimator.calibration,
        emergencies=core.emergencies.names(),
        latencies=core.latencies(),
        recording=recording,
        camera=CameraHealth(
            source=config.capture.path or config.capture.camera.usb_serial,
            fps=monitor.fps(now_us),
            wanted_fps=fps if config.capture.source == "v4l2" else None,
            age_ms=None if monitor.last_us is None else (now_us - monitor.last_us) / 1000,
            dropped=pixels.source.dropped,
            dropped_share=dropped_share,
        ),
        beads=BeadHealth(
            found=contact.beads_found if contact else 0,
            expected=contact.beads_expected if contact else 0,
            refused=monitor.refused,
            reason=contact.reason if contact else "no frame yet",
        ),
        bus=BusHealth(
            interface=config.bus.interface,
            state=link.state.value,
            sent=link.sent,
            received=link.received,
            retries=link.retries,
            dropped=link.dropped,
            dropped_lately=pdos_dropped_lately,
            restarts=link.restarts,
            error_passive=link.error_passive,
        ),
        clock=clock_health(core.clock, now_us),
        light=None if light is None else light_health(light),
    )


def clock_health(clock: BusClock, now_us: int) -> ClockHealth:
    """now_us: on the clock that `clock` was fed with."""
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
    """Of a fingertip with an illumination controller."""
    state = light.state
    faults = Fault(0) if state is None else state.faults
    return LightHealth(
        level=light.level,
        led_degC=None if state is None else state.led_degC,
        silicone_degC=light.temperature_degC,
        faults=", ".join((fault.name or "").lower().replace("_", " ") for fault in faults),
        problem=light.problem,
    )
