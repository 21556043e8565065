"""The objects written into a drive at start-up: torque limit, PDO mappings, mode, rates, homing. Pure."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from palpate_bus.eds.cia402_axes import axes_of_tpdos, axis_index, command_words, state_words
from palpate_edge.node.pdo_codec import PdoDirection
from palpate_host.common.joint_command import Follows
from palpate_host.config.hand_config import HomingConfig, JointConfig
from palpate_host.drives.cia402_modes import COMMAND_MAPPING, OperationMode
from palpate_host.drives.cia402_scale import FULL_SCALE_PER_MILLE, DriveScale
from palpate_host.drives.drive import DriveNeeds

RPDO_ID, TPDO_IDS, INVALID, NO_RTR = 0x200, (0x180, 0x280), 1 << 31, 1 << 30
_DOWNLOAD = {1: 0x2F, 2: 0x2B, 4: 0x23}  # expedited download request by size, CiA 301, 7.2.4.3.3


@dataclass(frozen=True, slots=True)
class Write:
    """One expedited download.

    purpose: why it is needed and what to do, for the message when the drive aborts it. otherwise: the
    download to try in that case.
    """

    index: int
    subindex: int
    size: int
    value: int
    purpose: str
    otherwise: Write | None = None

    @property
    def key(self) -> tuple[int, int]:
        return self.index, self.subindex

    def request(self) -> bytes:
        """Return the data of the SDO request."""
        data = (self.value & (1 << 8 * self.size) - 1).to_bytes(4, "little")
        return struct.pack("<BHB", _DOWNLOAD[self.size], self.index, self.subindex) + data


def settings(needs: DriveNeeds, scale: DriveScale, mode: OperationMode) -> Iterator[Write]:
    """Yield the downloads in order.

    There are none for a drive in a node of its own that follows torque and keeps its zero: the host limits
    the torque itself.
    """
    yield from (_of_axis(write, needs.axis) for write in _axis_settings(needs, scale, mode))
    if needs.axes and needs.is_last_of_node:
        yield from _axes_mappings(needs)


def _axis_settings(needs: DriveNeeds, scale: DriveScale, mode: OperationMode) -> Iterator[Write]:
    if needs.follows is not Follows.TORQUE or needs.homing is not None:
        yield _torque_cap(needs.joint, scale)
    if needs.axes:
        yield Write(0x6060, 0, 1, mode, "its mode, which no PDO of an axis has: use a drive that has it")
    elif needs.follows is not Follows.TORQUE:
        yield from _mapping(needs)
    control = needs.control
    if mode in (OperationMode.PROFILE_VELOCITY, OperationMode.PROFILE_POSITION):
        purpose = "the rate at which its speed changes: use a drive that has it"
        yield Write(0x6083, 0, 4, scale.to_increments(control.acceleration_limit_rad_s2), purpose)
    if mode is OperationMode.PROFILE_POSITION:
        purpose = "its speed towards a set point: use a drive that has it"
        yield Write(0x6081, 0, 4, scale.to_increments(control.speed_limit_rad_s), purpose)
    if needs.homing is not None:
        yield from _homing(needs.joint, needs.homing, scale)


def _of_axis(write: Write, axis: int) -> Write:
    """Return the download into the same object of an axis; those of axis 0 are the profile's."""
    if not axis:
        return write
    otherwise = write.otherwise and _of_axis(write.otherwise, axis)
    return replace(write, index=axis_index(write.index, axis), otherwise=otherwise)


def _torque_cap(joint: JointConfig, scale: DriveScale) -> Write:
    """Limit 6072h, or 6073h of a drive that only limits its current; rounded down."""
    share = joint.torque_limit_Nm * 1000.0 / scale.rated_torque_mNm
    per_mille = min(FULL_SCALE_PER_MILLE, int(share * FULL_SCALE_PER_MILLE))
    purpose = "as it did 6072h, so its torque would have no limit of its own: use a drive with one of them"
    current = Write(0x6073, 0, 2, per_mille, purpose)
    return Write(0x6072, 0, 2, per_mille, "", otherwise=current)


def _mapping(needs: DriveNeeds) -> Iterator[Write]:
    purpose = (
        f"which carries its {needs.follows.value}: set control.drives_follow to torque, or map RPDO 1 by hand"
    )
    cob_id = RPDO_ID + needs.node_id
    yield from _pdo(PdoDirection.RECEIVE, 1, cob_id, COMMAND_MAPPING[needs.follows], purpose)


def _axes_mappings(needs: DriveNeeds) -> Iterator[Write]:
    """Map and enable the PDOs of a node with several axes; TPDO 2 is left alone while TPDO 1 has them all."""
    purpose = (
        "for PDOs of several axes: use a node whose PDOs are CAN FD frames that can be mapped,"
        " or remove fingers.joints.axis and give each joint a node of its own"
    )
    words = command_words(needs.axes, COMMAND_MAPPING[needs.follows][-1])
    yield from _pdo(PdoDirection.RECEIVE, 1, RPDO_ID + needs.node_id, words, purpose)
    for number, axes in enumerate(axes_of_tpdos(needs.axes), 1):
        cob_id = TPDO_IDS[number - 1] + needs.node_id | NO_RTR
        yield from _pdo(PdoDirection.TRANSMIT, number, cob_id, state_words(axes), purpose)


def _pdo(
    direction: PdoDirection, number: int, cob_id: int, words: Sequence[int], purpose: str
) -> Iterator[Write]:
    """Change a mapping in the steps of CiA 301: invalid, no objects, the objects, count, valid."""
    communication = direction.communication_index + number - 1
    mapping = direction.mapping_index + number - 1
    yield Write(communication, 1, 4, cob_id | INVALID, purpose)
    yield Write(mapping, 0, 1, 0, purpose)
    for slot, word in enumerate(words, start=1):
        yield Write(mapping, slot, 4, word, purpose)
    yield Write(mapping, 0, 1, len(words), purpose)
    yield Write(communication, 1, 4, cob_id, purpose)


def _homing(joint: JointConfig, homing: HomingConfig, scale: DriveScale) -> Iterator[Write]:
    purpose = "needed for homing: correct [homing], or home the drive with the maker's tool"
    method_purpose = f"the homing method: set homing.method to one that the drive of {joint.name} supports"
    yield Write(0x6098, 0, 1, homing.method, method_purpose)
    yield Write(0x6099, 1, 4, scale.to_increments(homing.search_rad_s), purpose)
    yield Write(0x6099, 2, 4, scale.to_increments(homing.zero_rad_s), purpose)
    yield Write(0x609A, 0, 4, scale.to_increments(homing.acceleration_rad_s2), purpose)
    if joint.home_rad is not None:
        at_home_rad = joint.direction * (joint.home_rad - joint.zero_offset_rad)
        yield Write(0x607C, 0, 4, scale.to_increments(at_home_rad), purpose)
