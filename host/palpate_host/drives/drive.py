"""The interface between the host and one joint's drive, the same for every protocol on the bus."""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import Protocol

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_host.common.joint_command import Follows, JointCommand, JointState
from palpate_host.config.control_config import ControlConfig
from palpate_host.config.hand_config import HandConfig, HomingConfig, JointConfig

NO_STATUS = "no status"
"""The `state_name` of a drive that has not reported since it booted."""


class HomingState(enum.Enum):
    """The zero of a drive that is in homing mode."""

    MISSING = "missing"
    ATTAINED = "attained"
    ERROR = "error"


@dataclass(frozen=True, slots=True)
class DriveNeeds:
    """Part of hand.toml from which one drive is made.

    joint: the joint's entry. control: `control.drives_follow` and the limits of velocity and position drives.
    homing: None when drives keep their zero. axes: of a node with several axes, those that the hand uses, in
    the order of their numbers; empty for a node of its own. is_last_of_node: no joint behind this one in the
    order of q has the same node.
    """

    node_id: int
    joint: JointConfig
    control: ControlConfig
    homing: HomingConfig | None
    axes: tuple[int, ...] = ()
    is_last_of_node: bool = True

    @property
    def axis(self) -> int:
        """The axis of the node, 0 for a node of its own."""
        return self.joint.axis or 0

    @property
    def name(self) -> str:
        """The drive's name in messages."""
        return f"drive of {self.joint.name}"

    @property
    def name_on_bus(self) -> str:
        """The drive's name with its node, and its axis of a node with several."""
        axis = f", axis {self.axis}" if self.axes else ""
        return f"{self.name} (node 0x{self.node_id:02X}{axis})"

    @property
    def follows(self) -> Follows:
        return self.control.drives_follow


def needs_of(config: HandConfig) -> list[DriveNeeds]:
    """Return the needs of every joint, in the order of q."""
    axes, last = config.node_axes, {joint.drive_node: joint.name for joint in config.joints}
    return [
        DriveNeeds(
            joint.drive_node,
            joint,
            config.control,
            config.homing,
            axes.get(joint.drive_node, ()),
            last[joint.drive_node] == joint.name,
        )
        for joint in config.joints
    ]


class Drive(Protocol):
    """One drive as the host uses it: frames in, joint state out; one command a tick in, frames out.

    A drive has no clock and no bus of its own: times and frames are arguments, so that a bus log replays
    exactly. It is made once, by the factory that registry.py finds for `fingers.joints.drive`.
    """

    @property
    def node_id(self) -> int:
        """`fingers.joints.drive_node`."""
        ...

    @property
    def name(self) -> str:
        """The drive's name in messages, for example ``drive of abduction_1``."""
        ...

    @property
    def uses_nmt(self) -> bool:
        """True for a CANopen node, which is reset and started over NMT and supervised by its heartbeat.

        Any other drive is supervised by the age of its position alone (`staleness.joint_stop_ms`).
        """
        ...

    @property
    def receive_ids(self) -> tuple[int, ...]:
        """The identifiers of the frames that `receive` takes."""
        ...

    @property
    def is_identified(self) -> bool:
        """True once all start-up requests have their responses: the drive may be started and commanded."""
        ...

    @property
    def is_enabled(self) -> bool:
        """True while the drive follows commands."""
        ...

    @property
    def is_powered(self) -> bool:
        """True while the drive holds or brakes its joint."""
        ...

    @property
    def state_name(self) -> str:
        """The drive's state for messages and status, `NO_STATUS` when it is unknown."""
        ...

    @property
    def joint(self) -> JointState | None:
        """The joint's last measured state, None when it is unknown; a new object for each measurement."""
        ...

    @property
    def torque_Nm(self) -> float:
        """The torque that the drive reports, in the joint's sense of direction."""
        ...

    @property
    def homing(self) -> HomingState | None:
        """The result of homing, None outside of it. A drive that keeps its zero returns ATTAINED."""
        ...

    def request(self, now_us: int) -> CanFrame | None:
        """Return the next start-up request when one is due."""
        ...

    def receive(self, stamp_us: int, frame: CanFrame) -> None:
        """Take a frame with one of `receive_ids`. Raises BusError for a frame that violates the protocol."""
        ...

    def restart(self) -> None:
        """Forget state and identification: the drive has booted."""
        ...

    def forget(self) -> None:
        """Forget the state, keep the identification: the bus was lost."""
        ...

    def command(self, order: JointCommand) -> tuple[CanFrame, ...]:
        """Return the frames that command the drive for this tick; called only once identified.

        `DriveGoal.OFF` and `DriveGoal.QUICK_STOP` must end without torque in every state of the drive.
        """
        ...
