"""All drives of the hand in the order of q: frames in, joint angles out, one tick's commands out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.arrays import Array
from palpate_host.common.joint_command import DriveGoal, JointCommand
from palpate_host.common.status import JointStatus
from palpate_host.config.hand_config import HandConfig
from palpate_host.drives.drive import needs_of
from palpate_host.drives.homing import HomingRun
from palpate_host.drives.joint_orders import JointOrders
from palpate_host.drives.registry import make_drives


class DriveGroup:
    """All drives of the hand; `receive` takes frames with the identifiers in `receive_ids`."""

    def __init__(self, config: HandConfig) -> None:
        """Make each joint's drive by its key in hand.toml; ConfigError when a key is unknown."""
        self._names = [joint.name for joint in config.joints]
        self.drives = make_drives(needs_of(config))
        self._node_ids = tuple(dict.fromkeys(drive.node_id for drive in self.drives))
        self.homing = HomingRun(config.homing, self.drives)
        self._orders = JointOrders(config.joints, config.control)
        self._indices_by_id: dict[int, list[int]] = {}
        for index, drive in enumerate(self.drives):
            for can_id in drive.receive_ids:
                self._indices_by_id.setdefault(can_id, []).append(index)
        # Part of each joint state's age in which the host sent no SYNC.
        self._excused_us = [0] * len(self.drives)
        self.receive_ids = frozenset(self._indices_by_id)

    def receive(self, stamp_us: int, frame: CanFrame) -> None:
        """Take the frame of a drive, or of the axes of a node. Raises BusError when a drive rejects it."""
        for index in self._indices_by_id[frame.can_id]:
            drive = self.drives[index]
            joint = drive.joint
            drive.receive(stamp_us, frame)
            if drive.joint is not joint:
                self._excused_us[index] = 0

    def has(self, node_id: int) -> bool:
        """Return whether the node is a drive."""
        return any(drive.node_id == node_id for drive in self.drives)

    def booted(self, node_id: int) -> None:
        """Forget what the node reported before it booted; nothing happens when it is no drive."""
        for drive in self.drives:
            if drive.node_id == node_id:
                drive.restart()
                self.homing.booted(node_id)

    def forget(self) -> None:
        """Forget every drive's state, keep its identification: the bus was lost."""
        for drive in self.drives:
            drive.forget()

    def requests(self, now_us: int, is_up: Sequence[bool]) -> list[CanFrame]:
        """Return the start-up requests to the drives that are up and not identified.

        Axes of one node are identified one after another, since a node has one SDO server.
        """
        frames, waiting = [], set()
        for drive, up in zip(self.drives, is_up, strict=True):
            if up and drive.node_id not in waiting:
                frame = drive.request(now_us)
                if frame is not None:
                    frames.append(frame)
            if not drive.is_identified:
                waiting.add(drive.node_id)
        return frames

    def identified(self) -> list[int]:
        """Return the ids of the nodes that may be started: all of their drives are identified."""
        waiting = {drive.node_id for drive in self.drives if not drive.is_identified}
        return [node_id for node_id in self._node_ids if node_id not in waiting]

    def angles(self) -> tuple[Array, Array] | None:
        """Return (q, qdot), each (nq,), in rad and rad/s; None until every joint has reported."""
        states = [drive.joint for drive in self.drives]
        q = [state.position_rad for state in states if state is not None]
        qdot = [state.velocity_rad_s for state in states if state is not None]
        return (np.array(q), np.array(qdot)) if len(q) == len(states) else None

    def sampled_after(self, time_us: int) -> bool:
        """Return whether every joint's state came after `time_us` (the last SYNC): one coherent sample."""
        return all(drive.joint is not None and drive.joint.stamp_us >= time_us for drive in self.drives)

    def waiting(self) -> str:
        """Return the first drive that is not enabled or has no position, with its state; empty for none."""
        for drive in self.drives:
            if not drive.is_enabled or drive.joint is None:
                return f"{drive.name} ({drive.state_name})"
        return ""

    def excuse(self, from_us: int, to_us: int) -> None:
        """Note that the host itself sent no SYNC from `from_us` to `to_us`, so no drive could answer."""
        for index, drive in enumerate(self.drives):
            if drive.joint is not None:
                self._excused_us[index] += max(0, to_us - max(from_us, drive.joint.stamp_us))

    def lost_joint(self, now_us: int, limit_us: int) -> str:
        """Return the first joint whose position is older than `limit_us`; empty for none.

        Time in which the host sent no SYNC does not count, up to another `limit_us`.
        """
        for drive, excused_us in zip(self.drives, self._excused_us, strict=True):
            joint = drive.joint
            if joint is None or now_us - joint.stamp_us - min(excused_us, limit_us) > limit_us:
                where = f"{drive.name} (node 0x{drive.node_id:02X})"
                return f"{where}: no position for more than {limit_us // 1000} ms"
        return ""

    def any_powered(self) -> bool:
        """Return whether some drive still holds or brakes its joint."""
        return any(drive.is_powered for drive in self.drives)

    def commands(self, goal: DriveGoal, torque_Nm: Array) -> list[CanFrame]:
        """Return the command frames to each identified drive.

        `torque_Nm` (nq,) is used with the goal TORQUE, which a drive follows by torque, velocity or position.
        HOME moves the one drive whose turn it is; the others are off.
        """
        if goal is DriveGoal.TORQUE:
            angles = self.angles()
            orders = self._orders.moving(torque_Nm, None if angles is None else angles[0])
        else:
            self._orders.stop()
            turn = self.homing.turn if goal is DriveGoal.HOME else None
            off = DriveGoal.OFF if goal is DriveGoal.HOME else goal
            orders = [JointCommand(goal if i == turn else off) for i in range(len(self.drives))]
        pairs = zip(self.drives, orders, strict=True)
        return [frame for drive, order in pairs if drive.is_identified for frame in drive.command(order)]

    def status(self, command_Nm: Array) -> tuple[JointStatus, ...]:
        """Return every joint's status; `command_Nm` (nq,) is the last command."""
        return tuple(
            JointStatus(
                name=name,
                position_rad=None if drive.joint is None else drive.joint.position_rad,
                velocity_rad_s=None if drive.joint is None else drive.joint.velocity_rad_s,
                command_Nm=float(command),
                torque_Nm=drive.torque_Nm,
                drive_state=drive.state_name,
            )
            for name, drive, command in zip(self._names, self.drives, command_Nm, strict=True)
        )
