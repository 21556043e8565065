"""The nodes of a hand as their EDS files describe them."""

from __future__ import annotations

from palpate_bus.decode.device import Device, devices_by_kind
from palpate_host.config.hand_config import HandConfig


def devices_of_hand(config: HandConfig) -> dict[int, Device]:
    """Return the devices of a hand by node id."""
    return devices_by_kind(
        {finger.fingertip_node: finger.name for finger in config.fingers},
        {joint.drive_node: joint.name for joint in config.joints if joint.axis is None},
        config.axis_names,
    )
