"""The parts of a fingertip's health report while nothing is wrong."""

from __future__ import annotations

from palpate_edge.daemon.health import BeadHealth, BusHealth, CameraHealth, ClockHealth, HealthReport

CAMERA = CameraHealth(
    source="/dev/v4l/by-path/x", fps=30.0, wanted_fps=30.0, age_ms=20.0, dropped=0, dropped_share=0.0
)
BEADS = BeadHealth(found=85, expected=85, refused=3, reason="")
BUS = BusHealth(
    interface="socketcan",
    state="up",
    sent=9,
    received=9,
    retries=0,
    dropped=0,
    dropped_lately=0,
    restarts=0,
    error_passive=False,
)
CLOCK = ClockHealth(
    state="synchronised", local_us=0, bus_us=0, drift_ppm=3.0, error_us=20, steps=0, rejected=0
)
REPORT = HealthReport(
    name="finger",
    pid=1,
    written_at=0.0,
    node_id=0x10,
    nmt_state="operational",
    frames=1,
    method="paper",
    calibration="/etc/finger.cal",
    emergencies=[],
    latencies=[0] * 8,
    recording="",
    camera=CAMERA,
    beads=BEADS,
    bus=BUS,
    clock=CLOCK,
)
