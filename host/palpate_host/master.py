"""The host's core: every frame of the bus in, every frame of the host out, on the time it is given.

One tick at tick_Hz: SYNC, supervisor, torques, one command a drive. Frames are taken in with their own stamps
and answered at the next tick, so that what leaves depends on stamps and ticks alone and a log replays
exactly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from palpate_edge.can_frame import CanFrame
from palpate_edge.errors import BusError
from palpate_edge.node.emcy import is_temperature
from palpate_host import rotation, runaway
from palpate_host.command import Command, CommandError, Grasp, Recover, Release, Rotate, Stop
from palpate_host.drives.drive_group import DriveGroup
from palpate_host.drives.joint_command import DriveGoal
from palpate_host.finger_record import FingerRecord
from palpate_host.fingertips import TipContact
from palpate_host.hand import Hand, HandPose
from palpate_host.hand_config import ControlMode, HandConfig, StartMode
from palpate_host.joint_history import JointHistory
from palpate_host.manipulation import Manipulation
from palpate_host.network import (
    EMCY_ID,
    HEARTBEAT_ID,
    NMT_ID,
    SYNC,
    Network,
    TimeStampProducer,
    foreign_stop,
)
from palpate_host.power_down import PowerDown
from palpate_host.rotation import Array
from palpate_host.status import Counters, HostStatus, matrix
from palpate_host.supervisor import (
    MOVING,
    STOPPED,
    Decision,
    Inputs,
    Mode,
    Tiers,
    Wish,
    decide,
)
from palpate_host.tick_schedule import TickSchedule
from palpate_host.virtual_frame import FrameError, check_numbering, virtual_frame

EXPOSURE_AHEAD_LIMIT_US = 50_000

OPERATOR_STOP = "stopped by the operator"
NMT_STOP = "stopped by another NMT master"


@dataclass(frozen=True, slots=True)
class Output:
    """What one call of `process` gives.

    ticked: a tick was due, whether or not there is a bus for its frames. next_due_us: when to call again at
    the latest. finished: the hand is stopped and safe, the loop may end;
    failure then says why in one line, empty after an operator's stop.
    """

    frames_out: tuple[CanFrame, ...]
    ticked: bool
    next_due_us: int
    status: HostStatus | None
    finished: bool
    failure: str


class HostCore:
    """The pure host: hand it frames and times, send what it returns."""

    def __init__(self, config: HandConfig, hand: Hand) -> None:
        """FrameError when the fingers are numbered clockwise, with every joint in the middle of its range."""
        middle = np.array([(joint.min_rad + joint.max_rad) / 2 for joint in config.joints])
        check_numbering(hand.pose(middle).tip_centre_m)
        self._config = config
        self._hand = hand
        self._tick_us = 1_000_000 // config.control.tick_Hz
        self._schedule = TickSchedule(self._tick_us)
        network, s = config.network, config.staleness
        self._network = Network(
            config.node_names,
            network.host_node,
            network.heartbeat_ms * 1000,
            network.heartbeat_timeout_ms * 1000,
        )
        self._time_stamps = TimeStampProducer()
        self._tiers = Tiers(
            warn_us=s.warn_ms * 1000,
            freeze_us=s.freeze_ms * 1000,
            hold_us=s.hold_ms * 1000,
            stop_us=s.stop_ms * 1000,
            settle_us=config.control.settle_ms * 1000,
            release_us=config.control.release_ms * 1000,
        )
        self._waits_for_commands = config.run.start is StartMode.COMMAND
        self._drives = DriveGroup(config)
        self._fingers = [FingerRecord(f.name, f.fingertip_node) for f in config.fingers]
        self._finger_by_id = {
            can_id: i for i, finger in enumerate(self._fingers) for can_id in finger.tip.receive_ids
        }
        self._history = JointHistory(config.control.tick_Hz)
        self._control = Manipulation(config)
        self._target_rpy_deg = config.target.rpy_deg
        self._wish = Wish.NOTHING if self._waits_for_commands else Wish.TURN
        self._decision = Decision(Mode.INIT, "starting", 0)
        self._last_sync_us: int | None = None
        self._stop_reason = self._fault = ""
        self._leaves = False
        self._is_away = False  # the bus
        self._bus_fault = ""
        self._back_us = 0
        self._command_Nm = np.zeros(len(config.joints))
        self._R_vir: Array | None = None
        self._power_down = PowerDown()
        self._finished = False
        self._last_emergency = ""
        self._counters = Counters()
        self._status: HostStatus | None = None

    @property
    def accept_ids(self) -> tuple[int, ...]:
        """The identifiers this core wants from the bus: for filters, and to pick its inputs from a log.

        Its own SYNC is one of them: the bus's stamp of it is what 1013h tells.
        """
        nodes = self._config.node_names
        beats = [HEARTBEAT_ID + node for node in nodes]
        emergencies = [EMCY_ID + node for node in nodes]
        others = [NMT_ID, SYNC.can_id, *beats, *emergencies]
        return tuple(sorted([*others, *self._drives.receive_ids, *self._finger_by_id]))

    def request_stop(self, reason: str = OPERATOR_STOP) -> None:
        """Stop at the next tick and finish: quick stop, drives off, NMT stop. The first reason stays."""
        self._leaves = True
        self._stop_reason = self._stop_reason or reason

    def lose_bus(self, now_us: int, reason: str) -> None:
        """The bus is gone: FAULT, no frames until `regain_bus`, and what the nodes said counts no more.

        An earlier fault or stop keeps its reason; this one is its warning while the bus is away.
        """
        self._is_away = True
        self._bus_fault = self._bus_fault or reason
        if self._decision.mode in STOPPED:
            self._decision = replace(self._decision, warning=reason)
        else:
            self._decision = Decision(Mode.FAULT, reason, now_us)
        self._time_stamps = TimeStampProducer()
        self._last_sync_us = self._R_vir = None
        self._command_Nm = np.zeros_like(self._command_Nm)
        self._history = JointHistory(self._config.control.tick_Hz)
        self._drives.forget()
        for finger in self._fingers:
            finger.forget()

    def regain_bus(self, now_us: int) -> None:
        """The bus is there again: every drive is switched off, as nobody knows what it did meanwhile, and
        `Recover` leads on. What was stamped before does not count."""
        self._is_away = False
        self._back_us = now_us
        self._decision = replace(self._decision, warning="")

    def command(self, command: Command) -> None:
        """Obey from the next tick on.

        CommandError, saying what to do first, when the mode does not allow it.
        """
        mode = self._decision.mode
        match command:
            case Stop():
                self._stop_reason = self._stop_reason or OPERATOR_STOP
            case Recover():
                self._recover(mode)
            case Grasp():
                if mode not in (Mode.READY, *MOVING):
                    raise _refusal("grasp", self._decision)
                self._wish = Wish.GRASP
                self._control.rest()
            case Rotate(rpy_deg=rpy_deg, ramp_s=ramp_s):
                if mode not in MOVING or self._wish is Wish.NOTHING:
                    raise _refusal("rotate", self._decision, "grasp first")
                self._wish = Wish.TURN
                self._target_rpy_deg = rpy_deg
                self._control.turn(rpy_deg, self._config.target.ramp_s if ramp_s is None else ramp_s)
            case Release():
                if mode not in (Mode.READY, *MOVING):
                    raise _refusal("release", self._decision)
                self._wish = Wish.NOTHING
                self._control = Manipulation(self._config)

    def _recover(self, mode: Mode) -> None:
        """Out of FAULT and STOP, once no drive has power: all nodes anew, nothing wished for."""
        if mode not in STOPPED or self._leaves:
            raise _refusal("recover", self._decision, "there is nothing to recover from")
        if self._is_away:
            raise _refusal("recover", self._decision, "the bus is away, it is opened again by itself")
        if not self._power_down.is_off:
            raise _refusal("recover", self._decision, "the drives are still stopping, try again")
        self._stop_reason = self._fault = self._bus_fault = self._last_emergency = ""
        self._wish = Wish.NOTHING
        self._power_down = PowerDown()
        self._control = Manipulation(self._config)
        self._history = JointHistory(self._config.control.tick_Hz)
        self._network.restart()
        for node_id in self._config.node_names:
            self._booted(node_id)
        for finger in self._fingers:
            finger.forget()
        self._decision = Decision(Mode.INIT, "recovering", self._decision.since_us)

    def process(self, now_us: int, frames_in: Sequence[tuple[int, CanFrame]]) -> Output:
        """Take in stamped frames and, when a tick is due, give the host's frames for it.

        A tick that is more than one period late is left out and counted. Never raises for what comes from the
        bus: a frame that breaks the contract stops the hand, and its reason is the output's failure.
        """
        for stamp_us, frame in frames_in:
            self._counters.frames_in += 1
            if self._is_away or stamp_us < self._back_us:
                continue
            try:
                self._receive(stamp_us, frame)
            except BusError as exc:
                self._fault = self._fault or str(exc)
        tick_us = None if self._finished else self._schedule.take(now_us)
        frames_out: list[CanFrame] = []
        if tick_us is not None:
            if self._is_away:
                self._tick_without_bus(tick_us)
            else:
                frames_out = self._tick(tick_us)
            self._counters.frames_out += len(frames_out)
            self._status = self._make_status(tick_us)
        failure = self._decision.reason if self._finished and self._decision.mode is Mode.FAULT else ""
        ticked, next_us = tick_us is not None, self._schedule.next_us
        return Output(tuple(frames_out), ticked, next_us, self._status, self._finished, failure)

    def _receive(self, stamp_us: int, frame: CanFrame) -> None:
        node_id = frame.can_id & 0x7F
        if frame.remote:
            self._counters.foreign_frames += 1
        elif frame.can_id == SYNC.can_id:
            self._time_stamps.sync_left(stamp_us)
        elif frame.can_id == NMT_ID:
            if foreign_stop(frame, self._config.network.host_node):
                self._stop_reason = self._stop_reason or NMT_STOP
        elif frame.can_id in self._finger_by_id:
            self._receive_contact(self._finger_by_id[frame.can_id], stamp_us, frame)
        elif frame.can_id in self._drives.receive_ids:
            self._drives.receive(stamp_us, frame)
        elif frame.can_id == HEARTBEAT_ID + node_id and node_id in self._config.node_names:
            if self._network.receive(stamp_us, frame) is not None:
                self._booted(node_id)
        elif frame.can_id == EMCY_ID + node_id and node_id in self._config.node_names:
            self._receive_emergency(node_id, frame)
        else:
            self._counters.foreign_frames += 1

    def _booted(self, node_id: int) -> None:
        self._drives.booted(node_id)
        for finger in self._fingers:
            if finger.node_id == node_id:
                finger.tip.forget()

    def _receive_emergency(self, node_id: int, frame: CanFrame) -> None:
        """A drive's temperature is a fault in every mode, even of a drive that goes on; a fingertip's is not:
        its light derates by itself."""
        self._counters.emergencies += 1
        code = int.from_bytes(frame.data[:2], "little")
        name = self._network.name(node_id)
        self._last_emergency = f"{name}: EMCY {code:04X}h"
        if is_temperature(code) and self._drives.has(node_id):
            reason = f"{name}: temperature beyond its limit (EMCY {code:04X}h): let it cool, then recover"
            self._fault = self._fault or reason

    def _receive_contact(self, index: int, stamp_us: int, frame: CanFrame) -> None:
        finger = self._fingers[index]
        contact = finger.tip.receive(stamp_us, frame)
        if contact is None:
            return
        self._fault = self._fault or runaway.force_fault(
            self._config.fingers[index].name, contact, self._config.limits
        )
        pose = self._pose_at_exposure(contact, stamp_us)
        if pose is None:
            finger.unpaired += 1
            return
        finger.note(contact)
        if contact.valid:
            try:
                self._control.add_contact(index, contact, pose)
            except FrameError:
                finger.unpaired += 1

    def _pose_at_exposure(self, contact: TipContact, stamp_us: int) -> HandPose | None:
        """None when the exposure lies before the joints' history or ahead of the clock."""
        if contact.exposed_at_us > stamp_us + EXPOSURE_AHEAD_LIMIT_US:
            return None
        q_rad = self._history.at(contact.exposed_at_us)
        return None if q_rad is None else self._hand.pose(q_rad)

    def _tick_without_bus(self, tick_us: int) -> None:
        """Nobody can be told to stop, so a wish to leave ends it at once, and as a stop where the bus was all
        that failed."""
        if self._leaves and self._decision.reason == self._bus_fault:
            self._decision = Decision(Mode.STOP, self._stop_reason, tick_us)
        self._finished = self._leaves

    def _tick(self, tick_us: int) -> list[CanFrame]:
        if self._last_sync_us is not None:
            if tick_us > (due_us := self._last_sync_us + self._tick_us):
                self._drives.not_asked(due_us, tick_us)
            if self._drives.sampled_after(self._last_sync_us):
                angles = self._drives.angles()
                if angles is not None:
                    self._history.add(self._last_sync_us, angles[0])
        self._last_sync_us = tick_us
        is_up = [self._network.is_up(drive.node_id) for drive in self._drives.drives]
        ready = [*self._drives.identified(), *(finger.node_id for finger in self._fingers)]
        frames = [*self._time_stamps.due(tick_us), *self._network.due(tick_us, ready)]
        frames += [*self._drives.questions(tick_us, is_up), SYNC]
        goal, torque = self._control_step(tick_us)
        self._command_Nm = torque
        frames += self._drives.commands(goal, torque)
        if self._power_down.is_over(tick_us) and (self._leaves or not self._waits_for_commands):
            frames += self._network.stop_all()
            self._finished = True
        return frames

    def _control_step(self, tick_us: int) -> tuple[DriveGoal, Array]:
        angles = self._drives.angles()
        pose = R_vir = None
        no_virtual_frame = ""
        if angles is not None:
            pose = self._hand.pose(angles[0])
            try:
                R_vir = virtual_frame(pose.tip_centre_m)
            except FrameError as exc:
                no_virtual_frame = str(exc)
        self._R_vir = R_vir
        decision = self._decide(tick_us, no_virtual_frame, None if angles is None else angles[1])
        if decision.mode in STOPPED:
            goal = self._power_down.goal(tick_us, decision.since_us, self._drives.any_powered())
            return goal, np.zeros_like(self._command_Nm)
        if pose is None or angles is None:
            torque = np.zeros_like(self._command_Nm)
        else:
            torque = self._control.torque_Nm(decision.mode, pose, angles[1], R_vir, self._tick_us * 1e-6)
        if decision.mode is Mode.HOME:
            return DriveGoal.HOME, torque
        is_off = decision.mode in (Mode.INIT, Mode.CHECK)
        return (DriveGoal.OFF if is_off else DriveGoal.TORQUE), torque

    def _decide(self, tick_us: int, no_virtual_frame: str, qdot_rad_s: Array | None) -> Decision:
        last = self._decision
        orientation = self._control.orientation
        inputs = Inputs(
            now_us=tick_us,
            stop=self._stop_reason,
            fault=self._fault or self._fault_now(tick_us, last.mode, qdot_rad_s),
            missing=", ".join(self._network.missing()),
            unchecked=", ".join(self._network.not_operating()),
            homing=self._drives.homing.waiting,
            drives_waiting=self._drives.waiting(),
            no_virtual_frame=no_virtual_frame,
            no_contact_frame="" if orientation.is_following else orientation.problem or "taking references",
            blind_by_choice=self._config.control.mode is ControlMode.BLIND,
            wish=self._wish,
            fingers=[
                finger.health(tick_us, self._network.is_silent(finger.node_id, tick_us))
                for finger in self._fingers
            ],
        )
        self._decision = decide(last, inputs, self._tiers)
        return self._decision

    def _fault_now(self, tick_us: int, mode: Mode, qdot_rad_s: Array | None) -> str:
        """Why the hand must stop in a mode that moves joints; empty: it need not."""
        if mode not in (*MOVING, Mode.HOME):
            return ""
        for drive in self._drives.drives:
            if self._network.is_silent(drive.node_id, tick_us):
                return f"{self._network.name(drive.node_id)}: heartbeat lost"
        if mode is Mode.HOME:
            self._history = JointHistory(self._config.control.tick_Hz)  # the drives' zeros move
            self._drives.homing.step(tick_us)
            problem = self._drives.homing.problem
            return problem and f"{problem}; {self._last_emergency or 'no EMCY'}"
        waiting = self._drives.waiting()
        if waiting:
            return f"{waiting} left operation enabled; {self._last_emergency or 'no EMCY'}"
        lost = self._drives.lost_joint(tick_us, self._config.staleness.joint_stop_ms * 1000)
        if lost or qdot_rad_s is None:
            return lost
        torque_Nm = [drive.torque_Nm for drive in self._drives.drives]
        return runaway.joint_fault(self._config.joints, torque_Nm, qdot_rad_s, self._config.limits)

    def _make_status(self, now_us: int) -> HostStatus:
        control, M, R_vir = self._control, self._control.M, self._R_vir
        R_d_vir = control.R_d_vir
        error = None if R_vir is None or R_d_vir is None else rotation.angle_deg(R_d_vir @ R_vir.T)
        return HostStatus(
            time_us=now_us,
            mode=self._decision.mode,
            reason=self._decision.reason,
            warning=self._decision.warning,
            fingers=tuple(finger.status(now_us) for finger in self._fingers),
            joints=self._drives.status(self._command_Nm),
            R_vir=matrix(R_vir),
            R_c=None if R_vir is None or M is None else matrix(R_vir @ M),
            R_d=matrix(control.R_d),
            R_d_vir=matrix(R_d_vir),
            orientation_error_deg=error,
            fit_residual_deg=control.orientation.residual_deg,
            target_rpy_deg=self._target_rpy_deg,
            last_emergency=self._last_emergency,
            counters=replace(self._counters, ticks=self._schedule.ticks, late_ticks=self._schedule.left_out),
            turned=control.turned,
            lateness=tuple(self._schedule.lateness),
        )


def _refusal(what: str, decision: Decision, way_out: str = "") -> CommandError:
    if not way_out:
        way_out = {True: "recover first", False: "wait until it is ready"}[decision.mode in STOPPED]
    return CommandError(f"{what} is refused in mode {decision.mode.value} ({decision.reason}): {way_out}")
