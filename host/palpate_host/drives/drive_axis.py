"""One axis of a CiA 402 drive on the device's side: power state machine, modes, and the motor behind them.

Pure: time and objects in, objects and the motor's order out. The axis has its objects in the dictionary of
its node; those of axis n are n * 800h higher (CiA 402-2).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

from palpate_bus.eds.cia402 import DriveState
from palpate_bus.eds.cia402_axes import axis_index
from palpate_edge.node.emcy import EmcyCode, ErrorRegister, is_temperature
from palpate_edge.node.events import Event, NmtStateChanged, ObjectWritten, RpdoReceived, RpdoTimedOut
from palpate_edge.node.nmt import NmtCommand, NmtState
from palpate_edge.node.slave import Slave
from palpate_host.common.joint_command import DriveGoal, JointCommand
from palpate_host.drives.cia402_modes import OperationMode
from palpate_host.drives.cia402_motion import DriveMotion, MotorState, Targets
from palpate_host.drives.cia402_state_machine import STATE_BITS, DriveStateMachine

ERROR_CODE, CONTROLWORD, STATUSWORD = 0x603F, 0x6040, 0x6041
MODE, MODE_DISPLAY = 0x6060, 0x6061
POSITION, VELOCITY = 0x6064, 0x606C
TARGET_TORQUE, MAX_TORQUE, MAX_CURRENT, RATED_TORQUE, ACTUAL_TORQUE = 0x6071, 0x6072, 0x6073, 0x6076, 0x6077
TARGET_POSITION, HOME_OFFSET, TARGET_VELOCITY = 0x607A, 0x607C, 0x60FF
PROFILE_VELOCITY, PROFILE_ACCELERATION = 0x6081, 0x6083
HOMING_METHOD, HOMING_SPEEDS = 0x6098, 0x6099
FEED_CONSTANT, SUPPORTED_MODES = 0x6092, 0x6502

COMMUNICATION_LOST = 0x8100

# Statusword, CiA 402-2.
VOLTAGE_ENABLED, REMOTE, INTERNAL_LIMIT = 1 << 4, 1 << 9, 1 << 11

_POWERED = (DriveState.OPERATION_ENABLED, DriveState.QUICK_STOP_ACTIVE)


class Motor(Protocol):
    """The motor of an axis."""

    rated_torque_mNm: int

    def state(self, now_us: int) -> MotorState:
        """Return the joint's state at `now_us`; the last order held until then."""
        ...

    def order(self, now_us: int, command: JointCommand) -> None:
        """Set the order that the joint follows from `now_us` on."""
        ...

    def reset_fault(self) -> None:
        """Clear the motor's own error, if it has one: the master resets a fault."""
        ...


