"""The simulated drives of a hand as one process on one bus."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterable, Sequence

from palpate_edge.bus import Bus
from palpate_edge.errors import BusError, ConfigError
from palpate_edge.node.events import NodeIdConflict
from palpate_edge.node.slave import Output
from palpate_host.drives.cia402 import DriveState
from palpate_host.hand_config import HandConfig
from palpate_host.twin.drive_plant import JointParameters
from palpate_host.twin.simulated_drives import SimulatedDrive

LONGEST_WAIT_S = 0.05


def drives_of(config: HandConfig, grasp_pose_rad: Sequence[float]) -> list[SimulatedDrive]:
    """One drive for each joint of a hand, at rest in the grasp pose (the same for every finger).

    Raises ConfigError when the pose does not have one angle for each joint of a finger.
    """
    drives = []
    for finger in config.fingers:
        if len(finger.joints) != len(grasp_pose_rad):
            raise ConfigError(
                f"{finger.name} has {len(finger.joints)} joints, the grasp pose {len(grasp_pose_rad)}; "
                "give --pose-rad one angle for each joint of a finger"
            )
        for joint, angle_rad in zip(finger.joints, grasp_pose_rad, strict=True):
            # q = direction * angle of the drive + offset, hence for the drive's own angle:
            ends_rad = [joint.direction * (q - joint.zero_offset_rad) for q in (joint.min_rad, joint.max_rad)]
            parameters = JointParameters(
                grasp_rad=joint.direction * (angle_rad - joint.zero_offset_rad),
                min_rad=min(ends_rad),
                max_rad=max(ends_rad),
            )
            drives.append(SimulatedDrive(joint.drive_node, parameters))
    return drives


def run_drives(bus: Bus, drives: Sequence[SimulatedDrive], stop: threading.Event) -> None:
    """Serve the drives until `stop` is set.

    Raises BusError when the bus is gone or when another node has the id of one of the drives.
    """
    next_due_us = 0
    while not stop.is_set():
        wait_s = min(max(next_due_us - _now_us(), 0) * 1e-6, LONGEST_WAIT_S)
        frames = tuple(frame for _, frame in bus.receive(wait_s))
        now_us = _now_us()
        outputs = [drive.process(now_us, frames) for drive in drives]
        for drive, output in zip(drives, outputs, strict=True):
            _check_conflict(drive, output)
            bus.send(output.frames_out)
        next_due_us = min(output.next_due_us for output in outputs)


def _check_conflict(drive: SimulatedDrive, output: Output) -> None:
    for event in output.events:
        if isinstance(event, NodeIdConflict):
            raise BusError(
                f"node id {drive.slave.node_id} is taken: frame {event.can_id:03X} came from another node; "
                "stop that node or give the drive another id in hand.toml"
            )


def states_line(drives: Iterable[SimulatedDrive]) -> str:
    """One line for a person: how many drives are in which state."""
    states = [drive.state for drive in drives]
    counts = [f"{states.count(state)} {state.value}" for state in DriveState if state in states]
    return ", ".join(counts)


def _now_us() -> int:
    return time.monotonic_ns() // 1000
