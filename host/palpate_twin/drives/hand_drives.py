"""Create the simulated drives of a hand."""

from __future__ import annotations

from collections.abc import Sequence

from palpate_edge.common.errors import ConfigError
from palpate_host.config.hand_config import HandConfig
from palpate_twin.drives.drive_plant import JointParameters
from palpate_twin.drives.simulated_drives import SimulatedAxes, SimulatedDrive

SIMULATED = "cia402"
"""Value of `drive` in hand.toml for drives that can be simulated."""


def drives_of(config: HandConfig, grasp_pose_rad: Sequence[float]) -> list[SimulatedDrive | SimulatedAxes]:
    """Return the drive nodes of a hand, at rest in the grasp pose, which is the same for every finger.

    One per joint, and one for all joints that are axes of the same node.
    Raises ConfigError if the pose does not have one angle per joint of a finger, or for a drive of another
    type.
    """
    nodes: dict[int, SimulatedDrive | SimulatedAxes] = {}
    axes: dict[int, dict[int, JointParameters]] = {}
    for finger in config.fingers:
        if len(finger.joints) != len(grasp_pose_rad):
            raise ConfigError(
                f"--pose-rad has {len(grasp_pose_rad)} angles, but {finger.name} has "
                f"{len(finger.joints)} joints: give one angle per joint of a finger"
            )
        for joint, angle_rad in zip(finger.joints, grasp_pose_rad, strict=True):
            if joint.drive != SIMULATED:
                raise ConfigError(
                    f"{joint.name} has drive = {joint.drive!r}, but only {SIMULATED!r} can be simulated:"
                    " start that drive's own simulation, or remove the key"
                )
            # q = direction * angle of the drive + offset, hence for the drive's own angle:
            ends_rad = [joint.direction * (q - joint.zero_offset_rad) for q in (joint.min_rad, joint.max_rad)]
            parameters = JointParameters(
                grasp_rad=joint.direction * (angle_rad - joint.zero_offset_rad),
                min_rad=min(ends_rad),
                max_rad=max(ends_rad),
            )
            if joint.axis is None:
                nodes[joint.drive_node] = SimulatedDrive(joint.drive_node, parameters)
            else:
                axes.setdefault(joint.drive_node, {})[joint.axis] = parameters
    nodes |= {node_id: SimulatedAxes(node_id, of_node) for node_id, of_node in axes.items()}
    return [nodes[node_id] for node_id in dict.fromkeys(joint.drive_node for joint in config.joints)]
