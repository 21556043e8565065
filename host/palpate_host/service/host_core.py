"""The host's core: frames of the bus and times in, frames of the host out.

A tick, at tick_Hz: SYNC, supervisor, torques, one command for each drive. Received frames are processed with
their own time stamps (nodes.py) and answered at the next tick, so the output depends on stamps and ticks
alone, and a log replays exactly.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from palpate_edge.can_bus.bus_counters import BusCounters
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.arrays import Array
from palpate_host.common.command import (
    Accept,
    Accepted,
    Command,
    Grasp,
    Move,
    Recover,
    Release,
    Reorient,
    Rotate,
    Stop,
)
from palpate_host.common.joint_command import DriveGoal
from palpate_host.common.mode import STOPPED, Mode
from palpate_host.common.status import HostStatus, matrix
from palpate_host.common.tick_inputs import BusLost, BusRestored, End, Planned, TickInputs
from palpate_host.config.control_config import ControlMode
from palpate_host.config.hand_config import HandConfig, StartMode
from palpate_host.control.gait.turn_request import TurnRequest
from palpate_host.control.hold_report import gait_text, hold_fault, hold_status, hold_warning
from palpate_host.control.kinematics import HandKinematics
from palpate_host.control.manipulation import Manipulation
from palpate_host.control.virtual_frame import FrameError, check_numbering, virtual_frame
from palpate_host.network.nodes import Nodes, PairedContact
from palpate_host.operator.command_rules import check_allowed
from palpate_host.safety.drive_shutdown import DriveShutdown
from palpate_host.safety.supervisor import Decision, Goal, Inputs, Tiers, decide
from palpate_host.service.input_journal import InputJournal
from palpate_host.service.tick_schedule import TickSchedule

OPERATOR_STOP = "stopped by the operator"


@dataclass(frozen=True, slots=True)
class HostOutput:
    """The result of one call of `process`.

    ticked: a tick was due, also while the bus is lost. next_due_us: the latest time of the next call.
    finished: the hand is stopped and safe, and the loop may end; failure is then the reason in one line,
    empty after an operator's stop.
    """

    frames_out: tuple[CanFrame, ...]
    ticked: bool
    next_due_us: int
    status: HostStatus | None
    finished: bool
    failure: str


class HostCore:
    """The pure host: `process` takes frames and times, and returns the frames to send."""

    def __init__(self, config: HandConfig, hand: HandKinematics, *, verifies: bool = True) -> None:
        """Raises FrameError when the fingers are numbered clockwise with every joint in the middle of its
        range.

        verifies: read every node's parameters before its contacts are used; False only replays older logs.
        """
        middle = np.array([(joint.min_rad + joint.max_rad) / 2 for joint in config.joints])
        check_numbering(hand.tip_centres_m(middle))
        self._config = config
        self._hand = hand
        self._tick_us = 1_000_000 // config.control.tick_Hz
        self._schedule = TickSchedule(self._tick_us)
        self._nodes = Nodes(config, hand, verifies=verifies)
        s = config.staleness
        self._tiers = Tiers(
            warn_us=s.warn_ms * 1000,
            freeze_us=s.freeze_ms * 1000,
            hold_us=s.hold_ms * 1000,
            stop_us=s.stop_ms * 1000,
            lost_us=s.lost_ms * 1000,
            settle_us=config.control.settle_ms * 1000,
            release_us=config.control.release_ms * 1000,
        )
        self._waits_for_commands = config.run.start is StartMode.COMMAND
        self._control = Manipulation(config)
        self._target_rpy_deg = config.target.rpy_deg
        self._goal = Goal.NOTHING if self._waits_for_commands else Goal.TURN
        self._decision = Decision(Mode.INIT, "starting", 0)
        self._stop_reason = ""
        self._is_ending = False
        self._is_bus_lost = False
        self._bus_fault = ""
        self._restored_us = 0
        self._command_Nm = np.zeros(len(config.joints))
        self._R_vir: Array | None = None
        self._shutdown = DriveShutdown()
        self._finished = False
        self._unreadable_frames = 0  # 29-bit and CAN FD
        self._status: HostStatus | None = None
        self._journal = InputJournal(self._nodes.accept_ids)

    @property
    def accept_ids(self) -> tuple[int, ...]:
        """The CAN identifiers that this core receives."""
        return self._nodes.accept_ids

    def set_io_counters(self, bus: BusCounters, status_lines_lost: int) -> None:
        """Take the counters of the bus and of the status stream into the status."""
        counters = self._nodes.counters
        counters.status_lines_lost = status_lines_lost
        counters.transmit_retries = bus.send_retries
        counters.error_frames = bus.error_frames
        counters.receive_overruns = bus.receive_overruns
        counters.bus_restarts = bus.restarts
        self._unreadable_frames = bus.foreign_frames

    def request_stop(self, reason: str = OPERATOR_STOP) -> None:
        """Stop at the next tick and finish: quick stop, drives off, NMT stop. The first reason is kept."""
        if not self._is_ending:
            self._journal.note(End(reason))
        self._is_ending = True
        self._stop_reason = self._stop_reason or reason

    def bus_lost(self, now_us: int, reason: str) -> None:
        """Enter FAULT because the bus is lost; send no frame until `bus_restored` and discard the nodes'
        states.

        An earlier fault or stop keeps its reason, with this one as its warning while the bus is lost.
        """
        self._journal.note(BusLost(now_us, reason))
        self._is_bus_lost = True
        self._bus_fault = self._bus_fault or reason
        if self._decision.mode in STOPPED:
            self._decision = replace(self._decision, warning=reason)
        else:
            self._decision = Decision(Mode.FAULT, reason, now_us)
        self._R_vir = None
        self._command_Nm = np.zeros_like(self._command_Nm)
        self._nodes.bus_lost()

    def bus_restored(self, now_us: int) -> None:
        """Take the bus into use again: drives are disabled, since their state is unknown, until `Recover`.

        Frames with earlier time stamps are ignored.
        """
        self._journal.note(BusRestored(now_us))
        self._is_bus_lost = False
        self._restored_us = now_us
        self._decision = replace(self._decision, warning="")

    def command(self, command: Command) -> Accepted | None:
        """Carry out a command from the next tick on. Return what `Accept` has accepted.

        Raises CommandError, with the step to take first, when the mode does not allow it.
        """
        check_allowed(
            command,
            self._decision,
            self._goal,
            is_ending=self._is_ending,
            bus_lost=self._is_bus_lost,
            is_off=self._shutdown.is_off,
        )
        accepted = None
        match command:
            case Accept(node_id=node_id):
                accepted = self._nodes.accept(node_id)
            case Stop():
                self._stop_reason = self._stop_reason or OPERATOR_STOP
            case Recover():
                self._recover()
            case Grasp():
                self._goal = Goal.GRASP
                self._control.stop_turning()
            case Rotate(rpy_deg=rpy_deg, ramp_s=ramp_s):
                self._goal = Goal.TURN
                self._target_rpy_deg = rpy_deg
                self._control.turn(rpy_deg, self._config.target.ramp_s if ramp_s is None else ramp_s)
            case Move(xyz_mm=xyz_mm, rpy_deg=rpy_deg, ramp_s=ramp_s):
                self._control.move(xyz_mm, rpy_deg, self._config.target.ramp_s if ramp_s is None else ramp_s)
                self._goal = Goal.TURN
                self._target_rpy_deg = rpy_deg
            case Reorient(rpy_deg=rpy_deg, corners_mm=corners_mm):
                self._control.request_turn(rpy_deg, corners_mm)
                self._goal = Goal.TURN
                self._target_rpy_deg = rpy_deg
            case Release():
                self._goal = Goal.NOTHING
                self._control = Manipulation(self._config)
        self._journal.note(command)
        return accepted

    @property
    def turn_request(self) -> TurnRequest | None:
        """The turn by finger gaiting that waits for its plan; the caller makes it and calls `planned`."""
        return self._control.reorientation.request

    def planned(self, event: Planned) -> None:
        """Take the plan of `turn_request`, or why there is none; without a request it has no effect."""
        self._control.take_plan(event.plan, event.problem)
        self._journal.note(event)

    def _recover(self) -> None:
        """Leave FAULT or STOP: all nodes are started again, without a goal."""
        self._stop_reason = self._bus_fault = ""
        self._goal = Goal.NOTHING
        self._shutdown = DriveShutdown()
        self._control = Manipulation(self._config)
        self._nodes.recover()
        self._decision = Decision(Mode.INIT, "recovering", self._decision.since_us)

    def process(self, now_us: int, frames_in: Sequence[tuple[int, CanFrame]]) -> HostOutput:
        """Process stamped frames; when a tick is due, return the host's frames for it.

        A tick more than one period late is skipped and counted. Frames from the bus never raise an error: a
        frame that breaks the contract stops the hand, with the reason as the output's failure.
        """
        nodes = self._nodes
        for stamp_us, frame in frames_in:
            nodes.counters.frames_in += 1
            self._journal.note_frame(stamp_us, frame.can_id)
            if self._is_bus_lost or stamp_us < self._restored_us:
                continue
            paired = nodes.receive(stamp_us, frame)
            if paired is not None:
                self._take_contact(paired)
        self._stop_reason = self._stop_reason or nodes.stop
        tick_us = None if self._finished else self._schedule.take(now_us)
        frames_out: list[CanFrame] = []
        if tick_us is not None:
            if self._is_bus_lost:
                self._tick_without_bus(tick_us)
            else:
                frames_out = self._tick(tick_us)
            nodes.counters.frames_out += len(frames_out)
            self._status = self._make_status(
                tick_us, self._journal.take(now_us, waits=self._waits_for_commands)
            )
        failure = self._decision.reason if self._finished and self._decision.mode is Mode.FAULT else ""
        ticked, next_us = tick_us is not None, self._schedule.next_us
        return HostOutput(tuple(frames_out), ticked, next_us, self._status, self._finished, failure)

    def _take_contact(self, paired: PairedContact) -> None:
        try:
            self._control.add_contact(paired.finger, paired.contact, paired.pose)
        except FrameError:
            self._nodes.fingers[paired.finger].unpaired += 1

    def _tick_without_bus(self, tick_us: int) -> None:
        """End at once when that was requested, since no node can be reached; the result is STOP where the
        lost bus was the only fault."""
        if self._is_ending and self._decision.reason == self._bus_fault:
            self._decision = Decision(Mode.STOP, self._stop_reason, tick_us)
        self._finished = self._is_ending

    def _tick(self, tick_us: int) -> list[CanFrame]:
        frames = self._nodes.tick(tick_us)
        goal, torque = self._control_step(tick_us)
        self._command_Nm = torque
        frames += self._nodes.drives.commands(goal, torque)
        if self._shutdown.is_finished(tick_us) and (self._is_ending or not self._waits_for_commands):
            frames += self._nodes.network.stop_all()
            self._finished = True
        return frames

    def _control_step(self, tick_us: int) -> tuple[DriveGoal, Array]:
        angles = self._nodes.drives.angles()
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
            goal = self._shutdown.goal(tick_us, decision.since_us, self._nodes.drives.any_powered())
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
        last, nodes = self._decision, self._nodes
        orientation = self._control.orientation
        is_blind = self._config.control.mode is ControlMode.BLIND
        control, names = self._control, [finger.name for finger in nodes.fingers]
        follows = control.gait is not None or orientation.is_following
        inputs = Inputs(
            now_us=tick_us,
            stop=self._stop_reason,
            fault=nodes.fault
            or nodes.fault_now(tick_us, last.mode, qdot_rad_s)
            or hold_fault(self._control, self._config.pose_law),
            missing=", ".join(nodes.network.missing()),
            unchecked=", ".join(nodes.unchecked(needs_contacts=not is_blind)),
            homing=nodes.drives.homing.waiting,
            drives_waiting=nodes.drives.waiting(),
            no_virtual_frame=no_virtual_frame,
            no_contact_frame="" if follows else orientation.problem or "taking references",
            blind_by_choice=is_blind,
            goal=self._goal,
            left_out=", ".join(names[number] for number in orientation.left_out if control.gait is None),
            hold_warning=hold_warning(control, self._config.pose_law, names),
            gait=gait_text(control, names),
            force_is_limited=math.isfinite(self._config.limits.contact_force_N),
            fingers=[
                finger.health(
                    tick_us,
                    nodes.network.heartbeat_timed_out(finger.node_id, tick_us),
                    is_lifted=number == control.reorientation.lifted,
                )
                for number, finger in enumerate(nodes.fingers)
            ],
        )
        self._decision = decide(last, inputs, self._tiers)
        return self._decision

    def _make_status(self, now_us: int, inputs: TickInputs) -> HostStatus:
        control, M, R_vir = self._control, self._control.M, self._R_vir
        nodes, schedule = self._nodes, self._schedule
        R_d_vir = control.R_d_vir
        return HostStatus(
            time_us=now_us,
            mode=self._decision.mode,
            reason=self._decision.reason,
            warning=self._decision.warning,
            fingers=tuple(finger.status(now_us) for finger in nodes.fingers),
            joints=nodes.drives.status(self._command_Nm),
            R_vir=matrix(R_vir),
            R_c=None if R_vir is None or M is None else matrix(R_vir @ M),
            R_d=matrix(control.R_d),
            R_d_vir=matrix(R_d_vir),
            orientation_error_deg=control.orientation_error_deg(R_vir),
            fit_residual_deg=control.orientation.residual_deg,
            target_rpy_deg=self._target_rpy_deg,
            last_emergency=nodes.last_emergency,
            counters=replace(
                nodes.counters,
                ticks=schedule.ticks,
                late_ticks=schedule.left_out,
                foreign_frames=nodes.counters.foreign_frames + self._unreadable_frames,
            ),
            turned=control.turned,
            lateness=tuple(schedule.lateness),
            inputs=inputs,
            hold=hold_status(control),
        )
