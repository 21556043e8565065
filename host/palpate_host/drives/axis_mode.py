"""The mode of an axis whose PDOs have none: written over SDO and read back while the PDOs go on.

A pure client, as identify.py: requests out when they are due, responses in.
"""

from __future__ import annotations

import struct

from palpate_bus.eds.cia402 import MODE_DISPLAY
from palpate_bus.eds.cia402_axes import axis_key
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.errors import BusError
from palpate_host.drives.cia402_modes import MODE, OperationMode
from palpate_host.drives.drive import DriveNeeds
from palpate_host.drives.drive_settings import Write
from palpate_host.drives.identify import ABORT, RETRY_US, SDO_REQUEST_ID, UPLOAD_REQUEST, WRITTEN

EXPEDITED_1_BYTE = 0x4F


class AxisMode:
    """6060h of one axis, and 6061h as its answer.

    working: the mode that was written at start-up. The axis is in `wanted` when `is_in_effect`.
    """

    def __init__(self, needs: DriveNeeds) -> None:
        self._name = needs.name_on_bus
        self._request_id = SDO_REQUEST_ID + needs.node_id
        self._mode_key, self._display_key = (axis_key(key, needs.axis) for key in (MODE, MODE_DISPLAY))
        self.restart()

    def restart(self) -> None:
        """Forget the mode: the node has booted, and its working mode is written at the next start-up."""
        self.wanted: OperationMode | None = None
        self.is_in_effect = True
        self._is_written = False
        self._requested_us: int | None = None

    def want(self, mode: OperationMode, working: OperationMode) -> None:
        """Change to `mode`, unless the axis has it or is about to. working: the mode since start-up."""
        if mode is not (self.wanted or working):
            self.is_in_effect = self._is_written = False
            self._requested_us = None
        self.wanted = mode

    def due(self, now_us: int) -> CanFrame | None:
        """Return the next request, or the last one again after 200 ms without a response."""
        is_waiting = self._requested_us is not None and now_us < self._requested_us + RETRY_US
        if self.is_in_effect or is_waiting or self.wanted is None:
            return None
        self._requested_us = now_us
        if self._is_written:
            data = struct.pack("<BHB4x", UPLOAD_REQUEST, *self._display_key)
        else:
            data = Write(*self._mode_key, 1, self.wanted, "its mode").request()
        return CanFrame(self._request_id, data)

    def receive(self, frame: CanFrame) -> None:
        """Take a response. Raises BusError when the drive aborts the download."""
        if self._requested_us is None or len(frame.data) != 8:
            return
        command, index, subindex, value = struct.unpack("<BHBI", frame.data)
        if not self._is_written and (index, subindex) == self._mode_key:
            if command == ABORT:
                raise BusError(
                    f"{self._name} aborts the download of {index:04X}h:{subindex:02X} = {self.wanted}"
                    f" (abort {value:08X}h) in operation: remove [homing] from hand.toml, or give each joint"
                    " a drive_node of its own"
                )
            if command == WRITTEN:
                self._is_written, self._requested_us = True, None
        elif self._is_written and (index, subindex) == self._display_key:
            self._requested_us = None
            self.is_in_effect = command == EXPEDITED_1_BYTE and value & 0xFF == self.wanted
