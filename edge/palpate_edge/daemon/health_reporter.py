"""The fingertip's health once a second: to the health file, systemd's status line and the log."""

from __future__ import annotations

import logging

from palpate_edge.common.local_sockets.sd_notify import Notifier
from palpate_edge.common.sliding_window import DroppedFrames, SlidingWindow
from palpate_edge.daemon.health import HealthFile, HealthReport, health_path
from palpate_edge.daemon.health_report import FingertipParts, board_health, health_report
from palpate_edge.node.emergencies import Emergency, name_of

REPORT_EVERY_US = 1_000_000
LOGGED_ELSEWHERE = frozenset(
    map(name_of, (Emergency.CAMERA_LOST, Emergency.CAMERA_STALLED, Emergency.ID_COLLISION))
)
"""The daemon logs these at once, with their reason."""

_log = logging.getLogger("palpate.emergency")


class HealthReporter:
    """Reports the parts of a running fingertip; the file is removed by `close`.

    due_us: when `update` reports next. latest: the last report.
    """

    def __init__(self, parts: FingertipParts, notifier: Notifier) -> None:
        self.due_us = 0
        self.latest: HealthReport | None = None
        self._parts, self._notifier = parts, notifier
        self._file = HealthFile(health_path(parts.config.name, parts.config.health))
        self._dropped_frames, self._lately = DroppedFrames(), SlidingWindow()
        self._emergencies: set[str] = set()

    def update(self, now_us: int) -> bool:
        """Report when it is due; return whether it was. now_us: local time."""
        if now_us < self.due_us:
            return False
        self.due_us = now_us + REPORT_EVERY_US
        parts = self._parts
        dropped_share = self._dropped_frames.share(
            now_us, parts.core.monitor.frames, parts.capture.source.dropped
        )
        pdos_lately, overruns_lately = self._lately.growth(
            now_us, (parts.bus.dropped, parts.bus.receive_overruns)
        )
        report = health_report(parts, dropped_share, pdos_lately, overruns_lately, now_us)
        self.latest = report
        self._notifier.status(_status_line(report))
        self._log_emergencies(set(report.emergencies) - LOGGED_ELSEWHERE)
        self._file.write(report)
        parts.core.report_health(board_health(parts))
        return True

    def close(self) -> None:
        """Remove the health file."""
        self._file.close()

    def _log_emergencies(self, emergencies: set[str]) -> None:
        for name in sorted(emergencies - self._emergencies):
            _log.warning("%s: see palpate-edge check", name)
        for name in sorted(self._emergencies - emergencies):
            _log.info("%s: over", name)
        self._emergencies = emergencies


def _status_line(report: HealthReport) -> str:
    emergencies = ", ".join(report.emergencies)
    line = f"{report.nmt_state}, {report.camera.fps:.0f} frames/s, bus {report.bus.state}"
    return f"{line}; {emergencies}" if emergencies else line
