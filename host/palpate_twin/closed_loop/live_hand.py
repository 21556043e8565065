"""Hand, object and drives in real time on a bus; the fingertips' cameras beside them.

The hand's time goes with the clock's, but never ahead of what it is served: it waits for a picture that is
not drawn yet, for the last picture's contact before it takes the next, and for commands that know where its
joints are. Late commands would end the grasp: B of Eq. (10) acts through the bus, on links that come to rest
within 15 ms. While it waits, the time of everything on its bus nearly stands still (twin_clock.py). A machine
that is too slow therefore slows the hand down, and changes nothing else.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Protocol

from palpate_edge.can_bus.bus import Bus
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.can_bus.simulated_clock import ClockKeeper
from palpate_edge.common.local_clock import monotonic_us, unix_ahead_us
from palpate_host.config.hand_config import HandConfig
from palpate_host.control.kinematics import HandKinematics
from palpate_host.drives.serve_devices import refuse_conflict
from palpate_host.network.fingertips import Fingertip
from palpate_host.network.nmt_master import SYNC
from palpate_twin.closed_loop.fingertip_feel import touches_in_F
from palpate_twin.closed_loop.live_cameras import Exposure
from palpate_twin.hand.driven_hand import DrivenHand
from palpate_twin.hand.engine import Engine
from palpate_twin.hand.motion import PERIOD_US, MotionFile

LOOK_US = 2_000
"""The hand moves on at least so often, in steps of the engine."""
SLACK_US = 8_000
"""The hand may be so far behind the clock and catch up: waiting that was over in time costs nothing."""
LATE_US = 2_000
"""A command may be late by so much before the hand waits for it."""
HEARD_US = 4_000
"""Angles that were on the wire so long before a SYNC are those that its commands were made from."""
LOST_US = 200_000
"""A picture that is not felt for so long was lost: the hand's time goes on."""
GONE_US = 1_000_000
"""What is silent for longer is not slow: the hand's time goes on, and who listens will notice."""
TPDO_1, RPDO_1 = 0x180, 0x200

Stamped = tuple[int, CanFrame]


class Cameras(Protocol):
    """What draws the fingertips' pictures."""

    fps: list[float]

    def is_busy(self, finger: int) -> bool:
        """Whether its last picture is not drawn yet."""
        ...

    def expose(self, exposure: Exposure) -> None:
        """Begin a picture."""
        ...


