"""RPDO 1 of each drive node of a hand, to read the host's commands from a log."""

from __future__ import annotations

from dataclasses import dataclass

from palpate_bus.eds.cia402_axes import axis_key
from palpate_edge.node.pdo_codec import PdoCodec
from palpate_host.common.joint_command import Follows
from palpate_host.config.hand_config import HandConfig
from palpate_host.drives.cia402 import command_codec
from palpate_host.drives.cia402_axes import axes_command_codec
from palpate_host.drives.cia402_modes import CONTROLWORD, TARGET_TORQUE


@dataclass(frozen=True, slots=True)
class TorqueCommand:
    """RPDO 1 of a node whose drives follow torque. axes: joint, by its place in q, and axis."""

    codec: PdoCodec
    axes: tuple[tuple[int, int], ...]

    def per_mille(self, data: bytes) -> dict[int, int]:
        """Return the target torque by joint. Raises BusError for another length."""
        values = self.codec.decode(data)
        return {joint: values[axis_key(TARGET_TORQUE, axis)] for joint, axis in self.axes}

    def controlword(self, data: bytes, joint: int) -> int:
        """Return the controlword of a joint. Raises BusError for another length."""
        return self.codec.decode(data)[axis_key(CONTROLWORD, dict(self.axes)[joint])]


def torque_commands(config: HandConfig) -> dict[int, TorqueCommand]:
    """Return RPDO 1 of every drive node by its identifier."""
    commands = {}
    for node_id in dict.fromkeys(joint.drive_node for joint in config.joints):
        of_node = [(i, joint) for i, joint in enumerate(config.joints) if joint.drive_node == node_id]
        axes = config.node_axes.get(node_id)
        codec = (
            command_codec(node_id, Follows.TORQUE)
            if axes is None
            else axes_command_codec(node_id, axes, Follows.TORQUE)
        )
        commands[codec.cob_id] = TorqueCommand(codec, tuple((i, joint.axis or 0) for i, joint in of_node))
    return commands
