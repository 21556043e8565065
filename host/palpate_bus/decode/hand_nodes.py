"""Node ids and names from a hand.toml; palpate_host reads the file's other keys."""

from __future__ import annotations

from pathlib import Path

import msgspec

from palpate_bus.decode.device import Device, devices_by_kind
from palpate_edge.common.config_file import read_toml


class _Joint(msgspec.Struct, frozen=True):
    name: str
    drive_node: int


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
    return devices_by_kind(
        {finger.fingertip_node: finger.name for finger in fingers},
        {joint.drive_node: joint.name for finger in fingers for joint in finger.joints},
    )
