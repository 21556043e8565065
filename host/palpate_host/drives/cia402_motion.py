"""The orders to a drive's motor in each mode of operation, with the mode's statusword bits (CiA 402-2).

The device's side; pure, the time is an argument. Profile modes ramp by 6083h; profile position takes one set
point after another with its handshake; homing seeks a limit switch (methods 17, 18), takes the present
position (35, 37), or uses the motor's own procedure (-1).
"""

from __future__ import annotations

import enum
from dataclasses import dataclass

from palpate_host.common.joint_command import DriveGoal, JointCommand
from palpate_host.drives.cia402_modes import (
    HOMING_ATTAINED,
    HOMING_ERROR,
    NEW_SET_POINT,
    SET_POINT_TAKEN,
    START_HOMING,
    OperationMode,
)

TARGET_REACHED, FOLLOWS_COMMAND = 1 << 10, 1 << 12
NEGATIVE_SWITCH, POSITIVE_SWITCH, PRESENT, PRESENT_OLD, OWN_PROCEDURE = 17, 18, 37, 35, -1
REACHED_RAD = 2e-3


class OwnHoming(enum.Enum):
    """The state of a motor's own homing procedure."""

    NONE = "none"
    RUNNING = "running"
    ATTAINED = "attained"
    FAILED = "failed"


@dataclass(frozen=True, slots=True)
class MotorState:
    """Measured state of a motor and its joint.

    error_code: for 603Fh, 0 for none. torque_Nm: the actual torque where the motor follows no torque.
    at_limit: -1 or 1 at the limit switch of that direction. homing: of the motor's own procedure.
    lasting_error: the code of an error whose cause persists, so that no reset helps; 0 for none. It is
    reported in addition to error_code.
    """

    position_rad: float
    velocity_rad_s: float
    error_code: int = 0
    torque_Nm: float = 0.0
    at_limit: int = 0
    homing: OwnHoming = OwnHoming.NONE
    lasting_error: int = 0


@dataclass(frozen=True, slots=True)
class Targets:
    """The objects that control a mode, in rad, s and N m; the controlword as received."""

    controlword: int
    torque_Nm: float
    torque_limit_Nm: float
    velocity_rad_s: float
    position_rad: float
    profile_speed_rad_s: float
    profile_rate_rad_s2: float
    homing_method: int
    search_rad_s: float
    zero_rad_s: float


