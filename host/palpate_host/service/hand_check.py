"""Comparison of hand.toml with the nodes on the bus, by SDO, before anything moves; pure.

The identity of each node (1000h, 1018h) is read, of fingertips also software and calibration, of drives also
the modes, scale, torque limit, watchdog and joint angle; PDOs are compared with the EDS that
both sides load (master/node_check.py).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass

import numpy as np

from palpate_bus.decode.device import CAN_ID, Device, Key
from palpate_bus.eds.cia402_axes import FIRST_INDEX, axis_key
from palpate_bus.master.node_check import differences
from palpate_edge.common.arrays import Array
from palpate_edge.common.contact_quantities import POSE_NODE_OFFSET
from palpate_edge.common.errors import BusError
from palpate_edge.node.fingertip_objects import DATA_BITRATE, METHOD, NEVER_GIVEN, ContactFlag, MethodCode
from palpate_host.common.joint_command import Follows
from palpate_host.config.control_config import ControlMode, ForceLaw
from palpate_host.config.hand_config import FingerConfig, HandConfig, JointConfig
from palpate_host.drives.cia402_modes import OperationMode, choose_mode
from palpate_host.drives.registry import CIA402
from palpate_host.network.drive_contract import drive_contract
from palpate_host.network.fingertip_contract import fingertip_contract
from palpate_host.network.node_contract import Need
from palpate_host.safety.supervisor import NO_FORCE, NO_PLACE
from palpate_host.service.hand_devices import devices_of_hand

DEVICE_TYPE, VENDOR, PRODUCT, SERIAL = (0x1000, 0), (0x1018, 1), (0x1018, 2), (0x1018, 4)
CALIBRATION = (0x2001, 0)
DRIVE_PROFILE, FINGERTIP_PROFILE = 402, 404
MODES, RATED_TORQUE, TORQUE_CAP = (0x6502, 0), (0x6076, 0), (0x6072, 0)
FEED, ANGLE, WATCHDOG = (0x6092, 1), (0x6064, 0), (0x1400, 5)
MODE_NAMES = {1: "pp", 3: "pv", 4: "tq", 6: "hm", 7: "ip", 8: "csp", 9: "csv", 10: "cst"}
"""CiA 402-2: the modes of 6502h, bit number + 1 as in 6060h."""

Read = Callable[[int, Device, Key], int | None]
"""Reads an object's number; None when the node does not have it. Raises BusError when the node does not
answer."""


@dataclass(frozen=True, slots=True)
class NodeReport:
    """One node. found: its identity and modes. problems: one line each, with the remedy; empty when there is
    none.
    angle_rad: of a drive's joint, None when it is not known."""

    node_id: int
    who: str
    found: str
    problems: tuple[str, ...]
    angle_rad: float | None = None


def check_nodes(config: HandConfig, read: Read, silent: Collection[int]) -> Iterator[NodeReport]:
    """Check every node in the order of hand.toml, drives after their finger's fingertip. silent: nodes that
    do not answer."""
    devices = devices_of_hand(config)
    for finger in config.fingers:
        tip = devices[finger.fingertip_node]
        who = f"fingertip of {finger.name}"
        yield _missing(tip, who) if tip.node_id in silent else _fingertip(config, finger, tip, read)
        for joint in finger.joints:
            drive = devices[joint.drive_node]
            if joint.drive != CIA402:
                found = f"{joint.drive} drive: not checked over SDO"
                yield NodeReport(drive.node_id, f"drive of {joint.name}", found, ())
            elif drive.node_id in silent:
                yield _missing(drive, f"drive of {joint.name}")
            else:
                yield _drive(config, drive, joint, read)


def _missing(device: Device, who: str) -> NodeReport:
    problem = "does not answer: check power, cable and its node id (palpate-host bus scan)"
    return NodeReport(device.node_id, who, "-", (problem,))


def _fingertip(config: HandConfig, finger: FingerConfig, device: Device, read: Read) -> NodeReport:
    who = f"fingertip of {finger.name}"
    problems = list(_identity(device, FINGERTIP_PROFILE, read))
    if not problems:
        problems += _not_as_named(finger, device, read)
        problems += _on_another_bus(config, device, read)
        problems += differences(device, lambda key: read(device.node_id, device, key))
        if not read(device.node_id, device, CALIBRATION):
            problems.append("has no calibration, so none of its contacts is valid: palpate-edge calibrate")
        problems += _lacks(config, device, read)
    return NodeReport(device.node_id, who, _who(device, read), tuple(problems))


