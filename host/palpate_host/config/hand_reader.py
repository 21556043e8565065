"""Read hand.toml and check what no single value shows: node ids, axes, ranges, laws."""

from __future__ import annotations

from pathlib import Path

import msgspec

from palpate_edge.common.config_file import parse_toml, read_toml
from palpate_edge.common.errors import ConfigError
from palpate_host.common.joint_command import Follows
from palpate_host.config.control_config import ControlLaw, ControlMode, ForceLaw
from palpate_host.config.hand_config import HandConfig

GUIDE = "docs/configuration.md lists every key of a hand"


def load(path: Path) -> HandConfig:
    """Read and check hand.toml; model.mjcf becomes a whole path.

    ConfigError (one line: file, key, way out) when it is missing, garbled, has an unknown or a missing key, a
    value out of range, or one node id for two nodes.
    """
    return _checked(path, read_toml(path, HandConfig, guide=GUIDE))


def parse(path: Path, text: str) -> HandConfig:
    """Return the text of a hand.toml as `load` does; the file at `path` need not exist yet."""
    return _checked(path, parse_toml(text.encode(), path, HandConfig, guide=GUIDE))


def _checked(path: Path, config: HandConfig) -> HandConfig:
    _check_nodes(path, config)
    _check_axes(path, config)
    _check_ranges(path, config)
    if config.model.mjcf is not None:
        model = msgspec.structs.replace(config.model, mjcf=str(path.parent / config.model.mjcf))
        config = msgspec.structs.replace(config, model=model)
    return config


def _check_nodes(path: Path, config: HandConfig) -> None:
    users: dict[int, str] = {config.network.host_node: "network.host_node"}
    shared: set[int] = set()
    for finger in config.fingers:
        claims = [(finger.fingertip_node, f"fingertip_node of {finger.name}")]
        for joint in finger.joints:
            if joint.drive_node not in shared:
                claims.append((joint.drive_node, f"drive_node of {joint.name}"))
            if joint.axis is not None:
                shared.add(joint.drive_node)
        for node, user in claims:
            if node in users:
                raise ConfigError(
                    f"{path}: node id 0x{node:02X} is used twice, by {users[node]} and by {user}: change one"
                )
            users[node] = user
    for key, names in (
        ("fingers.joints.name", [joint.name for joint in config.joints]),
        ("fingers.name", [finger.name for finger in config.fingers]),
        ("model.tip_sites", list(config.model.tip_sites)),
    ):
        for name in names:
            if names.count(name) > 1:
                raise ConfigError(f"{path}: {key} {name!r} is used twice: every one needs its own")


def _check_axes(path: Path, config: HandConfig) -> None:
    """Check the joints that are axes of a node with several."""
    users: dict[tuple[int, int], str] = {}
    for joint in config.joints:
        axis, node = joint.axis, joint.drive_node
        if axis is None:
            if node in config.node_axes:
                raise ConfigError(
                    f"{path}: node 0x{node:02X} has several axes, and {joint.name} names none:"
                    " set its fingers.joints.axis, or another drive_node"
                )
            continue
        where = f"{path}: fingers.joints.axis of {joint.name}"
        if (node, axis) in users:
            raise ConfigError(
                f"{path}: axis {axis} of node 0x{node:02X} is used twice, by {users[node, axis]} and by"
                f" {joint.name}: change one"
            )
        users[node, axis] = joint.name
        if joint.drive != "cia402":
            raise ConfigError(f"{where} needs drive = 'cia402', not {joint.drive!r}: remove one of them")
        if config.bus.data_bitrate is None:
            raise ConfigError(
                f"{where} needs a CAN FD bus, whose frames hold several axes: set bus.data_bitrate, or give"
                " each joint a drive_node of its own"
            )


def _check_ranges(path: Path, config: HandConfig) -> None:
    if len(config.model.tip_sites) != len(config.fingers):
        raise ConfigError(
            f"{path}: model.tip_sites has {len(config.model.tip_sites)} names for"
            f" {len(config.fingers)} [[fingers]]: give each finger its tip"
        )
    if (config.model.mjcf is None) == (config.geometry is None):
        raise ConfigError(
            f"{path}: needs either model.mjcf or [geometry]: name a file, or give the hand's shape"
        )
    for joint in config.joints:
        if joint.direction == 0:
            raise ConfigError(f"{path}: fingers.joints.direction of {joint.name} is 0: set 1 or -1")
        if joint.min_rad >= joint.max_rad:
            raise ConfigError(
                f"{path}: fingers.joints.min_rad of {joint.name} is not below its max_rad:"
                " exchange or correct them"
            )
    control = config.control
    if control.drives_follow is not Follows.TORQUE and control.force_law is not ForceLaw.ADMITTANCE:
        raise ConfigError(
            f"{path}: control.drives_follow = {control.drives_follow.value!r} needs control.force_law ="
            " 'admittance': without the sensor's force such joints go on closing"
        )
    if control.law is ControlLaw.POSE and not (
        control.mode is ControlMode.PROPOSED
        and control.drives_follow is Follows.TORQUE
        and not control.velocity_joints
        and control.force_law is ForceLaw.OPEN
    ):
        raise ConfigError(
            f"{path}: control.law = 'pose' needs control.mode = 'proposed', drives that follow torque,"
            " velocity_joints = false and force_law = 'open': correct these, or set law = 'paper'"
        )
    if config.homing is not None and config.homing.method > 0:
        for joint in config.joints:
            if joint.home_rad is None:
                raise ConfigError(
                    f"{path}: [homing] with method {config.homing.method} needs fingers.joints.home_rad of"
                    f" {joint.name}: give its angle at the home position"
                )
    s = config.staleness
    if not s.warn_ms < s.freeze_ms < s.hold_ms < s.stop_ms:
        raise ConfigError(
            f"{path}: staleness tiers must grow, warn_ms < freeze_ms < hold_ms < stop_ms,"
            f" not {s.warn_ms}, {s.freeze_ms}, {s.hold_ms}, {s.stop_ms}: correct [staleness]"
        )
    if config.network.heartbeat_ms >= config.network.heartbeat_timeout_ms:
        raise ConfigError(
            f"{path}: network.heartbeat_timeout_ms must exceed heartbeat_ms: use 3 times or more"
        )
