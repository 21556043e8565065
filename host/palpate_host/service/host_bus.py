"""The host's bus: reopened with back-off if the host is to outlive a loss.

Two kinds of loss, as for a fingertip (palpate_edge.can_bus.reconnecting_bus): after *bus-off* the descriptor
stays valid and the driver reports the restart; when the bus is *down*, the interface or the hub is gone, and
the bus is closed and opened again. Unlike there no frame waits: commands from before a loss are not sent
after it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

from palpate_edge.can_bus.back_off import BackOff
from palpate_edge.can_bus.bus import Bus
from palpate_edge.can_bus.bus_counters import BusCounters
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.can_bus.reconnecting_bus import (
    FIRST_REOPEN_US,
    LONGEST_REOPEN_US,
    BusState,
    BusStateChange,
    Stamped,
)
from palpate_edge.common.errors import BusError, BusOffError


class HostBus:
    """Owns the `Bus` that `open_bus` returns. Times are arguments; `receive` returns Unix stamps, as `Bus`
    does.

    activity: for the watchdog; grows with frames sent and received, and while the bus is known to be lost.
    """

    def __init__(
        self, open_bus: Callable[[], Bus], *, outlives: bool, sleep: Callable[[float], None] = time.sleep
    ) -> None:
        """outlives: a lost bus is a change of state; otherwise it is raised as BusError.

        Raises BusError in both cases when the bus cannot be opened at the start: waiting would not help.
        """
        self.state = BusState.UP
        self.activity = 0
        self._open_bus, self._outlives, self._sleep = open_bus, outlives, sleep
        self._bus: Bus | None = open_bus()
        self._closed_counters = BusCounters()
        self._reason = ""
        self._changes: list[BusStateChange] = []
        self._was_bus_off = False
        self._restarts_seen = 0
        self._reopen_pause = BackOff(FIRST_REOPEN_US, LONGEST_REOPEN_US)
        self._reopen_at_us = 0

    @property
    def counters(self) -> BusCounters:
        """The sums over all openings of the bus."""
        return self._closed_counters if self._bus is None else self._closed_counters.plus(self._bus.counters)

    def changes(self) -> list[BusStateChange]:
        """Return the changes of state since the last call; another reason for being down is a change too."""
        changes, self._changes = self._changes, []
        return changes

    def send(self, now_us: int, frames: Sequence[CanFrame]) -> None:
        """Send the frames as `Bus.send` does; drop them while the bus is lost."""
        if self._bus is None or self.state is not BusState.UP:
            return
        try:
            self._bus.send(frames)
        except BusError as error:
            self._go_down(now_us, error)
            return
        self.activity += len(frames)

    def receive(self, now_us: int, timeout_s: float) -> list[Stamped]:
        """Receive as `Bus.receive` does; while the bus is down wait instead, and reopen it when that is
        due."""
        if self.state is not BusState.UP:
            self.activity += 1
        if self._bus is None:
            if now_us >= self._reopen_at_us:
                return self._reopen(now_us)
            self._sleep(min(timeout_s, (self._reopen_at_us - now_us) * 1e-6))
            return []
        try:
            frames = self._bus.receive(timeout_s)
        except BusOffError as error:
            self._go_off(self._bus, error)
            return []
        except BusError as error:
            self._go_down(now_us, error)
            return []
        if self.state is BusState.BUS_OFF and (frames or self._bus.counters.restarts > self._restarts_seen):
            self._come_up()
        return self._note(frames)

    def close(self) -> None:
        """Close the bus; its counters are kept."""
        if self._bus is not None:
            self._closed_counters = self.counters
            self._bus.close()
            self._bus = None

    def _note(self, frames: list[Stamped]) -> list[Stamped]:
        """Count the frames and end the back-off: a bus that opens and carries nothing, not even the host's
        own SYNC, is lost again with the next frame sent."""
        if frames:
            self.activity += len(frames)
            self._reopen_pause.reset()
        return frames

    def _reopen(self, now_us: int) -> list[Stamped]:
        """Open the bus and receive once: a socket opens on a link that is down as well."""
        bus = None
        try:
            bus = self._open_bus()
            frames = bus.receive(0)
        except BusOffError as error:
            assert bus is not None
            self._bus = bus
            self._go_off(bus, error)
            return []
        except BusError as error:
            if bus is not None:
                bus.close()
            self._go_down(now_us, error)
            return []
        self._bus = bus
        self._come_up()
        return self._note(frames)

    def _come_up(self) -> None:
        self._enter(BusState.UP, "")
        self._was_bus_off = False

    def _go_off(self, bus: Bus, error: BusOffError) -> None:
        if not self._outlives:
            raise error
        self._was_bus_off = True
        self._restarts_seen = bus.counters.restarts
        self._enter(BusState.BUS_OFF, str(error))

    def _go_down(self, now_us: int, error: BusError) -> None:
        if not self._outlives:
            raise error
        self.close()
        self._reopen_at_us = now_us + self._reopen_pause.pause()
        self._enter(BusState.DOWN, str(error))

    def _enter(self, state: BusState, reason: str) -> None:
        if (state, reason) == (self.state, self._reason):
            return
        self.state, self._reason = state, reason
        self._changes.append(BusStateChange(state, reason, self._was_bus_off))