def _not_as_named(finger: FingerConfig, device: Device, read: Read) -> Iterator[str]:
    """Yield differences in identity, software and calibration, for which a running host waits in CHECK."""
    contract = fingertip_contract(
        device.node_id, serial=finger.serial, calibration=finger.calibration, software=finger.software
    )
    for wanted in contract:
        if not wanted.pdo:
            number = read(device.node_id, device, wanted.key)
            data = None if number is None else number.to_bytes((number.bit_length() + 7) // 8, "little")
            problem = wanted.problem(data)
            if problem:
                yield problem


def _on_another_bus(config: HandConfig, device: Device, read: Read) -> Iterator[str]:
    """Yield that one side sends contacts as CAN FD frames and the other expects classic ones."""
    rate, here = read(device.node_id, device, (DATA_BITRATE, 0)) or 0, config.bus.data_bitrate or 0
    if rate != here:
        kinds = [f"CAN FD, {one} bit/s" if one else "classic CAN" for one in (rate, here)]
        remedy = "set the same bus.data_bitrate in finger.toml and hand.toml, or none"
        yield f"sends its contacts by {kinds[0]}, hand.toml has {kinds[1]}: {remedy}"


def _lacks(config: HandConfig, device: Device, read: Read) -> Iterator[str]:
    """Yield what the fingertip never gives and the control of this hand needs."""
    never = read(device.node_id, device, (NEVER_GIVEN, 0)) or 0
    above, method = device.node_id + POSE_NODE_OFFSET, read(device.node_id, device, (METHOD, 0))
    has_classic_poses = config.bus.data_bitrate is None and method == MethodCode.POSE
    if has_classic_poses and above in config.node_names:
        yield f"sends poses with identifiers of node 0x{above:02X}, which is in the hand: give one another id"
    if config.control.mode is ControlMode.BLIND:
        return
    if never & ContactFlag.NO_PLACE:
        yield NO_PLACE
    if never & ContactFlag.NO_FORCE and math.isfinite(config.limits.contact_force_N):
        yield NO_FORCE
    if never and config.control.force_law is not ForceLaw.OPEN:
        law = config.control.force_law.value
        yield f'gives no force at a known place, which control.force_law = "{law}" needs: set it to "open"'


def _drive(config: HandConfig, device: Device, joint: JointConfig, read: Read) -> NodeReport:
    def number(key: Key) -> int | None:
        own = axis_key(key, joint.axis or 0) if key[0] >= FIRST_INDEX else key
        return read(device.node_id, device, own)

    who = f"drive of {joint.name}"
    problems = list(_identity(device, DRIVE_PROFILE, read))
    if problems:
        return NodeReport(device.node_id, who, _who(device, read), tuple(problems))
    modes, rated_mNm, feed = number(MODES) or 0, number(RATED_TORQUE) or 0, number(FEED) or 0
    cap_Nm = torque_cap_Nm(number)
    try:
        choose_mode(modes, config.control.drives_follow)
    except BusError as exc:
        problems.append(str(exc))
    if config.homing is not None and not modes & OperationMode.HOMING.supported_bit:
        problems.append(
            "has no homing mode (6502h, bit 5): remove [homing] from hand.toml or use a drive that has it"
        )
    if not rated_mNm or not feed:
        problems.append(f"6076h is {rated_mNm}, 6092h:01 is {feed}: configure the drive, neither can be 0")
    # Into drives that follow something else the host writes 6072h itself.
    is_torque = config.control.drives_follow is Follows.TORQUE and config.homing is None
    if rated_mNm and is_torque and cap_Nm < joint.torque_limit_Nm:
        problems.append(
            f"is limited to {cap_Nm:.3g} N m (6072h), torque_limit_Nm is {joint.torque_limit_Nm:g}:"
            " raise 6072h or lower torque_limit_Nm"
        )
    if not number(WATCHDOG):
        problems.append("has no deadline for RPDO 1 (1400h:05 is 0): its torque would stay on without a host")
    if joint.axis is None:
        problems += differences(device, number)
    elif joint.axis == config.node_axes[device.node_id][0]:
        problems += _pdo_ids(config, device, number)
    drive_angle = drive_angle_rad(number)
    angle = None
    if drive_angle is not None:
        angle = joint.direction * drive_angle + joint.zero_offset_rad
        if not joint.min_rad <= angle <= joint.max_rad:
            problems.append(
                f"is at {angle:.3f} rad, outside min_rad {joint.min_rad:g} to max_rad {joint.max_rad:g}:"
                " correct zero_offset_rad or direction, or move it"
            )
    names = " ".join(name for bit, name in MODE_NAMES.items() if modes >> bit - 1 & 1)
    found = f"{_who(device, read)}, {names or 'no mode'}, {cap_Nm:.3g} N m"
    return NodeReport(device.node_id, who, found, tuple(problems), angle)


def _pdo_ids(config: HandConfig, device: Device, number: Callable[[Key], int | None]) -> Iterator[str]:
    """Yield the PDOs of a node with several axes that have another identifier; the host maps them itself."""
    axes = config.node_axes[device.node_id]
    for wanted in drive_contract(device.node_id, config.control.drives_follow, axes):
        if wanted.need is not Need.VALUE and isinstance(wanted.value, int):
            found = number(wanted.key)
            if found is None or (found ^ wanted.value) & CAN_ID:
                text = "missing" if found is None else f"0x{found:X}"
                yield f"{device.name_of(wanted.key)}: {text}, expected 0x{wanted.value:X}: {wanted.remedy}"


def torque_cap_Nm(number: Callable[[Key], int | None]) -> float:
    """Return the drive's own torque limit, 6076h times 6072h; 0 without one. number: reads an object."""
    return (number(RATED_TORQUE) or 0) * (number(TORQUE_CAP) or 0) * 1e-6


def drive_angle_rad(number: Callable[[Key], int | None]) -> float | None:
    """Return the drive's angle, 6064h over 6092h:01; None when it is not known. number: reads an object."""
    increments, feed = number(ANGLE), number(FEED)
    if not feed or increments is None:
        return None
    signed = increments - (1 << 32) if increments >= 1 << 31 else increments
    return signed * math.tau / feed


def _identity(device: Device, profile: int, read: Read) -> Iterator[str]:
    kind = read(device.node_id, device, DEVICE_TYPE)
    if kind is None or kind & 0xFFFF != profile:
        found = "missing" if kind is None else f"of CiA {kind & 0xFFFF}"
        yield f"is not a CiA {profile} device (its 1000h is {found}): exchange the node ids in hand.toml"


def _who(device: Device, read: Read) -> str:
    numbers = [read(device.node_id, device, key) for key in (VENDOR, PRODUCT, SERIAL)]
    return "/".join("-" if number is None else f"{number:X}" for number in numbers)


def joint_angles(config: HandConfig, reports: list[NodeReport]) -> tuple[Array, bool]:
    """Return the joint angles (nq,), the middle of the range where unknown, and whether all are known."""
    known = {report.who: report.angle_rad for report in reports}
    angles = [known.get(f"drive of {joint.name}") for joint in config.joints]
    middle = [(joint.min_rad + joint.max_rad) / 2 for joint in config.joints]
    pairs = zip(angles, middle, strict=True)
    q_rad = np.array([a if a is not None else m for a, m in pairs])
    return q_rad, all(angle is not None for angle in angles)


def problem_count(reports: list[NodeReport]) -> str:
    """Return the number of nodes with problems, such as ``1 of 12 nodes have problems``."""
    wrong = {report.node_id for report in reports if report.problems}
    return f"{len(wrong)} of {len({report.node_id for report in reports})} nodes have problems"


def table(reports: list[NodeReport]) -> str:
    """Return a table: one line for each node, one for each problem."""
    width = max(len(report.who) for report in reports)
    found_width = max(len(report.found) for report in reports)
    lines = [f"node  {'who':{width}}  {'vendor/product/serial, modes, torque':{found_width}}"]
    for report in reports:
        count = len(report.problems)
        verdict = "ok" if not count else f"{count} problem{'s' if count > 1 else ''}"
        lines.append(f"0x{report.node_id:02X}  {report.who:{width}}  {report.found:{found_width}}  {verdict}")
        lines += [f"      {problem}" for problem in report.problems]
    return "\n".join(lines)