class LiveHand:
    """`process` is one turn of it; `serve` does that on a bus until it is told to stop.

    Times are of the bus's clock in us, from CLOCK_MONOTONIC's zero. own_us: how far the hand's own time has
    gone; waited_us: what it waited meanwhile; waits: whether it does so now for something late; held_us: how
    far the clock is behind CLOCK_MONOTONIC; exposures: of all cameras. accept_ids: what it wants from the
    bus, with its own echoes.
    """

    def __init__(
        self,
        config: HandConfig,
        hand: HandKinematics,
        engine: Engine,
        cameras: Cameras,
        motion: MotionFile,
        now_us: int,
        unix_us: int,
    ) -> None:
        """unix_us: Unix time at now_us."""
        self.own_us = self.waited_us = self.held_us = self.exposures = 0
        self.waits = False
        self._hand, self._engine, self._cameras, self._motion = hand, engine, cameras, motion
        self._driven = DrivenHand(config, engine)
        self._wanted = [set(device.slave.accept_ids()) for device in self._driven.devices]
        self._device_due_us = [0] * len(self._driven.devices)
        self._step_us = round(engine.step_s * 1e6)
        self._period_us = [1e6 / fps for fps in cameras.fps]
        self._sequence = [0] * len(cameras.fps)
        self._exposure_us = [number / len(cameras.fps) * us for number, us in enumerate(self._period_us)]
        self._start_us, self._unix_us = now_us, unix_us - now_us
        # A command answers the angles of the SYNC before it, and holds until the next one.
        self._tick_us = round(1e6 / config.control.tick_Hz)
        self._lasts_us = 2 * self._tick_us + LATE_US
        self._commanded_us, self._heard_own_us, self._known_own_us = now_us, 0, 0
        self._command_id = RPDO_1 + config.joints[-1].drive_node  # the last of a tick's commands
        self._answers_id = TPDO_1 + config.joints[-1].drive_node  # the last of the answers to a SYNC
        self._tips = [Fingertip(finger.fingertip_node, finger.name) for finger in config.fingers]
        self._unfelt_us: list[int | None] = [None for _ in self._tips]  # the last picture, until felt
        self._felt_us = [now_us - GONE_US] * len(self._tips)
        self._finger_of = {can_id: i for i, tip in enumerate(self._tips) for can_id in tip.receive_ids}
        self.accept_ids = sorted({self._answers_id, *self._finger_of}.union(*self._wanted))
        self._echoes: deque[tuple[CanFrame, int]] = deque()  # sent when, and not back from the bus yet
        self._told: deque[tuple[int, int]] = deque()

    @property
    def pace(self) -> float:
        """The hand's own time over the machine's, since the start."""
        return self.own_us / max(1, self.own_us + self.waited_us + self.held_us)

    @property
    def _hand_us(self) -> int:
        """The clock's time at which the hand stands as it stands now."""
        return self._start_us + self.own_us + self.waited_us

    def process(self, now_us: int, frames: Sequence[Stamped]) -> tuple[list[CanFrame], int]:
        """Bring the hand to `now_us`; each frame meets it where it stood at the frame's stamp.

        Returns what the drives send, and when the next call is due. Raises BusError when another node has a
        drive's id.
        """
        sent: list[CanFrame] = []
        for stamp_us, batch in _by_tick(self._for_drives(now_us, frames)):
            self._advance(min(stamp_us, now_us))
            if batch[0].can_id == SYNC.can_id:
                self._note_command(stamp_us, now_us)
            self._driven.look()
            for index, wanted in enumerate(self._wanted):
                mine = [frame for frame in batch if frame.can_id in wanted]
                if mine:
                    sent += self._serve_device(index, mine)
            if any(frame.can_id == self._command_id for frame in batch):
                self._known_own_us = self._heard_own_us
        self._advance(now_us)
        due = [index for index, due_us in enumerate(self._device_due_us) if self.own_us >= due_us]
        if due:
            self._driven.look()
        for index in due:
            sent += self._serve_device(index, ())
        return sent, now_us + LOOK_US

    def serve(self, bus: Bus, stop: threading.Event, keeper: ClockKeeper | None) -> None:
        """keeper: of the bus's clock, None for CLOCK_MONOTONIC. Raises BusError when the bus is gone, or as
        `process`."""
        now_us = monotonic_us if keeper is None else keeper.now_us
        due_us = now_us()
        while not stop.is_set():
            received = bus.receive(max(0, due_us - now_us()) * 1e-6)
            ahead_us = unix_ahead_us()  # the bus stamps in Unix time
            sent, due_us = self.process(now_us(), [(stamp - ahead_us, frame) for stamp, frame in received])
            bus.send(sent)
            if keeper is not None:
                keeper.go_on(slowly=self.waits)
                self.held_us = keeper.held_us

    def _for_drives(self, now_us: int, frames: Sequence[Stamped]) -> list[Stamped]:
        """What others sent, without contacts. The last answer's echo tells when the host knew the angles."""
        others = []
        for stamp_us, frame in frames:
            if self._echoes and frame == self._echoes[0][0]:
                _, own_us = self._echoes.popleft()
                if frame.can_id == self._answers_id:
                    self._told.append((stamp_us, own_us))
            elif frame.can_id in self._finger_of:
                self._note_contact(self._finger_of[frame.can_id], stamp_us, now_us, frame)
            else:
                others.append((stamp_us, frame))
        return others

    def _note_contact(self, finger: int, stamp_us: int, now_us: int, frame: CanFrame) -> None:
        """Whether the last picture has come to the bus."""
        contact = self._tips[finger].receive(stamp_us + self._unix_us, frame)
        if contact is None:
            return
        self._felt_us[finger] = now_us
        unfelt_us = self._unfelt_us[finger]
        exposed_us = contact.exposed_at_us - self._unix_us  # by the board's clock, near enough
        if unfelt_us is not None and exposed_us > unfelt_us - 0.5 * self._period_us[finger]:
            self._unfelt_us[finger] = None

    def _serve_device(self, index: int, frames: Sequence[CanFrame]) -> tuple[CanFrame, ...]:
        """The drives live in the hand's own time: what it waits for is not late to them."""
        device = self._driven.devices[index]
        output = device.process(self.own_us, frames)
        own = [(frame, self.own_us) for frame in output.frames_out if frame.can_id in self.accept_ids]
        self._echoes.extend(own)
        refuse_conflict(device, output.events)
        self._device_due_us[index] = output.next_due_us
        return output.frames_out

    def _advance(self, until_us: int) -> None:
        """The hand and its cameras up to `until_us`, waiting where it must."""
        while self._hand_us + self._step_us <= until_us:
            lacks_a_command = self._lacks_a_command(until_us)
            if lacks_a_command or not self._have_seen(until_us):
                # A command that is not due yet comes by itself; for what is late the time is held back.
                self.waits = not lacks_a_command or until_us - self._commanded_us > self._tick_us + LATE_US
                self.waited_us += max(0, until_us - self._hand_us - SLACK_US)
                return
            self.waits = False
            self._driven.step()
            self.own_us += self._step_us
            if self.own_us % PERIOD_US == 0:
                self._motion.note(self._hand_us + self._unix_us, self._engine, self.held_us)

    def _note_command(self, stamp_us: int, now_us: int) -> None:
        """The host's SYNC of `stamp_us`: which angles the commands after it know."""
        self._commanded_us = now_us
        while self._told and self._told[0][0] + HEARD_US <= stamp_us:
            self._heard_own_us = self._told.popleft()[1]

    def _lacks_a_contact(self, finger: int, until_us: int) -> bool:
        unfelt_us = self._unfelt_us[finger]
        if unfelt_us is None or until_us - self._felt_us[finger] > GONE_US:
            return False
        return until_us - unfelt_us <= LOST_US

    def _lacks_a_command(self, until_us: int) -> bool:
        if not self._driven.is_powered or until_us - self._commanded_us > GONE_US:
            return False
        return self.own_us - self._known_own_us >= self._lasts_us

    def _have_seen(self, until_us: int) -> bool:
        """The cameras whose turn it is see the hand as it stands; False while one still draws its last
        picture, or that has not been felt."""
        due = [finger for finger, exposure_us in enumerate(self._exposure_us) if self.own_us >= exposure_us]
        if not due:
            return True
        if any(self._cameras.is_busy(finger) or self._lacks_a_contact(finger, until_us) for finger in due):
            return False
        touches = touches_in_F(self._engine, self._hand)
        for finger in due:
            self._cameras.expose(Exposure(finger, self._sequence[finger], self._hand_us, touches[finger]))
            self._unfelt_us[finger] = self._hand_us
            self._sequence[finger] += 1
            self._exposure_us[finger] += self._period_us[finger]
        self.exposures += len(due)
        return True


def _by_tick(frames: Sequence[Stamped]) -> Iterator[tuple[int, list[CanFrame]]]:
    """The frames in groups that begin with a SYNC (the first may lack it), each with its first stamp."""
    begins = [i for i, (_, frame) in enumerate(frames) if i == 0 or frame.can_id == SYNC.can_id]
    for begin, end in pairwise([*begins, len(frames)]):
        yield frames[begin][0], [frame for _, frame in frames[begin:end]]
