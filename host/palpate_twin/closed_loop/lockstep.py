"""The closed loop in one process on simulated time: hand, object, fingertips, drives and host on one bus.

Apart from the physics engine, all parts are the real ones: the host core, the fingertips' CANopen nodes, the
drives' CiA 402 slaves, and every CAN frame between them. Time advances by the engine's step. Nothing depends
on the machine's speed, so the same arguments give the same bits.
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
from palpate_host.common.gait_plan import GaitRefusedError
from palpate_host.common.mode import Mode
from palpate_host.common.status import HostStatus
from palpate_host.common.tick_inputs import Planned
from palpate_host.config.hand_config import HandConfig, StartMode
from palpate_host.control.damping_stability import check_damping
from palpate_host.control.gait.turn_request import TurnRequest, plan_of
from palpate_host.control.kinematics import HandKinematics
from palpate_host.drives.cia402_device import DriveNode
from palpate_host.network.nmt_master import SYNC
from palpate_host.service.bus_load_check import check_bus_load
from palpate_host.service.host_core import HostCore
from palpate_twin.closed_loop.tactile_rendering import ContactSource, dome_contacts
from palpate_twin.hand.driven_hand import DrivenHand
from palpate_twin.hand.engine import Engine, LostGraspError

START_US = 1_700_000_000_000_000
FRAME_PERIOD_US = 33_333
DELAY_US = 40_000
"""Usual time from a frame's exposure to its contact in the node: half the exposure, read-out and estimate."""
FILM_PERIOD_US = 500_000
PLAN_US = 1_000_000
"""Time from a turn's request to its plan; a planner needs some seconds, which change nothing here."""
WIRE_US = 130
"""Duration of a CAN frame of 8 bytes with stuff bits at 1 Mbit/s."""


@dataclass(frozen=True, slots=True)
class Sample:
    """One host tick: simulated seconds since the start, the host's mode, the object's pose (3, 3), (3,)."""

    time_s: float
    mode: Mode
    object_rotation: Array
    object_position_m: Array


@dataclass(slots=True)
class LoopRecord:
    """Recorded data of a run.

    contacts: finger, published contact and true position on the dome (None without contact) of each frame.
    film: MuJoCo's qpos every half second from the start.
    """

    samples: list[Sample] = field(default_factory=list)
    contacts: list[tuple[int, Contact, Array | None]] = field(default_factory=list)
    film: list[Array] = field(default_factory=list)
    bus_frames: int = 0
    failure: str = ""


