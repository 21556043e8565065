"""Simulated hand, object and drives in real time on a bus, with the fingertips' cameras in a second process.

Simulated time follows real time, but waits for three things: a frame that is still being rendered, the
contact of a finger's last frame before its next exposure, and joint commands that are based on recent joint
angles. Without waiting, late commands would end the grasp: the damping B of Eq. (10) acts through the bus, on
links that settle within 15 ms. While the simulation waits, the clock of everything on its bus nearly stops
(`simulated_clock.py`), so a slow machine only slows the simulation down.
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
from palpate_twin.closed_loop.live_cameras import Exposure
from palpate_twin.closed_loop.tactile_rendering import dome_contacts
from palpate_twin.hand.driven_hand import DrivenHand
from palpate_twin.hand.engine import Engine
from palpate_twin.hand.motion import PERIOD_US, MotionFile

UPDATE_PERIOD_US = 2_000
"""Longest time between two calls of `process`."""
LARGEST_LAG_US = 8_000
"""Lag behind the clock that the simulation still catches up; shorter waits therefore cost no time."""
COMMAND_TOLERANCE_US = 2_000
"""Delay of a command beyond its tick before the simulation waits for it."""
HOST_LATENCY_US = 4_000
"""Joint angles that were on the bus for this long before a SYNC are the ones its commands are based on."""
CONTACT_TIMEOUT_US = 200_000
"""A frame without a contact after this time is taken as lost, and the simulation continues."""
PEER_TIMEOUT_US = 1_000_000
"""A host or fingertip silent for longer is not waited for, so that its peers can detect its failure."""
TPDO_1, RPDO_1 = 0x180, 0x200

Stamped = tuple[int, CanFrame]


class Cameras(Protocol):
    """Renderer of the fingertips' frames."""

    fps: list[float]

    def is_busy(self, finger: int) -> bool:
        """Return whether a frame of this camera is being rendered."""
        ...

    def expose(self, exposure: Exposure) -> None:
        """Start rendering a frame."""
        ...


