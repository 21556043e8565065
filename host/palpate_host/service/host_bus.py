"""The host's bus at the rim: where the host may outlive it, it is opened again with back-off.

Two ways to lose it, as for a fingertip (palpate_edge.can_bus.reconnecting_bus): after *bus-off* the
descriptor stays good and the driver says when it restarts; *down*, the interface or the hub is gone, it
is closed and opened anew.
Unlike there nothing waits here to be sent: a command of before the loss is not said after it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

from palpate_edge.can_bus.bus import Bus
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.can_bus.reconnecting_bus import (
    FIRST_RETRY_US,
    LONGEST_RETRY_US,
    BusState,
    BusStateChange,
    Stamped,
)
from palpate_edge.common.errors import BusError, BusOffError


class HostBus:
    """Owns the `Bus` that `open_one` gives. Times are arguments; `receive` gives Unix stamps, as `Bus` does.

    activity: grows while frames go or come, and while it is known that there is no bus: for the watchdog.
    """

    def __init__(
        self, open_one: Callable[[], Bus], *, outlives: bool, sleep: Callable[[float], None] = time.sleep
    ) -> None:
        """outlives: a lost bus is a change; otherwise it is raised as BusError.

        Raises BusError either way: what cannot be opened at the start will not come by waiting.
        """
        self.state = BusState.UP
        self.activity = 0
        self._open_one, self._outlives, self._sleep = open_one, outlives, sleep
        self._bus: Bus | None = open_one()
        self._reason = ""
        self._changes: list[BusStateChange] = []
        self._was_bus_off = False
        self._restarts_seen = 0
        self._retry_us = FIRST_RETRY_US
        self._retry_at_us = 0

    def changes(self) -> list[BusStateChange]:
        """What has changed since the last call; another reason for being down is a change too."""
        changes, self._changes = self._changes, []
        return changes

    def send(self, now_us: int, frames: Sequence[CanFrame]) -> None:
        """As `Bus.send`; without a bus the frames are given up."""
        if self._bus is None or self.state is not BusState.UP:
            return
        try:
            self._bus.send(frames)
        except BusError as error:
            self._go_down(now_us, error)
            return
        self.activity += len(frames)

    def receive(self, now_us: int, timeout_s: float) -> list[Stamped]:
        """As `Bus.receive`; without a bus it waits, and opens the bus again when that is due."""
        if self.state is not BusState.UP:
            self.activity += 1
        if self._bus is None:
            if now_us >= self._retry_at_us:
                return self._reopen(now_us)
            self._sleep(min(timeout_s, (self._retry_at_us - now_us) * 1e-6))
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
        if self._bus is not None:
            self._bus.close()
            self._bus = None

    def _note(self, frames: list[Stamped]) -> list[Stamped]:
        """Frames that come, the own SYNC among them, are what ends the back-off: a bus that opens and carries
        nothing is lost again with the next frame sent."""
        if frames:
            self.activity += len(frames)
            self._retry_us = FIRST_RETRY_US
        return frames

    def _reopen(self, now_us: int) -> list[Stamped]:
        """Open it and look whether it is up: a socket on a link that is down opens as well."""
        bus = None
        try:
            bus = self._open_one()
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
        self._retry_at_us = now_us + self._retry_us
        self._retry_us = min(2 * self._retry_us, LONGEST_RETRY_US)
        self._enter(BusState.DOWN, str(error))

    def _enter(self, state: BusState, reason: str) -> None:
        if (state, reason) == (self.state, self._reason):
            return
        self.state, self._reason = state, reason
        self._changes.append(BusStateChange(state, reason, self._was_bus_off))
