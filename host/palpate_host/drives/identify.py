"""The SDO transfers with a CiA 402 drive at start-up, one at a time.

Uploads: supported modes, rated torque, increments a turn. Downloads: the hand's settings
(drive_settings.py). A pure client (CiA 301, 7.2.4.3): requests out when they are due, responses in.
"""

from __future__ import annotations

import struct
from collections import deque

from palpate_bus.eds.cia402_axes import axis_key
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.errors import BusError
from palpate_host.drives.cia402_modes import OperationMode, choose_mode
from palpate_host.drives.cia402_scale import DriveScale
from palpate_host.drives.drive import DriveNeeds
from palpate_host.drives.drive_settings import Write, settings

SUPPORTED_MODES = (0x6502, 0)
RATED_TORQUE = (0x6076, 0)
FEED = (0x6092, 1)
UPLOADS = (SUPPORTED_MODES, RATED_TORQUE, FEED)

SDO_REQUEST_ID = 0x600
SDO_REPLY_ID = 0x580
RETRY_US = 200_000

UPLOAD_REQUEST = 0x40
ABORT = 0x80
EXPEDITED_4_BYTES = 0x43
WRITTEN = 0x60


class DriveIdentification:
    """The transfers with one drive; `scale` is None until all are done."""

    def __init__(self, needs: DriveNeeds) -> None:
        self.reply_id = SDO_REPLY_ID + needs.node_id
        self.mode = OperationMode.CYCLIC_TORQUE
        self._node_id = needs.node_id
        self._name = needs.name_on_bus
        self._eds = "cia402_axes.eds" if needs.axes else "cia402.eds"
        self._needs = needs
        self.restart()

    def restart(self) -> None:
        """Begin again: the drive has booted."""
        self.scale: DriveScale | None = None
        self._uploads = deque(self._of_axis(key) for key in UPLOADS)
        self._writes: deque[Write] = deque()
        self._values: dict[tuple[int, int], int] = {}
        self._requested_us: int | None = None

    def due(self, now_us: int) -> CanFrame | None:
        """Return the next request, or the last one again after 200 ms without a response."""
        if self.scale is not None or (
            self._requested_us is not None and now_us < self._requested_us + RETRY_US
        ):
            return None
        self._requested_us = now_us
        if self._uploads:
            data = struct.pack("<BHB4x", UPLOAD_REQUEST, *self._uploads[0])
        else:
            data = self._writes[0].request()
        return CanFrame(SDO_REQUEST_ID + self._node_id, data)

    def receive(self, frame: CanFrame) -> None:
        """Take a response. Raises BusError when the drive aborts, lacks a mode, or has a scale of zero."""
        if self.scale is not None or len(frame.data) != 8:
            return
        command, index, subindex, value = struct.unpack("<BHBI", frame.data)
        if self._uploads and (index, subindex) == self._uploads[0]:
            self._take_upload(command, value)
        elif not self._uploads and (index, subindex) == self._writes[0].key:
            self._take_download(command, value)

    def _take_upload(self, command: int, value: int) -> None:
        index, subindex = self._uploads[0]
        if command == ABORT:
            raise BusError(
                f"{self._name} aborts the upload of {index:04X}h:{subindex:02X}"
                f" (abort {value:08X}h): use a CiA 402 drive with the objects of {self._eds}"
            )
        if command != EXPEDITED_4_BYTES:
            raise BusError(
                f"{self._name} responds to {index:04X}h:{subindex:02X} with SDO command"
                f" {command:02X}h, not with 4 bytes: give both sides the same {self._eds}"
            )
        self._values[self._uploads.popleft()] = value
        self._requested_us = None
        if not self._uploads:
            self._writes = self._needed_writes()
            self._finish()

    def _take_download(self, command: int, value: int) -> None:
        write = self._writes[0]
        if command == ABORT and write.otherwise is None:
            raise BusError(
                f"{self._name} aborts the download of {write.index:04X}h:{write.subindex:02X} = {write.value}"
                f" (abort {value:08X}h), {write.purpose}"
            )
        if command not in (ABORT, WRITTEN):
            return
        self._requested_us = None
        self._writes.popleft()
        if command == ABORT and write.otherwise is not None:
            self._writes.appendleft(write.otherwise)
        self._finish()

    def _finish(self) -> None:
        if not self._writes:
            self.scale = self._checked_scale()

    def _needed_writes(self) -> deque[Write]:
        modes = self._values[self._of_axis(SUPPORTED_MODES)]
        try:
            self.mode = choose_mode(modes, self._needs.follows)
        except BusError as exc:
            raise BusError(f"{self._name} {exc}") from None
        if self._needs.homing is not None and not modes & OperationMode.HOMING.supported_bit:
            raise BusError(
                f"{self._name} lacks homing (6502h is {modes:08X}h, bit 5 is clear):"
                " remove [homing] from hand.toml, or use a drive that supports homing"
            )
        return deque(settings(self._needs, self._checked_scale(), self.mode))

    def _of_axis(self, key: tuple[int, int]) -> tuple[int, int]:
        return axis_key(key, self._needs.axis)

    def _checked_scale(self) -> DriveScale:
        rated, feed = self._values[self._of_axis(RATED_TORQUE)], self._values[self._of_axis(FEED)]
        if rated == 0 or feed == 0:
            raise BusError(
                f"{self._name} has 6076h = {rated}, 6092h:01 = {feed}; neither can be 0: configure the drive"
            )
        return DriveScale(rated_torque_mNm=rated, increments_per_turn=feed)
