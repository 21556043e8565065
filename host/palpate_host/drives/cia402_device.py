"""A CiA 402 joint drive as a device: slave core, power state machine, and a motor behind them.

Pure: time and frames in, frames out. The motor is a simulated joint or a drive on another bus. Watchdogs: in
Operation enabled, an RPDO 1 that fails to come within its event timer (1400h:05), or leaving NMT OPERATIONAL,
takes the torque away at once and leads to Fault. In Quick stop active the torque is 0 too: a hand that stops
must not go on closing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from palpate_edge.can_frame import CanFrame
from palpate_edge.node.emcy import EmcyCode, ErrorRegister
from palpate_edge.node.events import Event, NmtStateChanged, ObjectWritten, RpdoReceived, RpdoTimedOut
from palpate_edge.node.nmt import NmtCommand, NmtState
from palpate_edge.node.object_dictionary import load_eds
from palpate_edge.node.slave import Output, Slave
from palpate_host.drives.cia402 import CIA402_EDS, CYCLIC_SYNCHRONOUS_TORQUE, DriveState
from palpate_host.drives.cia402_state_machine import STATE_BITS, DriveStateMachine
from palpate_host.drives.joint_command import DriveGoal, JointCommand

ERROR_CODE, CONTROLWORD, STATUSWORD = 0x603F, 0x6040, 0x6041
MODE, MODE_DISPLAY = 0x6060, 0x6061
POSITION, VELOCITY = 0x6064, 0x606C
TARGET_TORQUE, MAX_TORQUE, RATED_TORQUE, ACTUAL_TORQUE = 0x6071, 0x6072, 0x6076, 0x6077
FEED_CONSTANT = 0x6092

STATUS_TPDO = 2
COMMUNICATION_LOST = 0x8100

# Statusword, CiA 402-2; bit 12 as cyclic synchronous torque defines it.
VOLTAGE_ENABLED, REMOTE, INTERNAL_LIMIT, FOLLOWS_COMMAND = 1 << 4, 1 << 9, 1 << 11, 1 << 12

_POWERED = (DriveState.OPERATION_ENABLED, DriveState.QUICK_STOP_ACTIVE)


@dataclass(frozen=True, slots=True)
class MotorState:
    """What a motor tells of its joint; error_code is for 603Fh, 0 while all is well."""

    position_rad: float
    velocity_rad_s: float
    error_code: int = 0


class Motor(Protocol):
    """What a device moves."""

    rated_torque_mNm: int

    def state(self, now_us: int) -> MotorState:
        """The joint at `now_us`; the order before has held until then."""
        ...

    def order(self, now_us: int, command: JointCommand) -> None:
        """What the joint shall do from `now_us` on."""
        ...

    def reset_fault(self) -> None:
        """The master resets a fault: clear the motor's own error, if it has one."""
        ...


