"""Types and helpers that every room of the host uses.

Belongs here: rotations, commands, status, modes, joint commands. May use: palpate_edge.common, can_bus,
node.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["CommandError", "HostStatus", "JointCommand", "JointState", "Mode", "TipContact"]

__getattr__ = lazy_exports(
    __name__,
    {
        "command": "CommandError",
        "joint_command": "JointCommand JointState",
        "mode": "Mode",
        "status": "HostStatus",
        "tip_contact": "TipContact",
    },
)