class DriveMotion:
    """The motion of one enabled drive: call `order` once a call of the device, then read `status_bits`."""

    def __init__(self) -> None:
        self.is_homed = False
        self._failed = False
        self.reset()

    def reset(self) -> None:
        """Forget ramps and set points: the drive is disabled, or its mode changes. The zero found stays."""
        self._mode = 0
        self._velocity_rad_s = 0.0
        self._set_point_rad: float | None = None
        self._taken = self._last_new = self._started = self._found_switch = False
        self._bits = 0

    @property
    def status_bits(self) -> int:
        return self._bits

    def order(
        self, mode: int, targets: Targets, joint: MotorState, step_s: float
    ) -> tuple[JointCommand, bool]:
        """Return the motor's order in `mode`, and whether the joint has just reached its home position."""
        if mode != self._mode:
            self.reset()
            self._mode = mode
        if mode == OperationMode.HOMING:
            return self._homing(targets, joint)
        return self._following(targets, joint, step_s), False

    def _following(self, targets: Targets, joint: MotorState, step_s: float) -> JointCommand:
        limit_Nm = targets.torque_limit_Nm
        command = JointCommand(DriveGoal.TORQUE)
        self._bits = FOLLOWS_COMMAND
        match self._mode:
            case OperationMode.CYCLIC_TORQUE:
                command = JointCommand(DriveGoal.TORQUE, max(-limit_Nm, min(limit_Nm, targets.torque_Nm)))
            case OperationMode.CYCLIC_VELOCITY:
                command = JointCommand(DriveGoal.VELOCITY, limit_Nm, targets.velocity_rad_s)
            case OperationMode.PROFILE_VELOCITY:
                self._ramp(targets.velocity_rad_s, targets.profile_rate_rad_s2, step_s)
                self._bits = TARGET_REACHED if self._velocity_rad_s == targets.velocity_rad_s else 0
                command = JointCommand(DriveGoal.VELOCITY, limit_Nm, self._velocity_rad_s)
            case OperationMode.CYCLIC_POSITION:
                command = JointCommand(DriveGoal.POSITION, limit_Nm, position_rad=targets.position_rad)
            case OperationMode.PROFILE_POSITION:
                command = self._to_set_point(targets, joint, step_s)
            case _:
                self._bits = 0
        return command

    def _ramp(self, wanted_rad_s: float, rate_rad_s2: float, step_s: float) -> None:
        step = rate_rad_s2 * step_s
        change = wanted_rad_s - self._velocity_rad_s
        self._velocity_rad_s = (
            wanted_rad_s if abs(change) <= step else self._velocity_rad_s + (step if change > 0.0 else -step)
        )

    def _to_set_point(self, targets: Targets, joint: MotorState, step_s: float) -> JointCommand:
        """Take the target at a rising bit 4; bit 12 acknowledges it until bit 4 falls."""
        is_new = bool(targets.controlword & NEW_SET_POINT)
        if is_new and not self._last_new:
            self._taken = True
            if self._set_point_rad is None:
                self._ramped_rad = joint.position_rad
            self._set_point_rad = targets.position_rad
        self._taken = self._taken and is_new
        self._last_new = is_new
        if self._set_point_rad is None:
            self._bits = 0
            return JointCommand(DriveGoal.POSITION, targets.torque_limit_Nm, position_rad=joint.position_rad)
        most = targets.profile_speed_rad_s * step_s
        left = self._set_point_rad - self._ramped_rad
        self._ramped_rad += max(-most, min(most, left))
        reached = abs(self._set_point_rad - joint.position_rad) < REACHED_RAD
        self._bits = (TARGET_REACHED if reached else 0) | (SET_POINT_TAKEN if self._taken else 0)
        return JointCommand(DriveGoal.POSITION, targets.torque_limit_Nm, position_rad=self._ramped_rad)

    def _homing(self, targets: Targets, joint: MotorState) -> tuple[JointCommand, bool]:
        standstill = JointCommand(DriveGoal.VELOCITY, targets.torque_limit_Nm)
        is_commanded = bool(targets.controlword & START_HOMING)
        if is_commanded and not self._last_new:
            self._started, self._found_switch = True, False
            self.is_homed = self._failed = False
        self._last_new = is_commanded
        is_home = False
        command = standstill
        if self._started and is_commanded:
            command, is_home = self._home(targets, joint, standstill)
        if is_home:
            self.is_homed, self._started = True, False
        if self._failed:
            self._started = False
        self._bits = (
            HOMING_ERROR if self._failed else TARGET_REACHED | HOMING_ATTAINED if self.is_homed else 0
        )
        return command, is_home

    def _home(
        self, targets: Targets, joint: MotorState, standstill: JointCommand
    ) -> tuple[JointCommand, bool]:
        method = targets.homing_method
        if method in (PRESENT, PRESENT_OLD):
            return standstill, True
        if method == OWN_PROCEDURE:
            self._failed = joint.homing is OwnHoming.FAILED
            return JointCommand(DriveGoal.HOME, standstill.torque_Nm), joint.homing is OwnHoming.ATTAINED
        side = {NEGATIVE_SWITCH: -1, POSITIVE_SWITCH: 1}.get(method)
        if side is None or joint.at_limit == -side:
            self._failed = True  # an unknown method, or the wrong switch
            return standstill, False
        if joint.at_limit == side:
            self._found_switch = True
            return JointCommand(DriveGoal.VELOCITY, standstill.torque_Nm, -side * targets.zero_rad_s), False
        if self._found_switch:
            return standstill, True
        return JointCommand(DriveGoal.VELOCITY, standstill.torque_Nm, side * targets.search_rad_s), False
