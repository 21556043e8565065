"""The master's side of a CiA 402 drive (CiA 402-2; IEC 61800-7-201).

The frames are those of cia402.eds: RPDO 1 carries controlword, mode and target, TPDO 1 position and velocity
after each SYNC, TPDO 2 statusword, mode display and torque. Torque is per mille of 6076h, position in
6092h:01 increments a turn; both are read from the drive at start-up (identify.py).
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, replace

from palpate_bus.eds.cia402 import (
    CIA402_EDS,
    MODE_DISPLAY,
    POSITION,
    STATUSWORD,
    TORQUE,
    VELOCITY,
    Controlword,
    DriveState,
    state_of,
)
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.errors import BusError
from palpate_edge.node.eds import load_eds
from palpate_edge.node.pdo_codec import MappingFault, PdoCodec, PdoDirection, layout_of, pdo_codec
from palpate_host.common.joint_command import DriveGoal, Follows, JointCommand, JointState
from palpate_host.drives.cia402_modes import COMMAND_MAPPING, CONTROLWORD, MODE, TARGETS, OperationMode

FULL_SCALE_PER_MILLE = 1000

# Controlword and statusword bits that a mode gives a meaning to (CiA 402-2).
NEW_SET_POINT, CHANGE_AT_ONCE = 1 << 4, 1 << 5  # profile position
SET_POINT_TAKEN = 1 << 12
START_HOMING = 1 << 4  # homing
HOMING_ATTAINED, HOMING_ERROR = 1 << 12, 1 << 13


class Homing(enum.Enum):
    """What a drive in homing mode says of its zero."""

    MISSING = "missing"
    ATTAINED = "attained"
    ERROR = "error"


_NEXT_TO_ENABLED = {
    DriveState.SWITCH_ON_DISABLED: Controlword.SHUTDOWN,
    DriveState.READY_TO_SWITCH_ON: Controlword.SWITCH_ON,
    DriveState.SWITCHED_ON: Controlword.ENABLE_OPERATION,
    DriveState.OPERATION_ENABLED: Controlword.ENABLE_OPERATION,
    DriveState.FAULT: Controlword.FAULT_RESET,
}
_CAN_QUICK_STOP = (DriveState.OPERATION_ENABLED, DriveState.QUICK_STOP_ACTIVE)


def controlword_for(state: DriveState | None, goal: DriveGoal, last: Controlword) -> Controlword:
    """The next command on the way from `state` to `goal`; `last` was sent before (a reset needs an edge)."""
    if goal is DriveGoal.QUICK_STOP:
        return Controlword.QUICK_STOP if state in _CAN_QUICK_STOP else Controlword.DISABLE_VOLTAGE
    if goal is DriveGoal.OFF or state is None:
        return Controlword.DISABLE_VOLTAGE
    word = _NEXT_TO_ENABLED.get(state, Controlword.DISABLE_VOLTAGE)
    if word is Controlword.FAULT_RESET and last is Controlword.FAULT_RESET:
        return Controlword.DISABLE_VOLTAGE
    return word


@dataclass(frozen=True, slots=True)
class DriveScale:
    """What turns the drive's integers into SI: 6076h in mN m, 6092h:01 increments a turn of the joint."""

    rated_torque_mNm: int
    increments_per_turn: int

    def to_rad(self, increments: int) -> float:
        return increments * math.tau / self.increments_per_turn

    def to_increments(self, angle_rad: float) -> int:
        return round(angle_rad * self.increments_per_turn / math.tau)

    def to_per_mille(self, torque_Nm: float) -> int:
        """Per mille of the rated torque, rounded towards zero so that no limit is passed, at most 1000."""
        per_mille = math.trunc(torque_Nm * 1000.0 * FULL_SCALE_PER_MILLE / self.rated_torque_mNm)
        return max(-FULL_SCALE_PER_MILLE, min(FULL_SCALE_PER_MILLE, per_mille))

    def to_Nm(self, per_mille: int) -> float:
        return per_mille * self.rated_torque_mNm / (1000.0 * FULL_SCALE_PER_MILLE)


