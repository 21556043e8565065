"""Changes of the bus and of the hand's mode, reported to the core, the log and systemd's status line."""

from __future__ import annotations

import logging
from collections.abc import Sequence

from palpate_edge.can_bus.reconnecting_bus import BusState, BusStateChange
from palpate_edge.common.local_sockets.sd_notify import Notifier
from palpate_edge.common.logs import LineLimit, LogLine
from palpate_host.common.mode import STOPPED, Mode
from palpate_host.common.status import HostStatus
from palpate_host.service.host_core import HostCore

LEVELS = {Mode.FAULT: logging.ERROR, Mode.HOLD: logging.WARNING}
"""Modes that are logged with their reason when the hand enters them, and when it leaves them."""

_bus_log = logging.getLogger("palpate.bus")
_hand_log = logging.getLogger("palpate.hand")


class BusReports:
    """usual: the status line while the hand has no problem; the caller has sent it with READY."""

    def __init__(self, core: HostCore, notifier: Notifier, usual: str) -> None:
        self._core, self._notifier = core, notifier
        self._usual = self._line = usual
        self._bus_problem = ""
        self._bus_lines = LineLimit("changes of the bus")
        self._mode = Mode.INIT

    def bus_changed(self, now_us: int, changes: Sequence[BusStateChange]) -> None:
        """Pass the changes of `HostBus.changes` on to the core, and report them."""
        lines: list[LogLine] = []
        for change in changes:
            if change.state is BusState.UP:
                self._core.bus_restored(now_us)
                line = "the bus is up again: palpate-host command recover"
                lines.append(LogLine(logging.INFO, line))
            else:
                self._core.bus_lost(now_us, change.reason)
                line = f"the bus is {change.state.value}. {change.reason}"
                lines.append(LogLine(logging.ERROR, line))
                self._bus_problem = change.reason
            self._set_status_line(line)
        for due in self._bus_lines.update(now_us, lines):
            _bus_log.log(due.level, due.text)

    def ticked(self, status: HostStatus) -> None:
        """Log FAULT and HOLD and their end; restore the usual status line outside FAULT and STOP."""
        if status.mode is not self._mode:
            level = LEVELS.get(status.mode, logging.INFO)
            known = status.mode is Mode.FAULT and status.reason == self._bus_problem  # logged as the bus's
            if not known and (status.mode in LEVELS or self._mode in LEVELS):
                _hand_log.log(level, "%s: %s", status.mode.value, status.reason)
            self._mode = status.mode
        if status.mode not in STOPPED:
            self._set_status_line(self._usual)

    def _set_status_line(self, line: str) -> None:
        if line != self._line:
            self._line = line
            self._notifier.status(line)
