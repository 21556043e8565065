"""All drives of the hand in the order of q: frames in, joint angles out, one tick's commands out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from palpate_bus.eds.cia402 import DriveState
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.arrays import Array
from palpate_host.common.joint_command import DriveGoal, JointCommand
from palpate_host.common.status import JointStatus
from palpate_host.config.hand_config import HandConfig
from palpate_host.drives.cia402 import Cia402Drive
from palpate_host.drives.drive_settings import needs_of
from palpate_host.drives.homing import HomingRun
from palpate_host.drives.identify import DriveIdentification
from palpate_host.drives.joint_orders import JointOrders

_POWERED = (DriveState.OPERATION_ENABLED, DriveState.QUICK_STOP_ACTIVE)


class DriveGroup:
    """The hand's drives as one; `receive` understands the identifiers `receive_ids`."""

    def __init__(self, config: HandConfig) -> None:
        joints, follows = config.joints, config.control.drives_follow
        self._names = [joint.name for joint in joints]
        self.drives = tuple(
            Cia402Drive(j.drive_node, f"drive of {j.name}", j.direction, j.zero_offset_rad, follows)
            for j in joints
        )
        self.homing = HomingRun(config.homing, self.drives)
        self._orders = JointOrders(joints, config.control)
        self._identifications = {
            drive.node_id: DriveIdentification(drive.node_id, drive.name, needs)
            for drive, needs in zip(self.drives, needs_of(config), strict=True)
        }
        self._by_id = {can_id: drive for drive in self.drives for can_id in drive.receive_ids}
        self._by_reply = {i.reply_id: i for i in self._identifications.values()}
        self.receive_ids = frozenset((*self._by_id, *self._by_reply))

    def receive(self, stamp_us: int, frame: CanFrame) -> None:
        """Take a TPDO or an SDO reply in; BusError when it cannot be what the EDS says."""
        if frame.can_id in self._by_id:
            self._by_id[frame.can_id].receive(stamp_us, frame)
            return
        identification = self._by_reply[frame.can_id]
        identification.receive(frame)
        for drive in self.drives:
            drive.scale = self._identifications[drive.node_id].scale
            drive.mode = self._identifications[drive.node_id].mode

    def has(self, node_id: int) -> bool:
        """Whether the node is a drive."""
        return node_id in self._identifications

    def booted(self, node_id: int) -> None:
        """A node booted anew; nothing happens when it is no drive."""
        for drive in self.drives:
            if drive.node_id == node_id:
                drive.forget()
                self._identifications[node_id].restart()
                drive.scale = None
                self.homing.booted(node_id)

    def forget(self) -> None:
        """The bus was lost: what any drive said before counts no more; what it is stays known."""
        for drive in self.drives:
            drive.forget()

    def questions(self, now_us: int, is_up: Sequence[bool]) -> list[CanFrame]:
        """SDO requests to the drives that are up and not identified."""
        due = (
            self._identifications[drive.node_id].due(now_us)
            for drive, up in zip(self.drives, is_up, strict=True)
            if up
        )
        return [frame for frame in due if frame is not None]

    def identified(self) -> list[int]:
        """Node ids of the drives that may be started."""
        return [drive.node_id for drive in self.drives if drive.scale is not None]

    def angles(self) -> tuple[Array, Array] | None:
        """(q, qdot), each (nq,), in rad and rad/s; None until every joint has told its own."""
        states = [drive.joint for drive in self.drives]
        q = [state.position_rad for state in states if state is not None]
        qdot = [state.velocity_rad_s for state in states if state is not None]
        return (np.array(q), np.array(qdot)) if len(q) == len(states) else None

    def sampled_after(self, time_us: int) -> bool:
        """Whether every joint's state arrived after `time_us` (the last SYNC): one coherent sample."""
        return all(drive.joint is not None and drive.joint.stamp_us >= time_us for drive in self.drives)

    def waiting(self) -> str:
        """The first drive that is not enabled or has told no position, with its state; empty when all are."""
        for drive in self.drives:
            if drive.state is not DriveState.OPERATION_ENABLED or drive.joint is None:
                state = "no status" if drive.state is None else drive.state.value
                return f"{drive.name} ({state})"
        return ""

    def not_asked(self, from_us: int, to_us: int) -> None:
        """The host sent no SYNC meanwhile, by its own fault: no drive is to blame for its silence."""
        for drive in self.drives:
            if drive.joint is not None:
                drive.not_asked_us += max(0, to_us - max(from_us, drive.joint.stamp_us))

    def lost_joint(self, now_us: int, limit_us: int) -> str:
        """The first joint whose position is older than `limit_us`, or than twice that where the drive was not
        asked for a part of it; empty when none is."""
        for drive in self.drives:
            joint = drive.joint
            excused_us = min(drive.not_asked_us, limit_us)
            if joint is None or now_us - joint.stamp_us - excused_us > limit_us:
                where = f"{drive.name} (node 0x{drive.node_id:02X})"
                return f"{where}: no position for more than {limit_us // 1000} ms"
        return ""

    def any_powered(self) -> bool:
        """Whether some drive still holds or brakes its joint."""
        return any(drive.state in _POWERED for drive in self.drives)

    def commands(self, goal: DriveGoal, torque_Nm: Array) -> list[CanFrame]:
        """RPDO 1 to each identified drive.

        `torque_Nm` (nq,) counts with the goal TORQUE, which each drive follows in its own way. HOME moves the
        one drive that has its turn, the others have no power.
        """
        if goal is DriveGoal.TORQUE:
            angles = self.angles()
            orders = self._orders.moving(torque_Nm, None if angles is None else angles[0])
        else:
            self._orders.rest()
            turn = self.homing.turn if goal is DriveGoal.HOME else None
            off = DriveGoal.OFF if goal is DriveGoal.HOME else goal
            orders = [JointCommand(goal if i == turn else off) for i in range(len(self.drives))]
        return [
            drive.command(order)
            for drive, order in zip(self.drives, orders, strict=True)
            if drive.scale is not None
        ]

    def status(self, command_Nm: Array) -> tuple[JointStatus, ...]:
        """Every joint for the view; `command_Nm` (nq,) is what was asked last."""
        return tuple(
            JointStatus(
                name=name,
                position_rad=None if drive.joint is None else drive.joint.position_rad,
                velocity_rad_s=None if drive.joint is None else drive.joint.velocity_rad_s,
                command_Nm=float(command),
                torque_Nm=drive.torque_Nm,
                drive_state="no status" if drive.state is None else drive.state.value,
            )
            for name, drive, command in zip(self._names, self.drives, command_Nm, strict=True)
        )