class DriveAxis:
    """One axis with its motor; the joint's position and its zero survive NMT resets."""

    def __init__(
        self,
        slave: Slave,
        motor: Motor,
        modes: Sequence[OperationMode],
        *,
        axis: int = 0,
        error_info: bytes = b"",
        status_tpdos: Sequence[int] = (),
    ) -> None:
        """modes: the supported ones, of those that the EDS lists in 6502h. error_info: the first manufacturer
        bytes of its EMCY. status_tpdos: sent at a change of statusword or mode."""
        self._slave, self._motor, self._offset = slave, motor, axis_index(0, axis)
        self._error_info, self._status_tpdos = error_info, tuple(status_tpdos)
        self._modes = self._number(SUPPORTED_MODES) & sum(mode.supported_bit for mode in modes)
        self._write(SUPPORTED_MODES, self._modes)
        self._write(RATED_TORQUE, motor.rated_torque_mNm)
        self.per_mille_Nm = motor.rated_torque_mNm * 1e-6
        self.increments_per_rad = self._number(FEED_CONSTANT, 1) / math.tau
        self._machine = DriveStateMachine()
        self._motion = DriveMotion()
        self._command_now = JointCommand(DriveGoal.OFF)
        self._joint = MotorState(0.0, 0.0)
        self._zero_rad = 0.0
        self._reported_errors: list[int] = []  # as EMCY, since the last fault reset

    @property
    def state(self) -> DriveState:
        return self._machine.state

    @property
    def torque_per_mille(self) -> int:
        """The motor's torque in a torque mode: the target, limited by 6072h and 6073h; 0 in other modes."""
        if self._command_now.goal is not DriveGoal.TORQUE:
            return 0
        return round(self._command_now.torque_Nm / self.per_mille_Nm)

    @property
    def is_following(self) -> bool:
        """True while the motor follows a velocity or a position, which also changes between frames (ramps,
        homing)."""
        return self._command_now.goal in (DriveGoal.VELOCITY, DriveGoal.POSITION)

    def measure(self, now_us: int) -> None:
        """Update position and velocity; an error of the motor is a fault.

        The drive's angle is the motor's less the zero that homing has found.
        """
        joint = self._motor.state(now_us)
        joint = self._joint = replace(joint, position_rad=joint.position_rad - self._zero_rad)
        self._write(POSITION, round(joint.position_rad * self.increments_per_rad))
        self._write(VELOCITY, round(joint.velocity_rad_s * self.increments_per_rad))
        if joint.error_code and self.state is not DriveState.FAULT:
            self._fail(joint.error_code, _register_of(joint.error_code))
        if joint.lasting_error and joint.lasting_error not in self._reported_errors:
            self._fail(joint.lasting_error, _register_of(joint.lasting_error))

    def handle(self, event: Event) -> None:
        """Apply an event of the node."""
        match event:
            case RpdoReceived(values=values):
                controlword = values.get((CONTROLWORD + self._offset, 0))
                if controlword is not None:
                    self._command(controlword)
            case ObjectWritten(index=index, value=int(value)):
                if index == CONTROLWORD + self._offset:
                    self._command(value)
            case RpdoTimedOut():
                self._lose_command(EmcyCode.RPDO_TIMEOUT)
            case NmtStateChanged(command=NmtCommand.RESET_NODE):
                self._machine = DriveStateMachine()
                self._reported_errors.clear()
                self._write(ERROR_CODE, 0)
            case NmtStateChanged(command=NmtCommand.RESET_COMMUNICATION):
                self._lose_command(COMMUNICATION_LOST)
                self._report_again()
            case NmtStateChanged(state=NmtState.OPERATIONAL):
                self._slave.trigger(self._status_tpdos)
            case NmtStateChanged():
                self._lose_command(COMMUNICATION_LOST)

    def drive(self, now_us: int, step_s: float) -> None:
        """Command the motor, then update statusword, mode and torque. step_s: since the last call."""
        self._command_now = self._joint_command(step_s)
        self._motor.order(now_us, self._command_now)
        self._report()

    @property
    def _mode(self) -> int:
        """The mode of 6060h, 0 when the drive does not support it."""
        mode = self._number(MODE)
        return mode if mode > 0 and self._modes & 1 << (mode - 1) else 0

    def _joint_command(self, step_s: float) -> JointCommand:
        if self.state is not DriveState.OPERATION_ENABLED:
            self._motion.reset()
            is_braked = self.state is DriveState.QUICK_STOP_ACTIVE
            return JointCommand(DriveGoal.QUICK_STOP if is_braked else DriveGoal.OFF)
        command, is_home = self._motion.order(self._mode, self._targets(), self._joint, step_s)
        if is_home and self._number(HOMING_METHOD) > 0:
            here_rad = self._joint.position_rad + self._zero_rad
            self._zero_rad = here_rad - self._number(HOME_OFFSET) / self.increments_per_rad
        if command.goal is DriveGoal.POSITION:
            return replace(command, position_rad=command.position_rad + self._zero_rad)
        return command

    def _targets(self) -> Targets:
        per_rad, limit = self.increments_per_rad, min(self._number(MAX_TORQUE), self._number(MAX_CURRENT))
        return Targets(
            controlword=self._number(CONTROLWORD),
            torque_Nm=self._number(TARGET_TORQUE) * self.per_mille_Nm,
            torque_limit_Nm=limit * self.per_mille_Nm,
            velocity_rad_s=self._number(TARGET_VELOCITY) / per_rad,
            position_rad=self._number(TARGET_POSITION) / per_rad,
            profile_speed_rad_s=self._number(PROFILE_VELOCITY) / per_rad,
            profile_rate_rad_s2=self._number(PROFILE_ACCELERATION) / per_rad,
            homing_method=self._number(HOMING_METHOD),
            search_rad_s=self._number(HOMING_SPEEDS, 1) / per_rad,
            zero_rad_s=self._number(HOMING_SPEEDS, 2) / per_rad,
        )

    def _command(self, controlword: int) -> None:
        was = self.state
        self._machine.command(controlword, may_reset=not self._joint.lasting_error)
        if was is DriveState.FAULT and self.state is not DriveState.FAULT:
            self._motor.reset_fault()
            for error_code in self._reported_errors:
                self._slave.emcy.clear(error_code, self._error_info)
            self._reported_errors.clear()
            self._write(ERROR_CODE, 0)

    def _lose_command(self, error_code: int) -> None:
        """Enter Fault in a state with torque, since the host no longer commands; do nothing in others."""
        if self.state in _POWERED:
            self._fail(error_code, ErrorRegister.COMMUNICATION)

    def _report_again(self) -> None:
        """Report a lasting error again after a reset, so that the master learns why no fault reset helps."""
        error_code = self._joint.lasting_error
        if self.state is DriveState.FAULT and error_code:
            self._slave.emcy.report(error_code, _register_of(error_code), self._error_info)

    def _fail(self, error_code: int, register: ErrorRegister) -> None:
        self._machine.fail()
        self._reported_errors.append(error_code)
        self._write(ERROR_CODE, error_code)
        self._slave.emcy.report(error_code, register, self._error_info)

    def _report(self) -> None:
        """Update statusword, mode display and torque."""
        torque_per_mille = self.torque_per_mille
        statusword = STATE_BITS[self.state] | VOLTAGE_ENABLED | REMOTE | self._motion.status_bits
        if self._command_now.goal is DriveGoal.TORQUE and self._mode == OperationMode.CYCLIC_TORQUE:
            if torque_per_mille != self._number(TARGET_TORQUE):
                statusword |= INTERNAL_LIMIT
        elif self._command_now.goal in (DriveGoal.VELOCITY, DriveGoal.POSITION):
            torque_per_mille = round(self._joint.torque_Nm / self.per_mille_Nm)
        mode = self._mode
        if (statusword, mode) != (self._number(STATUSWORD), self._number(MODE_DISPLAY)):
            self._write(STATUSWORD, statusword)
            self._slave.trigger(self._status_tpdos)
        self._write(MODE_DISPLAY, mode)
        self._write(ACTUAL_TORQUE, torque_per_mille)

    def _number(self, index: int, subindex: int = 0) -> int:
        return int(self._slave.read(index + self._offset, subindex))

    def _write(self, index: int, value: int) -> None:
        self._slave.write(index + self._offset, 0, value)


def _register_of(error_code: int) -> ErrorRegister:
    return ErrorRegister.TEMPERATURE if is_temperature(error_code) else ErrorRegister.GENERIC
