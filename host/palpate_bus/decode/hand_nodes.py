"""Nodes of a hand: ids and names from a hand.toml, and what other nodes beside them may be."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

import msgspec

from palpate_bus.decode.device import DRIVE_NODES, Device, devices_by_kind, usual_device
from palpate_bus.decode.units import JOINT_DRIVE, MULTI_AXIS
from palpate_edge.common.config_file import read_toml


class _Joint(msgspec.Struct, frozen=True):
    name: str
    drive_node: int
    axis: int | None = None


class _Finger(msgspec.Struct, frozen=True):
    name: str
    fingertip_node: int
    joints: tuple[_Joint, ...]


class _Hand(msgspec.Struct, frozen=True):
    fingers: tuple[_Finger, ...]


def read_hand_nodes(path: Path) -> dict[int, Device]:
    """Return the devices in a hand.toml. Raises ConfigError when the file or a node id is missing."""
    guide = "give a hand.toml; docs/configuration.md lists its keys"
    fingers = read_toml(path, _Hand, guide=guide, trusted=False).fingers
    drives: dict[int, str] = {}
    axes: dict[int, dict[int, str]] = {}
    for joint in (joint for finger in fingers for joint in finger.joints):
        if joint.axis is None:
            drives[joint.drive_node] = joint.name
        else:
            axes.setdefault(joint.drive_node, {})[joint.axis] = joint.name
    axes = {node_id: dict(sorted(names.items())) for node_id, names in axes.items()}
    return devices_by_kind({finger.fingertip_node: finger.name for finger in fingers}, drives, axes)


def usual_beside(devices: Iterable[Device]) -> Callable[[int], Device | None]:
    """Return `usual_device`, without its drives where `devices` has drives: the hand has no others."""
    if not any(device.product in (JOINT_DRIVE, MULTI_AXIS) for device in devices):
        return usual_device
    return lambda node_id: None if node_id in DRIVE_NODES else usual_device(node_id)
