"""Hand, object and drives in real time on a bus; the fingertips' cameras beside them."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass

from palpate_edge.bus import Bus
from palpate_edge.can_frame import CanFrame
from palpate_edge.errors import BusError
from palpate_edge.node.events import NodeIdConflict
from palpate_host.hand import Hand
from palpate_host.hand_config import HandConfig
from palpate_host.twin.hand.driven_hand import DrivenHand
from palpate_host.twin.hand.engine import Engine
from palpate_host.twin.hand.fingertip_feel import touches_in_F
from palpate_host.twin.hand.live_cameras import Exposure, LiveCameras
from palpate_host.twin.hand.motion import PERIOD_US, MotionFile

LOOK_US = 2_000
"""The hand moves on at least so often, in steps of the engine."""
LARGEST_LAG_US = 20_000
"""What the machine keeps from the hand beyond this is lost: the hand's time then lags behind the clock."""


@dataclass(slots=True)
class LiveCounters:
    """exposures: of all cameras. largest_lag_us: how late the hand was moved on; lost_us: the time that the
    hand therefore stood still."""

    exposures: int = 0
    largest_lag_us: int = 0
    lost_us: int = 0


class LiveHand:
    """Call `serve`; it ends when `stop` is set."""

    def __init__(
        self, config: HandConfig, hand: Hand, engine: Engine, cameras: LiveCameras, motion: MotionFile
    ) -> None:
        self.counters = LiveCounters()
        self._hand, self._engine, self._cameras, self._motion = hand, engine, cameras, motion
        self._driven = DrivenHand(config, engine)
        self._wanted = [set(device.slave.accept_ids()) for device in self._driven.devices]
        self._step_us = round(engine.step_s * 1e6)
        self._period_us = [1e6 / fps for fps in cameras.fps]
        self._sequence = [0] * len(cameras.fps)
        self._unix_us = time.time_ns() // 1000 - now_us()
        self._start_us = self._hand_us = self._next_row_us = now_us()

    @property
    def accept_ids(self) -> list[int]:
        """What the drives want from the bus."""
        return sorted(set().union(*self._wanted))

    def serve(self, bus: Bus, stop: threading.Event) -> None:
        """Raises BusError when the bus is gone or another node has a drive's id."""
        due_us = [0] * len(self._driven.devices)
        while not stop.is_set():
            wait_us = min(*due_us, self._hand_us + LOOK_US) - now_us()
            frames = [frame for _, frame in bus.receive(max(0, wait_us) * 1e-6)]
            now = now_us()
            self._advance(now)
            for index, wanted in enumerate(self._wanted):
                mine = [frame for frame in frames if frame.can_id in wanted]
                if mine or now >= due_us[index]:
                    due_us[index] = self._serve_device(bus, index, now, mine)

    def _serve_device(self, bus: Bus, index: int, now: int, frames: Sequence[CanFrame]) -> int:
        """When it is due again."""
        device = self._driven.devices[index]
        output = device.process(now, frames)
        for event in output.events:
            if isinstance(event, NodeIdConflict):
                raise BusError(
                    f"node id {device.slave.node_id} is taken: frame {event.can_id:03X} came from another "
                    "node; stop that node or give the drive another id"
                )
        bus.send(output.frames_out)
        return output.next_due_us

    def _advance(self, now: int) -> None:
        """The hand and its cameras up to `now`."""
        lag_us = now - self._hand_us
        self.counters.largest_lag_us = max(self.counters.largest_lag_us, lag_us)
        if lag_us > LARGEST_LAG_US:
            lost_us = lag_us - LARGEST_LAG_US
            self.counters.lost_us += lost_us
            self._hand_us += lost_us
            self._start_us += lost_us  # the cameras stood still as well: no exposures to catch up with
        while self._hand_us + self._step_us <= now:
            self._driven.step()
            self._hand_us += self._step_us
            self._expose()
            if self._hand_us >= self._next_row_us:
                self._next_row_us += PERIOD_US
                self._motion.note(self._hand_us + self._unix_us, self._engine)

    def _expose(self) -> None:
        """The cameras whose turn it is see the hand as it stands."""
        count = len(self._period_us)
        due = [
            finger
            for finger, period_us in enumerate(self._period_us)
            if self._hand_us >= self._start_us + (self._sequence[finger] + finger / count) * period_us
        ]
        if not due:
            return
        touches = touches_in_F(self._engine, self._hand)
        for finger in due:
            self._cameras.expose(Exposure(finger, self._sequence[finger], self._hand_us, touches[finger][0]))
            self._sequence[finger] += 1
            self.counters.exposures += 1


def now_us() -> int:
    """CLOCK_MONOTONIC in us, by which frames are stamped."""
    return time.monotonic_ns() // 1000
