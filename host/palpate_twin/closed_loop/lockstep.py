"""The closed loop in one process on a virtual clock: hand, object, fingertips, drives and host, on one bus.

Everything but the physics is what runs as a process elsewhere: the host's core, the fingertips' CANopen
nodes, the drives' CiA 402 slaves, and every frame between them. Time goes on in steps of the engine; nothing
waits, nothing depends on the machine: the same arguments give the same bits.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.arrays import Array
from palpate_edge.common.contact import Contact
from palpate_edge.node.fingertip import FingertipNode
from palpate_edge.node.fingertip_objects import MethodCode
from palpate_host.common import rotation
from palpate_host.common.mode import Mode
from palpate_host.common.status import HostStatus
from palpate_host.config.hand_config import HandConfig
from palpate_host.control.kinematics import HandKinematics
from palpate_host.drives.cia402_device import Cia402Device
from palpate_host.network.nmt_master import SYNC
from palpate_host.service.host_core import HostCore
from palpate_twin.closed_loop.fingertip_feel import Feel, touches_in_F
from palpate_twin.hand.driven_hand import DrivenHand
from palpate_twin.hand.engine import Engine, LostGraspError

START_US = 1_700_000_000_000_000
FRAME_PERIOD_US = 33_333
DELAY_US = 40_000
"""From a frame's exposure to its contact in the node: half a frame of exposure, read-out, the estimate."""
FILM_PERIOD_US = 500_000
WIRE_US = 130
"""A frame of 8 bytes with its stuff bits at 1 Mbit/s."""


@dataclass(frozen=True, slots=True)
class Sample:
    """One host tick: virtual seconds since the start, the host's mode, the object's pose (3, 3) and (3,)."""

    time_s: float
    mode: Mode
    object_rotation: Array
    object_position_m: Array


@dataclass(slots=True)
class LoopRecord:
    """contacts: (finger, what was published, the true point on the dome or None). film: MuJoCo's qpos, every
    half second from the start."""

    samples: list[Sample] = field(default_factory=list)
    contacts: list[tuple[int, Contact, Array | None]] = field(default_factory=list)
    film: list[Array] = field(default_factory=list)
    bus_frames: int = 0
    failure: str = ""


