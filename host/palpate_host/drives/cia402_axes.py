"""The master's side of a CiA 402 node with several axes on a CAN FD bus (``fingers.joints.axis``).

One frame each way a tick: TPDO 1 carries statusword, position, velocity and torque of each axis after each
SYNC, for axes behind the fifth TPDO 2; RPDO 1 carries controlword and target of each axis. The axes stand in
the order of their numbers. The mode is written at start-up, so there is no homing.
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
from palpate_host.common.joint_command import Follows, JointCommand
from palpate_host.drives.axis_master import AxisMaster
from palpate_host.drives.cia402_modes import COMMAND_MAPPING
from palpate_host.drives.drive import DriveNeeds

AXIS_STATE = struct.Struct("<Hiih")  # statusword, position, velocity, torque


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

    @property
    def receive_ids(self) -> tuple[int, ...]:
        """The TPDO that has this axis, and SDO responses."""
        return (self._state.cob_id, self.identification.reply_id)

    def receive(self, stamp_us: int, frame: CanFrame) -> None:
        """Take a TPDO or an SDO response.

        Raises BusError for a PDO of another length, and when the node lacks an object or a mode that the hand
        needs.
        """
        if frame.can_id == self.identification.reply_id:
            self.identification.receive(frame)
            return
        scale = self.scale
        if scale is None:
            return
        self._state.check_length(frame.data)
        statusword, position, velocity, torque = AXIS_STATE.unpack_from(frame.data, self._offset)
        self._take_motion(stamp_us, scale, position, velocity)
        self._take_status(scale, statusword, torque)

    def command(self, order: JointCommand) -> tuple[CanFrame, ...]:
        """Return RPDO 1 of the node when this is its last joint. Raises BusError before the axis is
        identified."""
        controlword, _, target = self._words(order)
        self._command.put({self._controlword: controlword, self._target: target})
        return self._command.take() if self._is_last else ()


def axes_of_node(needs: Sequence[DriveNeeds]) -> list[AxisDrive]:
    """Return the drives of the joints of one node, in the given order."""
    first = needs[0]
    axes_command = AxesCommand(first.node_id, first.axes, first.follows)
    return [AxisDrive(one, axes_command) for one in needs]
