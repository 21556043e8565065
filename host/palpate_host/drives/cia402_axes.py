"""The master's side of a CiA 402 node with several axes on a CAN FD bus (``fingers.joints.axis``).

One frame each way a tick: TPDO 1 carries statusword, position, velocity and torque of each axis after each
SYNC, for axes behind the fifth TPDO 2; RPDO 1 carries controlword and target of each axis. The axes stand in
the order of their numbers. The mode has no place in them: it is written over SDO, at start-up and around a
homing.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

from palpate_bus.eds.cia402_axes import (
    CONTROLWORD_WORD,
    axes_codec,
    axes_of_tpdos,
    axis_key,
    command_words,
    state_words,
)
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.node.object_dictionary import ObjectKey
from palpate_edge.node.pdo_codec import PdoCodec, PdoDirection
from palpate_host.common.joint_command import DriveGoal, Follows, JointCommand
from palpate_host.drives.axis_master import AxisMaster, homing_state
from palpate_host.drives.axis_mode import AxisMode
from palpate_host.drives.cia402_modes import COMMAND_MAPPING, OperationMode
from palpate_host.drives.drive import DriveNeeds, HomingState

AXIS_STATE = struct.Struct("<Hiih")  # statusword, position, velocity, torque
FOLLOWING = (DriveGoal.TORQUE, DriveGoal.VELOCITY, DriveGoal.POSITION)


def target_word(follows: Follows) -> int:
    """Return the mapping word of axis 0's target."""
    return COMMAND_MAPPING[follows][-1]


def axes_command_codec(node_id: int, axes: Sequence[int], follows: Follows) -> PdoCodec:
    """Return the codec of RPDO 1 of a node with these axes."""
    return axes_codec(node_id, PdoDirection.RECEIVE, 1, command_words(axes, target_word(follows)))


class AxesCommand:
    """RPDO 1 of one node, put together from the commands of its axes in one tick."""

    def __init__(self, node_id: int, axes: Sequence[int], follows: Follows) -> None:
        self._codec = axes_command_codec(node_id, axes, follows)
        self._values: dict[ObjectKey, int] = {}

    def put(self, values: dict[ObjectKey, int]) -> None:
        """Set the objects of one axis."""
        self._values.update(values)

    def take(self) -> tuple[CanFrame, ...]:
        """Return the frame, none while an axis is missing, and begin the next one."""
        values, self._values = self._values, {}
        if len(values) < len(self._codec.layout.keys):
            return ()
        return (CanFrame(self._codec.cob_id, self._codec.encode(values), fd=True),)


class AxisDrive(AxisMaster):
    """One axis of a node (a `Drive`). The last joint of the node in the order of q sends the frame of all."""

    def __init__(self, needs: DriveNeeds, axes_command: AxesCommand) -> None:
        super().__init__(needs)
        axis = needs.joint.axis
        assert axis is not None
        tpdos = axes_of_tpdos(needs.axes)
        number, own = next((i, part) for i, part in enumerate(tpdos, 1) if axis in part)
        self._state = axes_codec(needs.node_id, PdoDirection.TRANSMIT, number, state_words(own))
        self._offset = own.index(axis) * AXIS_STATE.size
        self._controlword, self._target = (
            axis_key((word >> 16, 0), axis) for word in (CONTROLWORD_WORD, target_word(needs.follows))
        )
        self._command, self._is_last = axes_command, needs.is_last_of_node
        self._mode = AxisMode(needs)
        self._is_home = False

    @property
    def receive_ids(self) -> tuple[int, ...]:
        """The TPDO that has this axis, and SDO responses."""
        return (self._state.cob_id, self.identification.reply_id)

    def request(self, now_us: int) -> CanFrame | None:
        """Return the next SDO request of the identification, or of a change of mode, when one is due."""
        return self._mode.due(now_us) if self.is_identified else super().request(now_us)

    def restart(self) -> None:
        """Forget state, identification and zero: the node has booted."""
        super().restart()
        self._mode.restart()
        self._is_home = False

    def receive(self, stamp_us: int, frame: CanFrame) -> None:
        """Take a TPDO or an SDO response.

        Raises BusError for a PDO of another length, and when the node lacks an object or a mode that the hand
        needs.
        """
        if frame.can_id == self.identification.reply_id:
            self.identification.receive(frame)
            self._mode.receive(frame)
            return
        scale = self.scale
        if scale is None:
            return
        self._state.check_length(frame.data)
        statusword, position, velocity, torque = AXIS_STATE.unpack_from(frame.data, self._offset)
        self._take_motion(stamp_us, scale, position, velocity)
        self._take_status(scale, statusword, torque)
        self._take_homing(statusword)

    def _take_homing(self, statusword: int) -> None:
        """Update the state of homing, which is attained when the axis is back in its working mode."""
        self.homing = None
        if not self._mode.is_in_effect:
            return
        if self._mode.wanted is OperationMode.HOMING:
            self.homing = homing_state(statusword)
            if self.homing is HomingState.ATTAINED:
                self._is_home, self.homing = True, None
        elif self._is_home:
            self.homing = HomingState.ATTAINED

    def command(self, order: JointCommand) -> tuple[CanFrame, ...]:
        """Return RPDO 1 of the node when this is its last joint. Raises BusError before the axis is
        identified.

        While the mode changes, and until an axis is back in its working mode, it follows no target.
        """
        working = self.identification.mode
        seeks_home = order.goal is DriveGoal.HOME and not self._is_home
        self._mode.want(OperationMode.HOMING if seeks_home else working, working)
        if order.goal in FOLLOWING and not self._mode.is_in_effect:
            order = JointCommand(DriveGoal.OFF)
        controlword, _, target = self._words(order)
        self._command.put({self._controlword: controlword, self._target: target})
        return self._command.take() if self._is_last else ()


def axes_of_node(needs: Sequence[DriveNeeds]) -> list[AxisDrive]:
    """Return the drives of the joints of one node, in the given order."""
    first = needs[0]
    axes_command = AxesCommand(first.node_id, first.axes, first.follows)
    return [AxisDrive(one, axes_command) for one in needs]
