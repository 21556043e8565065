"""The master's side of one axis of a CiA 402 drive: its state in, controlword and target out.

Torque is in per mille of 6076h, position in increments of which 6092h:01 make a turn; both objects are read
from the drive at start-up (identify.py).
"""

from __future__ import annotations

from palpate_bus.eds.cia402 import Controlword, DriveState, state_of
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.errors import BusError
from palpate_host.common.joint_command import DriveGoal, Follows, JointCommand, JointState
from palpate_host.drives.cia402_modes import (
    CHANGE_AT_ONCE,
    HOMING_ATTAINED,
    HOMING_ERROR,
    NEW_SET_POINT,
    SET_POINT_TAKEN,
    START_HOMING,
    OperationMode,
)
from palpate_host.drives.cia402_scale import DriveScale
from palpate_host.drives.drive import NO_STATUS, DriveNeeds, HomingState
from palpate_host.drives.identify import DriveIdentification

_NEXT_TO_ENABLED = {
    DriveState.SWITCH_ON_DISABLED: Controlword.SHUTDOWN,
    DriveState.READY_TO_SWITCH_ON: Controlword.SWITCH_ON,
    DriveState.SWITCHED_ON: Controlword.ENABLE_OPERATION,
    DriveState.OPERATION_ENABLED: Controlword.ENABLE_OPERATION,
    DriveState.FAULT: Controlword.FAULT_RESET,
}
_POWERED = (DriveState.OPERATION_ENABLED, DriveState.QUICK_STOP_ACTIVE)


def controlword_for(state: DriveState | None, goal: DriveGoal, last: Controlword) -> Controlword:
    """Return the next controlword from `state` towards `goal`.

    last: the controlword sent before, since a fault reset needs a rising edge.
    """
    if goal is DriveGoal.QUICK_STOP:
        return Controlword.QUICK_STOP if state in _POWERED else Controlword.DISABLE_VOLTAGE
    if goal is DriveGoal.OFF or state is None:
        return Controlword.DISABLE_VOLTAGE
    word = _NEXT_TO_ENABLED.get(state, Controlword.DISABLE_VOLTAGE)
    if word is Controlword.FAULT_RESET and last is Controlword.FAULT_RESET:
        return Controlword.DISABLE_VOLTAGE
    return word


def homing_state(statusword: int) -> HomingState:
    """Return the state of a drive that is in homing mode."""
    if statusword & HOMING_ERROR:
        return HomingState.ERROR
    return HomingState.ATTAINED if statusword & HOMING_ATTAINED else HomingState.MISSING


class AxisMaster:
    """State, scale and command words of one drive, whether it has a node of its own or is an axis of one."""

    def __init__(self, needs: DriveNeeds) -> None:
        joint = needs.joint
        self.node_id = needs.node_id
        self.name = needs.name
        self.uses_nmt = True
        self.identification = DriveIdentification(needs)
        self.homing: HomingState | None = None
        self.joint: JointState | None = None
        self.torque_Nm = 0.0
        self.state: DriveState | None = None
        # The joint's angle is direction * the drive's angle + the offset.
        self._direction = joint.direction
        self._zero_offset_rad = joint.zero_offset_rad
        self._follows = needs.follows
        self._position = 0
        self._set_point_taken = False
        self._last_word = Controlword.DISABLE_VOLTAGE

    @property
    def scale(self) -> DriveScale | None:
        """The drive's units, None until it is identified."""
        return self.identification.scale

    @property
    def is_identified(self) -> bool:
        return self.scale is not None

    @property
    def is_enabled(self) -> bool:
        return self.state is DriveState.OPERATION_ENABLED

    @property
    def is_powered(self) -> bool:
        return self.state in _POWERED

    @property
    def state_name(self) -> str:
        return NO_STATUS if self.state is None else self.state.value

    def request(self, now_us: int) -> CanFrame | None:
        """Return the next SDO request of the identification when one is due."""
        return self.identification.due(now_us)

    def restart(self) -> None:
        """Forget state and identification: the drive has booted."""
        self.forget()
        self.identification.restart()

    def forget(self) -> None:
        """Forget the state, keep the identification: the bus was lost."""
        self.joint = None
        self.homing = None
        self.state = None

    def _take_motion(self, stamp_us: int, scale: DriveScale, position: int, velocity: int) -> None:
        self._position = position
        self.joint = JointState(
            stamp_us=stamp_us,
            position_rad=self._direction * scale.to_rad(position) + self._zero_offset_rad,
            velocity_rad_s=self._direction * scale.to_rad(velocity),
        )

    def _take_status(self, scale: DriveScale, statusword: int, torque: int) -> None:
        self.state = state_of(statusword)
        self._set_point_taken = bool(statusword & SET_POINT_TAKEN)
        self.torque_Nm = self._direction * scale.to_Nm(torque)

    def _words(self, order: JointCommand) -> tuple[int, OperationMode, int]:
        """Return controlword, mode and target for this tick.

        The target is the order's together with the controlword Enable operation, otherwise 0 or the present
        position. Raises BusError before the drive is identified.
        """
        scale, mode = self.scale, self.identification.mode
        if scale is None:
            raise BusError(
                f"{self.name}: no command is possible before 6076h is read: identify the drive first"
            )
        word = controlword_for(self.state, order.goal, self._last_word)
        self._last_word = word
        is_homing = order.goal is DriveGoal.HOME
        is_on = word is Controlword.ENABLE_OPERATION and self.is_enabled
        bits = 0
        if is_on and is_homing and self.homing is HomingState.MISSING:
            bits = START_HOMING
        elif is_on and mode is OperationMode.PROFILE_POSITION and not is_homing:
            # One set point after another: the next is new once the drive has acknowledged the last.
            bits = CHANGE_AT_ONCE | (0 if self._set_point_taken else NEW_SET_POINT)
        follows = word is Controlword.ENABLE_OPERATION and not is_homing
        target = self._number(order, scale) if follows else self._target_at_rest()
        return int(word) | bits, OperationMode.HOMING if is_homing else mode, target

    def _number(self, order: JointCommand, scale: DriveScale) -> int:
        """Return the target in the drive's own units and direction."""
        match order.goal:
            case DriveGoal.TORQUE:
                return self._direction * scale.to_per_mille(order.torque_Nm)
            case DriveGoal.VELOCITY:
                return self._direction * scale.to_increments(order.velocity_rad_s)
            case _:
                return self._direction * scale.to_increments(order.position_rad - self._zero_offset_rad)

    def _target_at_rest(self) -> int:
        return self._position if self._follows is Follows.POSITION else 0