class LockstepLoop:
    """All parts on one simulated bus.

    status: newest status of the host; planned: newest plan that it got; is_over: the host has stopped.
    """

    def __init__(
        self,
        config: HandConfig,
        hand: HandKinematics,
        engine: Engine,
        contact_source: ContactSource,
        has_weight: bool = False,
        on_frame: Callable[[int, CanFrame], None] = lambda _stamp_us, _frame: None,
        on_step: Callable[[int], None] = lambda _now_us: None,
        on_tick: Callable[[HostStatus], None] = lambda _status: None,
        delay_us: int = DELAY_US,
    ) -> None:
        """Connect the parts. Raises ConfigError when the hand's frames do not fit on the bus, or its tick is
        too slow for the joints' damping.

        has_weight: the object's support is removed when the host begins to turn the object. on_frame: called
        with each CAN frame and the time at which its transmission ends. on_step: called before each step.
        on_tick: called with the host's status after each tick. delay_us: time from a frame's exposure to its
        contact in the node.
        """
        check_bus_load(config)
        check_damping(config, hand)
        self._is_supported = has_weight
        self._config = config
        self._request: TurnRequest | None = None
        self._planned_us = 0
        self.planned: Planned | None = None
        self.engine, self.record = engine, LoopRecord()
        self._hand, self._contact_source = hand, contact_source
        self._on_frame, self._on_step, self._on_tick = on_frame, on_step, on_tick
        self._delay_us = delay_us
        self._radius_mm = 1e3 * config.control.tip_radius_m
        self.host = HostCore(config.starting(StartMode.AUTO), hand)
        self.status: HostStatus | None = None
        self._driven = DrivenHand(config, engine)
        self._tips = [
            FingertipNode(
                f.fingertip_node,
                MethodCode.CORRECTED,
                f.calibration or "0" * 16,
                stores=False,
                data_bitrate=config.bus.data_bitrate,
            )
            for f in config.fingers
        ]
        self._nodes: list[DriveNode | FingertipNode] = [*self._driven.devices, *self._tips]
        self._due_us = [START_US] * len(self._nodes)
        self._now_us = START_US
        self.is_over = False
        self._wire: deque[tuple[int, CanFrame, bool]] = deque()
        self._wire_free_us = START_US
        fingers = len(config.fingers)
        self._exposure = [START_US + finger * FRAME_PERIOD_US // fingers for finger in range(fingers)]
        self._sequence = [0] * fingers
        self._pending: deque[tuple[int, int, Contact]] = deque()

    def run(self, duration_s: float) -> LoopRecord:
        """Simulate `duration_s`, less if the host stops the hand."""
        end_us = self._now_us + round(duration_s * 1e6)
        while self._now_us < end_us and not self.is_over:
            self.is_over = self._step()
        return self.record

    def run_until(self, is_there: Callable[[HostStatus], bool], longest_s: float) -> LoopRecord:
        """Simulate until a tick's status is as wanted, `longest_s` at most."""
        end_us = self._now_us + round(longest_s * 1e6)
        while self._now_us < end_us and not self.is_over:
            if self.status is not None and is_there(self.status):
                break
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
            self._driven.read_joints()
        for index, node in enumerate(self._nodes):
            if to_nodes or now_us >= self._due_us[index]:
                sent = node.process(now_us, to_nodes)
                self._due_us[index] = sent.next_due_us
                self._send(now_us, sent.frames_out, from_host=False)
        output = self.host.process(now_us, to_host)
        self._send(now_us, output.frames_out, from_host=True)
        self._plan(now_us)
        self.status = output.status
        if output.ticked and output.status is not None:
            self._on_tick(output.status)
        if output.frames_out and output.status is not None:
            seconds = (now_us - START_US) * 1e-6
            mode = output.status.mode
            self.record.samples.append(
                Sample(seconds, mode, engine.object_rotation, engine.object_position_m)
            )
            if self._is_supported and mode is Mode.MANIPULATE:
                engine.remove_support()
                self._is_supported = False
        self.record.failure = output.failure
        self._driven.step()
        self._now_us += round(engine.step_s * 1e6)
        return output.finished

    def _plan(self, now_us: int) -> None:
        """Plan a requested turn; the host gets the plan PLAN_US after its request."""
        request = self.host.turn_request
        if request is not self._request:
            self._request, self._planned_us = request, now_us + PLAN_US
        if request is None or now_us < self._planned_us:
            return
        try:
            self.planned = Planned(plan_of(request, self._hand, self._config))
        except GaitRefusedError as error:
            self.planned = Planned(None, str(error))
        self.host.planned(self.planned)

    def _send(self, now_us: int, frames: Sequence[CanFrame], from_host: bool) -> None:
        """Transmit frames one after the other."""
        for frame in frames:
            self._wire_free_us = max(self._wire_free_us, now_us) + WIRE_US
            self._wire.append((self._wire_free_us, frame, from_host))
            self._on_frame(self._wire_free_us, frame)
            self.record.bus_frames += 1

    def _arrived(self, now_us: int) -> tuple[list[CanFrame], list[tuple[int, CanFrame]]]:
        """Return the frames that nodes and host have received; the host also receives its own SYNC."""
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
        """Expose each camera that is due; its contact reaches the node delay_us later."""
        due = [finger for finger, exposure_us in enumerate(self._exposure) if now_us >= exposure_us]
        if not due:
            return
        truths = dome_contacts(self.engine, self._hand)
        for finger in due:
            truth = truths[finger]
            contact = self._contact_source.contact(finger, truth, now_us, self._sequence[finger])
            true_mm = None if truth is None else truth.on_dome_mm(self._radius_mm)
            self.record.contacts.append((finger, contact, true_mm))
            self._pending.append((now_us, finger, contact))
            self._sequence[finger] += 1
            self._exposure[finger] += FRAME_PERIOD_US

    def _publish(self, now_us: int) -> None:
        while self._pending and self._pending[0][0] + self._delay_us <= now_us:
            exposed_us, finger, contact = self._pending.popleft()
            self._tips[finger].publish(contact, now_us - exposed_us)
            self._due_us[self._nodes.index(self._tips[finger])] = now_us


def final_error_deg(record: LoopRecord, rpy_deg: tuple[float, float, float]) -> tuple[float, Array]:
    """Return the final angle between true and desired orientation, and roll, pitch, yaw (n, 3) over time.

    Both are relative to the orientation in the first tick that turns the object.
    """
    turning = turning_samples(record)
    start = turning[0].object_rotation
    rpy = np.array([rotation.to_rpy_deg(sample.object_rotation @ start.T) for sample in turning])
    goal = rotation.from_rpy_deg(*rpy_deg) @ start
    return rotation.angle_deg(goal @ turning[-1].object_rotation.T), rpy


def turning_samples(record: LoopRecord) -> list[Sample]:
    """Return the samples from the first tick that turns the object; LostGraspError if there is none."""
    turning = (Mode.MANIPULATE, Mode.BLIND)
    first = next((i for i, sample in enumerate(record.samples) if sample.mode in turning), None)
    if first is None:
        raise LostGraspError(
            f"the host never turned the object ({record.failure or 'no contact, or the run is too short'}):"
            " increase --seconds, or correct the start pose in hand.toml"
        )
    return record.samples[first:]
