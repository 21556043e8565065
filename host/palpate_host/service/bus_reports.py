"""What becomes of the host's bus, told to who wants to know: the core, the journal, systemd's status line."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from palpate_edge.can_bus.reconnecting_bus import BusState, BusStateChange
from palpate_edge.common.sd_notify import Notifier
from palpate_host.service.host_core import HostCore


class BusReports:
    """usual: the status line while nothing is the matter; the caller has said it with READY."""

    def __init__(self, core: HostCore, notifier: Notifier, usual: str) -> None:
        self._core, self._notifier = core, notifier
        self._usual = self._said = usual

    def bus_changed(self, now_us: int, changes: Sequence[BusStateChange]) -> None:
        """What `HostBus.changes` gives."""
        for change in changes:
            if change.state is BusState.UP:
                self._core.bus_restored(now_us)
                said = "the bus is up again: palpate-host command recover"
            else:
                self._core.bus_lost(now_us, change.reason)
                said = f"the bus is {change.state.value}. {change.reason}"
            print(said, file=sys.stderr, flush=True)
            self._say(said)

    def recovered(self) -> None:
        """The hand is neither in fault nor in stop."""
        self._say(self._usual)

    def _say(self, said: str) -> None:
        if said != self._said:
            self._said = said
            self._notifier.status(said)
