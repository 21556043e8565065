"""Requests of the set-up to the nodes of a bus: angles and torque limits of drives, a flash of a light.

None of them moves a joint: drives are only read.
"""

# mypy: disallow-untyped-calls=False
# (the canopen package is typed in part)
from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial

from canopen.sdo.client import SdoClient

from palpate_bus.decode.device import Key, devices_by_kind
from palpate_bus.eds.cia402 import STATUSWORD, DriveState, state_of
from palpate_bus.master.session import sdo_errors
from palpate_edge.common.errors import BusError
from palpate_edge.node.fingertip_objects import DATA_BITRATE, LED_SET_POINT
from palpate_host.service.hand_check import Read, drive_angle_rad, torque_cap_Nm
from palpate_host.setup.found_nodes import HandNodes

FULL, DARK = b"\xff", b"\x00"
FLASHES = 4
HALF_PERIOD_S = 0.5  # the fingertip passes 2030h to its controller four times a second


class NodeRequests:
    """Requests to the nodes of one scan. clients: by node id; read: reads an object's number with them."""

    def __init__(self, clients: Mapping[int, SdoClient], nodes: HandNodes, read: Read) -> None:
        self._clients = clients
        self._read = read
        devices = devices_by_kind({}, {node.node_id: "drive" for node in nodes.drives})
        self._drives: dict[int, Callable[[Key], int | None]] = {
            node_id: partial(read, node_id, device) for node_id, device in devices.items()
        }

    def refuse_enabled(self) -> None:
        """Raise BusError when a drive is enabled: another master commands it."""
        for node_id, number in self._drives.items():
            if state_of(number(STATUSWORD) or 0) is DriveState.OPERATION_ENABLED:
                raise BusError(
                    f"drive 0x{node_id:02X} is enabled, another master commands it: stop that first"
                )

    def angles_rad(self) -> dict[int, float]:
        """Return the angle of each drive that gives one, by node id."""
        angles = {node_id: drive_angle_rad(number) for node_id, number in self._drives.items()}
        return {node_id: angle for node_id, angle in angles.items() if angle is not None}

    def torque_caps_Nm(self) -> dict[int, float]:
        """Return each drive's own torque limit, by node id; 0 without one."""
        return {node_id: torque_cap_Nm(number) for node_id, number in self._drives.items()}

    def data_bitrate(self, fingertips: Sequence[int]) -> int | None:
        """Return the data bit rate that these fingertips send with (2005h), the highest if they differ.

        None on a classic bus.
        """
        devices = devices_by_kind(dict.fromkeys(fingertips, "fingertip"), {})
        rates = (self._read(node_id, device, (DATA_BITRATE, 0)) or 0 for node_id, device in devices.items())
        return max(rates, default=0) or None

    def flash(self, node_id: int, wait: Callable[[float], object]) -> None:
        """Flash a fingertip's light, then restore the level of 2030h.

        wait: waits for seconds. Raises BusError when the fingertip has no light or does not answer.
        """
        client = self._clients[node_id]
        with sdo_errors(node_id, LED_SET_POINT, "flashing its light (2030h)", client.RESPONSE_TIMEOUT):
            level = client.upload(LED_SET_POINT, 0)
            try:
                for _ in range(FLASHES):
                    for one in (DARK, FULL):
                        client.download(LED_SET_POINT, 0, one)
                        wait(HALF_PERIOD_S)
            finally:
                client.download(LED_SET_POINT, 0, level)
