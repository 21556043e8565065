"""A bus that is reopened after a loss, and to which sending never waits.

Two kinds of loss. *Bus-off*: the controller took itself off the bus; the descriptor stays valid and the
driver reports the restart. *Down*: the interface or the hub is gone; the bus is closed, and opened again with
back-off. A full transmit queue is no loss: the frames wait, and the socket stays open.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from enum import Enum

import msgspec

from palpate_edge.can_bus.back_off import BackOff
from palpate_edge.can_bus.bus import Bus
from palpate_edge.can_bus.bus_counters import BusCounters
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.can_bus.own_frames import OwnFrames
from palpate_edge.can_bus.transmit_queue import EMCY_IDS, TransmitQueue
from palpate_edge.common.errors import BusError, BusOffError

# Pauses between two attempts to open the bus: after any outage, contacts are sent again within a second.
FIRST_REOPEN_US, LONGEST_REOPEN_US = 100_000, 500_000
FIRST_RESEND_US, LONGEST_RESEND_US = 500, 10_000  # pauses between two attempts to send into a full queue
STUCK_AFTER_US = 1_000_000  # without an accepted frame while some wait

Stamped = tuple[int, CanFrame]


class BusState(Enum):
    """State of a bus that may be lost."""

    UP = "up"
    BUS_OFF = "bus-off"
    DOWN = "down"


class BusStateChange(msgspec.Struct, frozen=True):
    """A new state of the bus. reason: empty when it is up; after_bus_off: the loss began with a bus-off."""

    state: BusState
    reason: str
    after_bus_off: bool


class ReconnectingBus:
    """Owns the `Bus` that `open_bus` returns. Times are arguments; `receive` returns Unix stamps, as `Bus`
    does.

    retries: refused attempts to send; restarts: recoveries from a loss.
    """

    def __init__(self, open_bus: Callable[[], Bus]) -> None:
        """Raises BusError when the bus cannot be opened at the start: waiting would not help."""
        self.state = BusState.UP
        self.retries = 0
        self.restarts = 0
        self._open_bus = open_bus
        self._bus: Bus | None = open_bus()
        self._openings = 1
        self._closed_counters = BusCounters()
        self._queue = TransmitQueue()
        self._changes: list[BusStateChange] = []
        self._own_frames = OwnFrames()
        self._now_us = 0
        self._refused_since_us: int | None = None
        self._early_frames: list[Stamped] = []
        self._was_bus_off = False
        self._restarts_seen = 0
        self._reopen_pause = BackOff(FIRST_REOPEN_US, LONGEST_REOPEN_US)
        self._reopen_at_us = 0
        self._resend_pause = BackOff(FIRST_RESEND_US, LONGEST_RESEND_US)
        self._resend_at_us: int | None = None

    @property
    def counters(self) -> BusCounters:
        """The sums over all openings of the bus."""
        return self._closed_counters if self._bus is None else self._closed_counters.plus(self._bus.counters)

    @property
    def activity(self) -> int:
        """Frames sent and received: grows while the bus carries frames."""
        closed, bus = self._closed_counters, self._bus
        now = 0 if bus is None else bus.counters.sent + bus.counters.received
        return closed.sent + closed.received + now

    @property
    def receive_overruns(self) -> int:
        """Reports that the controller lost received frames, over all openings of the bus."""
        now = 0 if self._bus is None else self._bus.counters.receive_overruns
        return self._closed_counters.receive_overruns + now

    @property
    def dropped(self) -> int:
        """PDOs dropped because the transmit queue was full or the bus was lost."""
        return self._queue.dropped

    @property
    def others_dropped(self) -> int:
        """Responses, heartbeats and emergencies dropped because the transmit queue was full."""
        return self._queue.others_dropped

    def is_stuck(self, now_us: int) -> bool:
        """Return whether frames wait and the bus has accepted none for STUCK_AFTER_US."""
        since_us = self._refused_since_us
        return since_us is not None and now_us - since_us >= STUCK_AFTER_US

    @property
    def error_passive(self) -> bool:
        """The controller's last report; False while the bus is down."""
        return self._bus is not None and self._bus.error_passive

    def descriptor(self) -> tuple[int, int] | None:
        """Return (file descriptor, number of openings): it polls readable when `receive` has frames.

        None while the bus is down. The kernel may reuse the number of a descriptor, hence the second number.
        """
        return None if self._bus is None else (self._bus.fileno(), self._openings)

    def accept(self, can_ids: Sequence[int]) -> None:
        """Set another receive filter; a bus opened later gets it from `open_bus`."""
        if self._bus is not None:
            with suppress(BusError):  # the bus is down: `receive` reports it
                self._bus.accept(can_ids)

    def changes(self) -> list[BusStateChange]:
        """Return the changes of state since the last call."""
        changes, self._changes = self._changes, []
        return changes

    def receive(self, now_us: int) -> list[Stamped]:
        """Return the frames received; a failure changes the state and never raises."""
        self._now_us = now_us
        if self._bus is None:
            return []
        frames, self._early_frames = self._early_frames, []
        try:
            frames += self._bus.receive(0)
        except BusOffError as error:
            self._enter(BusState.BUS_OFF, str(error))
        except BusError as error:
            self._go_down(now_us, str(error))
            return frames
        if self.state is BusState.BUS_OFF and (frames or self._bus.counters.restarts > self._restarts_seen):
            self._come_up()
        return frames

    def send(self, now_us: int, frames: Sequence[CanFrame]) -> None:
        """Send the frames after those that wait; while the bus is lost only emergencies are kept."""
        if self.state is BusState.UP and not self._queue:
            frames = frames[self._offer(now_us, frames) :]
        if self.state is not BusState.UP:
            frames = [frame for frame in frames if frame.can_id in EMCY_IDS]
        self._queue.put(now_us, frames)
        if self._queue and (self._resend_at_us is None or now_us >= self._resend_at_us):
            self._flush(now_us)

    def poll(self, now_us: int) -> None:
        """Do what is due: reopen the bus, or send frames that wait."""
        if self.state is BusState.DOWN and now_us >= self._reopen_at_us:
            self._reopen(now_us)
        elif self._resend_at_us is not None and now_us >= self._resend_at_us:
            self._flush(now_us)

    @property
    def due_us(self) -> int | None:
        """The time of the next `poll` that has work; None when nothing is due."""
        return self._reopen_at_us if self.state is BusState.DOWN else self._resend_at_us

    def close(self) -> None:
        """Close the bus; its counters are kept."""
        if self._bus is not None:
            self._closed_counters = self.counters
            self._bus.close()
            self._bus = None

    def _flush(self, now_us: int) -> None:
        self._resend_at_us = None
        if self.state is BusState.UP:
            self._queue.sent(self._offer(now_us, self._queue.fresh(now_us)))

    def _offer(self, now_us: int, frames: Sequence[CanFrame]) -> int:
        """Return how many of the frames the bus took at once; schedule another attempt for the rest."""
        if self._bus is None or not frames:
            return 0
        try:
            taken = self._bus.try_send(frames)
        except BusError as error:
            self._go_down(now_us, str(error))
            return 0
        self._own_frames.sent(now_us, frames[:taken])
        if taken:
            self._resend_pause.reset()
            self._refused_since_us = None
        elif self._refused_since_us is None:
            self._refused_since_us = now_us
        if taken < len(frames):
            self.retries += 1
            self._resend_at_us = now_us + self._resend_pause.pause()
        return taken

    def _reopen(self, now_us: int) -> None:
        """Open the bus and receive once: a socket opens on a link that is down as well."""
        bus = None
        try:
            bus = self._open_bus()
            self._openings += 1
            self._now_us = now_us
            self._own_frames.reopened(now_us)
            bus.expects_echo = lambda frame: self._own_frames.is_echo(self._now_us, frame)
            self._early_frames = bus.receive(0)
        except BusOffError as error:
            self._bus = bus
            self._enter(BusState.BUS_OFF, str(error))
            return
        except BusError:
            if bus is not None:
                bus.close()
            self._reopen_at_us = now_us + self._reopen_pause.pause()
            return
        self._bus = bus
        self._come_up()

    def _come_up(self) -> None:
        self.restarts += 1
        self._reopen_pause.reset()
        self._enter(BusState.UP, "")
        self._was_bus_off = False
        self._resend_at_us = 0  # the emergencies that wait

    def _go_down(self, now_us: int, reason: str) -> None:
        self.close()
        self._own_frames.lost(now_us)
        self._reopen_at_us = now_us + self._reopen_pause.pause()
        self._enter(BusState.DOWN, reason)

    def _enter(self, state: BusState, reason: str) -> None:
        if state is self.state:
            return
        self.state = state
        if state is BusState.BUS_OFF:
            assert self._bus is not None
            self._was_bus_off = True
            self._restarts_seen = self._bus.counters.restarts
        self._changes.append(BusStateChange(state, reason, self._was_bus_off))
        if state is not BusState.UP:
            self._resend_at_us = self._refused_since_us = None
            self._queue.keep_emergencies()