class LiveHand:
    """The simulated hand on a bus: `process` advances it, `serve` does so in real time.

    Times are on the bus clock in us, from the zero of CLOCK_MONOTONIC. simulated_us: simulated time so far;
    waited_us: time spent waiting; is_waiting: the simulation waits for something that is late; held_us: lag
    of the bus clock behind CLOCK_MONOTONIC; exposures: number of all cameras' exposures. accept_ids:
    identifiers to receive, including the hand's own frames.
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
        """Start at `now_us`, which is `unix_us` in Unix time."""
        self.simulated_us = self.waited_us = self.held_us = self.exposures = 0
        self.is_waiting = False
        self._hand, self._engine, self._cameras, self._motion = hand, engine, cameras, motion
        self._driven = DrivenHand(config, engine)
        # A node with several axes has its PDOs enabled by the host, later than now.
        self._device_ids = [
            {RPDO_1 + device.slave.node_id, TPDO_1 + device.slave.node_id, *device.slave.accept_ids()}
            for device in self._driven.devices
        ]
        self._device_due_us = [0] * len(self._driven.devices)
        self._step_us = round(engine.step_s * 1e6)
        self._start_us, self._unix_us = now_us, unix_us - now_us
        # Cameras: simulated time of the next exposure, and the last exposure until its contact is published.
        self._period_us = [1e6 / fps for fps in cameras.fps]
        self._sequence = [0] * len(cameras.fps)
        self._exposure_us = [number / len(cameras.fps) * us for number, us in enumerate(self._period_us)]
        fd = config.bus.data_bitrate is not None
        self._tips = [Fingertip(finger.fingertip_node, finger.name, fd=fd) for finger in config.fingers]
        self._pending_us: list[int | None] = [None for _ in self._tips]
        self._contact_us = [now_us - PEER_TIMEOUT_US] * len(self._tips)
        self._finger_of = {can_id: i for i, tip in enumerate(self._tips) for can_id in tip.receive_ids}
        # A command is based on the joint angles of the SYNC before it, and holds until the next one.
        self._tick_us = round(1e6 / config.control.tick_Hz)
        self._command_lifetime_us = 2 * self._tick_us + COMMAND_TOLERANCE_US
        self._sync_us, self._host_angles_us, self._command_angles_us = now_us, 0, 0
        self._last_command_id = RPDO_1 + config.joints[-1].drive_node
        self._last_response_id = TPDO_1 + config.joints[-1].drive_node
        self.accept_ids = sorted({self._last_response_id, *self._finger_of}.union(*self._device_ids))
        self._echoes: deque[tuple[CanFrame, int]] = (
            deque()
        )  # sent frames not yet received back, time of sending
        self._published: deque[tuple[int, int]] = (
            deque()
        )  # joint angles on the bus: time stamp, simulated time

    @property
    def pace(self) -> float:
        """Simulated time over real time since the start."""
        return self.simulated_us / max(1, self.simulated_us + self.waited_us + self.held_us)

    @property
    def _hand_us(self) -> int:
        """Bus time of the hand's current state."""
        return self._start_us + self.simulated_us + self.waited_us

    def process(self, now_us: int, frames: Sequence[Stamped]) -> tuple[list[CanFrame], int]:
        """Advance the hand to `now_us`; each received frame acts at its time stamp.

        Returns the frames to send and the time of the next call. Raises BusError if another node uses the
        node id of a drive.
        """
        sent: list[CanFrame] = []
        for stamp_us, batch in _by_tick(self._for_drives(now_us, frames)):
            self._advance(min(stamp_us, now_us))
            if batch[0].can_id == SYNC.can_id:
                self._receive_sync(stamp_us, now_us)
            self._driven.read_joints()
            for index, accepted in enumerate(self._device_ids):
                received = [frame for frame in batch if frame.can_id in accepted]
                if received:
                    sent += self._serve_device(index, received)
            if any(frame.can_id == self._last_command_id for frame in batch):
                self._command_angles_us = self._host_angles_us
        self._advance(now_us)
        due = [index for index, due_us in enumerate(self._device_due_us) if self.simulated_us >= due_us]
        if due:
            self._driven.read_joints()
        for index in due:
            sent += self._serve_device(index, ())
        return sent, now_us + UPDATE_PERIOD_US

    def serve(self, bus: Bus, stop: threading.Event, keeper: ClockKeeper | None) -> None:
        """Run on a bus until `stop` is set. keeper: of the bus clock, None for CLOCK_MONOTONIC.

        Raises BusError if the bus is lost, and as `process`.
        """
        now_us = monotonic_us if keeper is None else keeper.now_us
        due_us = now_us()
        while not stop.is_set():
            received = bus.receive(max(0, due_us - now_us()) * 1e-6)
            ahead_us = unix_ahead_us()  # time stamps on the bus are in Unix time
            sent, due_us = self.process(now_us(), [(stamp - ahead_us, frame) for stamp, frame in received])
            bus.send(sent)
            if keeper is not None:
                keeper.go_on(slowly=self.is_waiting)
                self.held_us = keeper.held_us

    def _for_drives(self, now_us: int, frames: Sequence[Stamped]) -> list[Stamped]:
        """Return the frames of other nodes, without contacts, which are processed here.

        The hand's own last response shows when the joint angles were on the bus.
        """
        others = []
        for stamp_us, frame in frames:
            if self._echoes and frame == self._echoes[0][0]:
                _, simulated_us = self._echoes.popleft()
                if frame.can_id == self._last_response_id:
                    self._published.append((stamp_us, simulated_us))
            elif frame.can_id in self._finger_of:
                self._receive_contact(self._finger_of[frame.can_id], stamp_us, now_us, frame)
            else:
                others.append((stamp_us, frame))
        return others

    def _receive_contact(self, finger: int, stamp_us: int, now_us: int, frame: CanFrame) -> None:
        """Clear the pending exposure when its contact is complete."""
        contact = self._tips[finger].receive(stamp_us + self._unix_us, frame)
        if contact is None:
            return
        self._contact_us[finger] = now_us
        pending_us = self._pending_us[finger]
        exposed_us = contact.exposed_at_us - self._unix_us  # on the fingertip's clock, hence the tolerance
        if pending_us is not None and exposed_us > pending_us - 0.5 * self._period_us[finger]:
            self._pending_us[finger] = None

    def _serve_device(self, index: int, frames: Sequence[CanFrame]) -> tuple[CanFrame, ...]:
        """Run a drive on simulated time, so that nothing is late for it while the simulation waits."""
        device = self._driven.devices[index]
        output = device.process(self.simulated_us, frames)
        echoed = [frame for frame in output.frames_out if frame.can_id in self.accept_ids]
        self._echoes.extend((frame, self.simulated_us) for frame in echoed)
        refuse_conflict(device, output.events)
        self._device_due_us[index] = output.next_due_us
        return output.frames_out

    def _advance(self, until_us: int) -> None:
        """Advance hand and cameras to `until_us`, or until something has to be waited for."""
        while self._hand_us + self._step_us <= until_us:
            needs_command = self._needs_command(until_us)
            if needs_command or not self._expose_due_cameras(until_us):
                # A command that is not due yet arrives by itself; the clock is held only for what is late.
                late_us = self._tick_us + COMMAND_TOLERANCE_US
                self.is_waiting = not needs_command or until_us - self._sync_us > late_us
                self.waited_us += max(0, until_us - self._hand_us - LARGEST_LAG_US)
                return
            self.is_waiting = False
            self._driven.step()
            self.simulated_us += self._step_us
            if self.simulated_us % PERIOD_US == 0:
                self._motion.write(self._hand_us + self._unix_us, self._engine, self.held_us)

    def _receive_sync(self, stamp_us: int, now_us: int) -> None:
        """Note which joint angles the commands after the host's SYNC at `stamp_us` are based on."""
        self._sync_us = now_us
        while self._published and self._published[0][0] + HOST_LATENCY_US <= stamp_us:
            self._host_angles_us = self._published.popleft()[1]

    def _needs_contact(self, finger: int, until_us: int) -> bool:
        """Return whether the contact of the finger's last frame has to be waited for."""
        pending_us = self._pending_us[finger]
        if pending_us is None or until_us - self._contact_us[finger] > PEER_TIMEOUT_US:
            return False
        return until_us - pending_us <= CONTACT_TIMEOUT_US

    def _needs_command(self, until_us: int) -> bool:
        """Return whether a command based on newer joint angles has to be waited for."""
        if not self._driven.is_powered or until_us - self._sync_us > PEER_TIMEOUT_US:
            return False
        return self.simulated_us - self._command_angles_us >= self._command_lifetime_us

    def _expose_due_cameras(self, until_us: int) -> bool:
        """Expose the cameras that are due.

        Return False if one of them still renders its last frame, or if that frame's contact is missing.
        """
        now_us = self.simulated_us
        due = [finger for finger, exposure_us in enumerate(self._exposure_us) if now_us >= exposure_us]
        if not due:
            return True
        if any(self._cameras.is_busy(finger) or self._needs_contact(finger, until_us) for finger in due):
            return False
        contacts = dome_contacts(self._engine, self._hand)
        for finger in due:
            self._cameras.expose(Exposure(finger, self._sequence[finger], self._hand_us, contacts[finger]))
            self._pending_us[finger] = self._hand_us
            self._sequence[finger] += 1
            self._exposure_us[finger] += self._period_us[finger]
        self.exposures += len(due)
        return True


def _by_tick(frames: Sequence[Stamped]) -> Iterator[tuple[int, list[CanFrame]]]:
    """Yield groups of frames that begin with a SYNC (the first may lack it), each with its first stamp."""
    begins = [i for i, (_, frame) in enumerate(frames) if i == 0 or frame.can_id == SYNC.can_id]
    for begin, end in pairwise([*begins, len(frames)]):
        yield frames[begin][0], [frame for _, frame in frames[begin:end]]