class Cia402Device:
    """One drive with its motor. The joint's position is kept through NMT resets."""

    def __init__(self, node_id: int, motor: Motor) -> None:
        self.slave = Slave(load_eds(CIA402_EDS, node_id))
        self.slave.write(RATED_TORQUE, 0, motor.rated_torque_mNm)
        self.per_mille_Nm = motor.rated_torque_mNm * 1e-6
        self.increments_per_rad = self._number(FEED_CONSTANT, 1) / math.tau
        self._motor = motor
        self._machine = DriveStateMachine()

    @property
    def state(self) -> DriveState:
        return self._machine.state

    @property
    def torque_per_mille(self) -> int:
        """What the motor is asked now: the target within 6072h while enabled in torque mode, else 0."""
        if self.state is not DriveState.OPERATION_ENABLED or not self._in_torque_mode:
            return 0
        limit = self._number(MAX_TORQUE)
        return max(-limit, min(limit, self._number(TARGET_TORQUE)))

    def process(self, now_us: int, frames_in: Sequence[CanFrame]) -> Output:
        """Look at the joint, serve the frames, act on what they command."""
        self._measure(self._motor.state(now_us))
        served = self.slave.process(now_us, frames_in)
        for event in served.events:
            self._obey(event)
        self._motor.order(now_us, self._joint_command())
        self._report()
        status = self.slave.process(now_us, ())
        return Output(
            served.frames_out + status.frames_out, status.next_due_us, served.events + status.events
        )

    @property
    def _in_torque_mode(self) -> bool:
        return self._number(MODE) == CYCLIC_SYNCHRONOUS_TORQUE

    def _joint_command(self) -> JointCommand:
        if self.state is DriveState.QUICK_STOP_ACTIVE:
            return JointCommand(DriveGoal.QUICK_STOP)
        if self.state is not DriveState.OPERATION_ENABLED:
            return JointCommand(DriveGoal.OFF)
        return JointCommand(DriveGoal.TORQUE, self.torque_per_mille * self.per_mille_Nm)

    def _measure(self, joint: MotorState) -> None:
        """What TPDO 1 says at a SYNC; an error of the motor is a fault."""
        self.slave.write(POSITION, 0, round(joint.position_rad * self.increments_per_rad))
        self.slave.write(VELOCITY, 0, round(joint.velocity_rad_s * self.increments_per_rad))
        if joint.error_code and self.state is not DriveState.FAULT:
            self._fail(joint.error_code, ErrorRegister.GENERIC)

    def _obey(self, event: Event) -> None:
        match event:
            case RpdoReceived(values=values):
                if (CONTROLWORD, 0) in values:
                    self._command(values[CONTROLWORD, 0])
            case ObjectWritten(index=0x6040, value=int(value)):
                self._command(value)
            case RpdoTimedOut():
                self._lose_command(EmcyCode.RPDO_TIMEOUT)
            case NmtStateChanged(command=NmtCommand.RESET_NODE):
                self._machine = DriveStateMachine()
                self.slave.write(ERROR_CODE, 0, 0)
            case NmtStateChanged(state=NmtState.OPERATIONAL):
                self.slave.trigger((STATUS_TPDO,))
            case NmtStateChanged():
                self._lose_command(COMMUNICATION_LOST)

    def _command(self, controlword: int) -> None:
        was = self.state
        self._machine.command(controlword)
        if was is DriveState.FAULT and self.state is not DriveState.FAULT:
            self._motor.reset_fault()
            self.slave.emcy.clear(self._number(ERROR_CODE))
            self.slave.write(ERROR_CODE, 0, 0)

    def _lose_command(self, error_code: int) -> None:
        """The host no longer commands: a fault where there may be torque, nothing elsewhere."""
        if self.state in _POWERED:
            self._fail(error_code, ErrorRegister.COMMUNICATION)

    def _fail(self, error_code: int, register: ErrorRegister) -> None:
        self._machine.fail()
        self.slave.write(ERROR_CODE, 0, error_code)
        self.slave.emcy.report(error_code, register)

    def _report(self) -> None:
        """What TPDO 2 says; a change of the statusword sends it."""
        torque_per_mille = self.torque_per_mille
        in_torque_mode = self._in_torque_mode
        statusword = STATE_BITS[self.state] | VOLTAGE_ENABLED | REMOTE
        if self.state is DriveState.OPERATION_ENABLED and in_torque_mode:
            statusword |= FOLLOWS_COMMAND
            if torque_per_mille != self._number(TARGET_TORQUE):
                statusword |= INTERNAL_LIMIT
        if statusword != self._number(STATUSWORD):
            self.slave.write(STATUSWORD, 0, statusword)
            self.slave.trigger((STATUS_TPDO,))
        self.slave.write(MODE_DISPLAY, 0, CYCLIC_SYNCHRONOUS_TORQUE if in_torque_mode else 0)
        self.slave.write(ACTUAL_TORQUE, 0, torque_per_mille)

    def _number(self, index: int, subindex: int = 0) -> int:
        return int(self.slave.read(index, subindex))
