"""Requests of the set-up to the nodes of a bus: angles and torque limits of drives, a flash of a light.

None of them moves a joint: drives are only read.
"""

# mypy: disallow-untyped-calls=False
# (the canopen package is typed in part)
from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial

from canopen.sdo.client import SdoClient

from palpate_bus.decode.device import Key, axes_device, devices_by_kind
from palpate_bus.eds.cia402 import STATUSWORD, DriveState, state_of
from palpate_bus.eds.cia402_axes import FIRST_INDEX, MAX_AXES, axis_key
from palpate_bus.master.session import sdo_errors
from palpate_edge.common.errors import BusError
from palpate_edge.node.fingertip_objects import DATA_BITRATE, LED_SET_POINT
from palpate_host.service.hand_check import MODES, Read, drive_angle_rad, torque_cap_Nm
from palpate_host.setup.found_nodes import DrivePlace, HandNodes

FULL, DARK = b"\xff", b"\x00"
FLASHES = 4
HALF_PERIOD_S = 0.5  # the fingertip passes 2030h to its controller four times a second


class NodeRequests:
    """Requests to the nodes of one scan. clients: by node id; read: reads an object's number with them."""

    def __init__(self, clients: Mapping[int, SdoClient], nodes: HandNodes, read: Read) -> None:
        self._clients = clients
        self._read = read
        devices = devices_by_kind({}, {node.node_id: "drive" for node in nodes.drives})
        self._drives: dict[DrivePlace, Callable[[Key], int | None]] = {}
        for node_id, device in devices.items():
            axes = self._axes(node_id)
            whole = axes_device(node_id, "drive", axes) if axes else device
            for axis in axes or (None,):
                number = partial(read, node_id, whole)
                self._drives[DrivePlace(node_id, axis)] = number if axis is None else _of_axis(number, axis)

    def _axes(self, node_id: int) -> tuple[int, ...]:
        """Return the axes of a node that have a drive: those with a mode in 6502h. None of a node without the
        objects of axis 1."""
        device = axes_device(node_id, "drive", range(MAX_AXES))
        if self._read(node_id, device, axis_key(MODES, 1)) is None:
            return ()
        return tuple(axis for axis in range(MAX_AXES) if self._read(node_id, device, axis_key(MODES, axis)))

    @property
    def drives(self) -> list[DrivePlace]:
        """The drives in the order of node ids and axes."""
        return list(self._drives)

    def refuse_enabled(self) -> None:
        """Raise BusError when a drive is enabled: another master commands it."""
        for place, number in self._drives.items():
            if state_of(number(STATUSWORD) or 0) is DriveState.OPERATION_ENABLED:
                raise BusError(
                    f"drive 0x{place.node_id:02X} is enabled, another master commands it: stop that first"
                )

    def angles_rad(self) -> dict[DrivePlace, float]:
        """Return the angle of each drive that gives one."""
        angles = {place: drive_angle_rad(number) for place, number in self._drives.items()}
        return {place: angle for place, angle in angles.items() if angle is not None}

    def torque_caps_Nm(self) -> dict[DrivePlace, float]:
        """Return each drive's own torque limit; 0 without one."""
        return {place: torque_cap_Nm(number) for place, number in self._drives.items()}

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


def _of_axis(number: Callable[[Key], int | None], axis: int) -> Callable[[Key], int | None]:
    """Return a reading of the objects that an axis has in place of those of axis 0."""
    return lambda key: number(axis_key(key, axis) if key[0] >= FIRST_INDEX else key)