class Cia402Drive:
    """One drive as its master sees it: frames in, joint state and statusword out; commands in, RPDO out."""

    def __init__(
        self,
        node_id: int,
        name: str,
        direction: int,
        zero_offset_rad: float,
        follows: Follows = Follows.TORQUE,
    ) -> None:
        """`direction` (1 or -1) and `zero_offset_rad` turn the drive's angle into the joint's."""
        od = load_eds(CIA402_EDS, node_id)
        self.node_id = node_id
        self.name = name
        self.scale: DriveScale | None = None
        self.mode = OperationMode.CYCLIC_TORQUE
        self.homing: Homing | None = None
        self.joint: JointState | None = None
        self.not_asked_us = 0  # of the time since `joint` came
        self.torque_Nm = 0.0
        self.status_stamp_us: int | None = None
        self.state: DriveState | None = None
        self._direction = direction
        self._zero_offset_rad = zero_offset_rad
        self._motion = pdo_codec(od, PdoDirection.TRANSMIT, 1)
        self._status = pdo_codec(od, PdoDirection.TRANSMIT, 2)
        self._command = command_codec(node_id, follows)
        self._target = TARGETS[follows]
        self._position = 0
        self._set_point_taken = False
        self._last_word = Controlword.DISABLE_VOLTAGE

    @property
    def receive_ids(self) -> tuple[int, ...]:
        """The identifiers that `receive` understands."""
        return (self._motion.cob_id, self._status.cob_id)

    def receive(self, stamp_us: int, frame: CanFrame) -> None:
        """Take a TPDO in; BusError naming node and PDO when its length is not the EDS's."""
        if self.scale is None:
            return
        if frame.can_id == self._motion.cob_id:
            values = self._motion.decode(frame.data)
            self._position = values[POSITION]
            self.not_asked_us = 0
            self.joint = JointState(
                stamp_us=stamp_us,
                position_rad=self._direction * self.scale.to_rad(values[POSITION]) + self._zero_offset_rad,
                velocity_rad_s=self._direction * self.scale.to_rad(values[VELOCITY]),
            )
        elif frame.can_id == self._status.cob_id:
            values = self._status.decode(frame.data)
            self.status_stamp_us = stamp_us
            word = values[STATUSWORD]
            self.state = state_of(word)
            self._set_point_taken = bool(word & SET_POINT_TAKEN)
            self.homing = _homing(word) if values[MODE_DISPLAY] == OperationMode.HOMING else None
            self.torque_Nm = self._direction * self.scale.to_Nm(values[TORQUE])

    def forget(self) -> None:
        """The node booted anew: what it said before counts no more."""
        self.joint = None
        self.homing = None
        self.state = None
        self.status_stamp_us = None

    def command(self, order: JointCommand) -> CanFrame:
        """RPDO 1 for this tick; a target is sent only to a drive that follows it."""
        if self.scale is None:
            raise BusError(f"{self.name}: commanded before 6076h was read: identify the drive first")
        word = controlword_for(self.state, order.goal, self._last_word)
        self._last_word = word
        is_homing = order.goal is DriveGoal.HOME
        is_on = word is Controlword.ENABLE_OPERATION and self.state is DriveState.OPERATION_ENABLED
        bits = 0
        if is_on and is_homing and self.homing is Homing.MISSING:
            bits = START_HOMING
        elif is_on and self.mode is OperationMode.PROFILE_POSITION and not is_homing:
            # One set point after the other: the next is new once the drive has said that it took the last.
            bits = CHANGE_AT_ONCE | (0 if self._set_point_taken else NEW_SET_POINT)
        follows = word is Controlword.ENABLE_OPERATION and not is_homing
        values = {
            CONTROLWORD: int(word) | bits,
            MODE: OperationMode.HOMING if is_homing else self.mode,
            self._target: self._number(order, self.scale) if follows else self._at_rest(),
        }
        return CanFrame(self._command.cob_id, self._command.encode(values))

    def _number(self, order: JointCommand, scale: DriveScale) -> int:
        """The target in the drive's own units and direction."""
        match order.goal:
            case DriveGoal.TORQUE:
                return self._direction * scale.to_per_mille(order.torque_Nm)
            case DriveGoal.VELOCITY:
                return self._direction * scale.to_increments(order.velocity_rad_s)
            case _:
                return self._direction * scale.to_increments(order.position_rad - self._zero_offset_rad)

    def _at_rest(self) -> int:
        return self._position if self._target == TARGETS[Follows.POSITION] else 0


def command_codec(node_id: int, follows: Follows) -> PdoCodec:
    """RPDO 1 of a drive that follows this: the EDS's, or as identify.py maps it anew."""
    od = load_eds(CIA402_EDS, node_id)
    layout = layout_of(od, COMMAND_MAPPING[follows], PdoDirection.RECEIVE)
    if isinstance(layout, MappingFault):
        raise BusError(f"{od.source}: RPDO 1 maps {layout.value}: restore the file")
    return replace(pdo_codec(od, PdoDirection.RECEIVE, 1), layout=layout)


def _homing(statusword: int) -> Homing:
    if statusword & HOMING_ERROR:
        return Homing.ERROR
    return Homing.ATTAINED if statusword & HOMING_ATTAINED else Homing.MISSING