class LockstepLoop:
    """Everything on one virtual bus; `run` moves it on. status: the host's newest; is_over: stopped."""

    def __init__(
        self,
        config: HandConfig,
        hand: HandKinematics,
        engine: Engine,
        feel: Feel,
        has_weight: bool = False,
        on_frame: Callable[[int, CanFrame], None] = lambda _stamp_us, _frame: None,
        on_step: Callable[[int], None] = lambda _now_us: None,
    ) -> None:
        """has_weight: when the host begins to turn the object, what it stood on is taken away. on_frame: sees
        each frame with the time at which it is over the wire; on_step: called before each step."""
        self._is_supported = has_weight
        self.engine, self.record = engine, LoopRecord()
        self._hand, self._feel = hand, feel
        self._on_frame, self._on_step = on_frame, on_step
        self._radius_mm = 1e3 * config.control.tip_radius_m
        self.host = HostCore(config, hand)
        self.status: HostStatus | None = None
        self._driven = DrivenHand(config, engine)
        self._tips = [FingertipNode(f.fingertip_node, MethodCode.CORRECTED, "0" * 16) for f in config.fingers]
        self._nodes: list[Cia402Device | FingertipNode] = [*self._driven.devices, *self._tips]
        self._due_us = [START_US] * len(self._nodes)
        self._now_us = START_US
        self.is_over = False
        self._wire: deque[tuple[int, CanFrame, bool]] = deque()
        self._wire_free_us = START_US
        self._exposure = [START_US + finger * FRAME_PERIOD_US // 3 for finger in range(3)]
        self._sequence = [0, 0, 0]
        self._pending: deque[tuple[int, int, Contact]] = deque()

    def run(self, duration_s: float) -> LoopRecord:
        """Move on; ends early when the host has stopped the hand."""
        end_us = self._now_us + round(duration_s * 1e6)
        while self._now_us < end_us and not self.is_over:
            self.is_over = self._step()
        return self.record

    def _step(self) -> bool:
        engine, now_us = self.engine, self._now_us
        self._on_step(now_us)
        if now_us >= START_US + len(self.record.film) * FILM_PERIOD_US:
            self.record.film.append(np.array(engine.data.qpos))
        to_nodes, to_host = self._arrived(now_us)
        self._expose(now_us)
        self._publish(now_us)
        if to_nodes or now_us >= min(self._due_us):
            self._driven.look()
        for index, node in enumerate(self._nodes):
            if to_nodes or now_us >= self._due_us[index]:
                answer = node.process(now_us, to_nodes)
                self._due_us[index] = answer.next_due_us
                self._send(now_us, answer.frames_out, from_host=False)
        output = self.host.process(now_us, to_host)
        self._send(now_us, output.frames_out, from_host=True)
        self.status = output.status
        if output.frames_out and output.status is not None:
            seconds = (now_us - START_US) * 1e-6
            mode = output.status.mode
            self.record.samples.append(
                Sample(seconds, mode, engine.object_rotation, engine.object_position_m)
            )
            if self._is_supported and mode is Mode.MANIPULATE:
                engine.take_support_away()
                self._is_supported = False
        self.record.failure = output.failure
        self._driven.step()
        self._now_us += round(engine.step_s * 1e6)
        return output.finished

    def _send(self, now_us: int, frames: Sequence[CanFrame], from_host: bool) -> None:
        """Onto the wire, one after the other."""
        for frame in frames:
            self._wire_free_us = max(self._wire_free_us, now_us) + WIRE_US
            self._wire.append((self._wire_free_us, frame, from_host))
            self._on_frame(self._wire_free_us, frame)
            self.record.bus_frames += 1

    def _arrived(self, now_us: int) -> tuple[list[CanFrame], list[tuple[int, CanFrame]]]:
        """What nodes and host receive until now; the host hears its own SYNC."""
        to_nodes: list[CanFrame] = []
        to_host: list[tuple[int, CanFrame]] = []
        while self._wire and self._wire[0][0] <= now_us:
            stamp_us, frame, from_host = self._wire.popleft()
            if from_host:
                to_nodes.append(frame)
            if not from_host or frame == SYNC:
                to_host.append((stamp_us, frame))
        return to_nodes, to_host

    def _expose(self, now_us: int) -> None:
        """A frame of each fingertip that is due, taken now, known to the node DELAY_US later."""
        due = [finger for finger in range(3) if now_us >= self._exposure[finger]]
        if not due:
            return
        touches = touches_in_F(self.engine, self._hand)
        for finger in due:
            touch = touches[finger]
            contact = self._feel.contact(finger, touch, now_us, self._sequence[finger])
            truth = None if touch is None else touch.on_dome_mm(self._radius_mm)
            self.record.contacts.append((finger, contact, truth))
            self._pending.append((now_us, finger, contact))
            self._sequence[finger] += 1
            self._exposure[finger] += FRAME_PERIOD_US

    def _publish(self, now_us: int) -> None:
        while self._pending and self._pending[0][0] + DELAY_US <= now_us:
            exposed_us, finger, contact = self._pending.popleft()
            self._tips[finger].publish(contact, now_us - exposed_us)
            self._due_us[self._nodes.index(self._tips[finger])] = now_us


def missing_turn_deg(record: LoopRecord, rpy_deg: tuple[float, float, float]) -> tuple[float, Array]:
    """Angle between the object and where it should be at the end, and its roll, pitch, yaw (n, 3) since the
    host began to turn it; the start is the first tick in MANIPULATE."""
    turning = turning_samples(record)
    start = turning[0].object_rotation
    rpy = np.array([rotation.to_rpy_deg(sample.object_rotation @ start.T) for sample in turning])
    goal = rotation.from_rpy_deg(*rpy_deg) @ start
    return rotation.angle_deg(goal @ turning[-1].object_rotation.T), rpy


def turning_samples(record: LoopRecord) -> list[Sample]:
    """From the first tick in which the host turned the object. LostGraspError when it never did."""
    turning = (Mode.MANIPULATE, Mode.BLIND)
    first = next((i for i, sample in enumerate(record.samples) if sample.mode in turning), None)
    if first is None:
        raise LostGraspError(
            f"the host never turned the object ({record.failure or 'no contact, or too short a run'}):"
            " give more --seconds, or correct the start pose in hand.toml"
        )
    return record.samples[first:]
