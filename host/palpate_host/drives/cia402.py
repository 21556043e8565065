"""The master's side of a CiA 402 drive that is a node of its own (CiA 402-2; IEC 61800-7-201).

The frames are those of cia402.eds: RPDO 1 carries controlword, mode and target, TPDO 1 position and velocity
after each SYNC, TPDO 2 statusword, mode display and torque. cia402_axes.py has nodes with several axes.
"""

from __future__ import annotations

import msgspec

from palpate_bus.eds.cia402 import (
    CIA402_EDS,
    MODE_DISPLAY,
    POSITION,
    STATUSWORD,
    TORQUE,
    VELOCITY,
)
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.errors import BusError
from palpate_edge.node.eds import load_eds
from palpate_edge.node.pdo_codec import MappingFault, PdoCodec, PdoDirection, layout_of, pdo_codec
from palpate_host.common.joint_command import Follows, JointCommand
from palpate_host.drives.axis_master import AxisMaster, homing_state
from palpate_host.drives.cia402_modes import (
    COMMAND_MAPPING,
    CONTROLWORD,
    MODE,
    TARGETS,
    OperationMode,
)
from palpate_host.drives.drive import DriveNeeds


class Cia402Drive(AxisMaster):
    """One CiA 402 drive: start-up transfers, TPDOs in, RPDO 1 out (a `Drive`, key ``cia402``)."""

    def __init__(self, needs: DriveNeeds) -> None:
        super().__init__(needs)
        od = load_eds(CIA402_EDS, needs.node_id)
        self._motion = pdo_codec(od, PdoDirection.TRANSMIT, 1)
        self._status = pdo_codec(od, PdoDirection.TRANSMIT, 2)
        self._command = command_codec(needs.node_id, needs.follows)
        self._target = TARGETS[needs.follows]

    @property
    def receive_ids(self) -> tuple[int, ...]:
        """TPDO 1, TPDO 2 and SDO responses."""
        return (self._motion.cob_id, self._status.cob_id, self.identification.reply_id)

    def receive(self, stamp_us: int, frame: CanFrame) -> None:
        """Take a TPDO or an SDO response.

        Raises BusError for a PDO whose length differs from the EDS, and when the drive lacks an object or a
        mode that the hand needs.
        """
        if frame.can_id == self.identification.reply_id:
            self.identification.receive(frame)
            return
        scale = self.scale
        if scale is None:
            return
        if frame.can_id == self._motion.cob_id:
            values = self._motion.decode(frame.data)
            self._take_motion(stamp_us, scale, values[POSITION], values[VELOCITY])
        elif frame.can_id == self._status.cob_id:
            values = self._status.decode(frame.data)
            word = values[STATUSWORD]
            self._take_status(scale, word, values[TORQUE])
            self.homing = homing_state(word) if values[MODE_DISPLAY] == OperationMode.HOMING else None

    def command(self, order: JointCommand) -> tuple[CanFrame, ...]:
        """Return RPDO 1 for this tick. Raises BusError before the drive is identified."""
        controlword, mode, target = self._words(order)
        values = {CONTROLWORD: controlword, MODE: mode, self._target: target}
        return (CanFrame(self._command.cob_id, self._command.encode(values)),)


def command_codec(node_id: int, follows: Follows) -> PdoCodec:
    """Return the codec of RPDO 1 with the mapping of COMMAND_MAPPING for what the drive follows."""
    od = load_eds(CIA402_EDS, node_id)
    layout = layout_of(od, COMMAND_MAPPING[follows], PdoDirection.RECEIVE)
    if isinstance(layout, MappingFault):
        raise BusError(f"{od.source}: RPDO 1 maps {layout.value}: restore this file from the package")
    return msgspec.structs.replace(pdo_codec(od, PdoDirection.RECEIVE, 1), layout=layout)
