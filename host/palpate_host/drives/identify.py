"""Asks a drive at start-up by SDO what it is: supported modes, rated torque, increments a turn.

A pure client of one transfer at a time (CiA 301, 7.2.4.3.5): requests go out when they are due, replies come
in.
"""

from __future__ import annotations

import struct

from palpate_edge.can_frame import CanFrame
from palpate_edge.errors import BusError
from palpate_host.drives.cia402 import CST_SUPPORTED_BIT, DriveScale

SUPPORTED_MODES = (0x6502, 0)
RATED_TORQUE = (0x6076, 0)
FEED = (0x6092, 1)
QUESTIONS = (SUPPORTED_MODES, RATED_TORQUE, FEED)

SDO_REQUEST_ID = 0x600
SDO_REPLY_ID = 0x580
REPEAT_US = 200_000

UPLOAD_REQUEST = 0x40
ABORT = 0x80
EXPEDITED_4_BYTES = 0x43


class DriveIdentification:
    """The three questions to one drive; `scale` is there once all are answered."""

    def __init__(self, node_id: int, name: str) -> None:
        self.reply_id = SDO_REPLY_ID + node_id
        self.scale: DriveScale | None = None
        self._node_id = node_id
        self._name = f"{name} (node 0x{node_id:02X})"
        self._answers: dict[tuple[int, int], int] = {}
        self._asked_us: int | None = None

    def restart(self) -> None:
        """The drive booted anew: ask again."""
        self.scale = None
        self._answers.clear()
        self._asked_us = None

    def due(self, now_us: int) -> CanFrame | None:
        """The next request, or the last one again after 200 ms without an answer."""
        if self.scale is not None or (self._asked_us is not None and now_us < self._asked_us + REPEAT_US):
            return None
        self._asked_us = now_us
        index, subindex = self._open_question()
        data = struct.pack("<BHB4x", UPLOAD_REQUEST, index, subindex)
        return CanFrame(SDO_REQUEST_ID + self._node_id, data)

    def receive(self, frame: CanFrame) -> None:
        """Take a reply in; BusError when the drive refuses, lacks CST, or names a zero scale."""
        if self.scale is not None or len(frame.data) != 8:
            return
        command, index, subindex, value = struct.unpack("<BHBI", frame.data)
        if (index, subindex) != self._open_question():
            return
        if command == ABORT:
            raise BusError(
                f"{self._name} refuses to tell {index:04X}h:{subindex:02X}"
                f" (abort {value:08X}h): use a CiA 402 drive with the objects of cia402.eds"
            )
        if command != EXPEDITED_4_BYTES:
            raise BusError(
                f"{self._name} answers {index:04X}h:{subindex:02X} with SDO command"
                f" {command:02X}h, not with 4 bytes: give both sides the same cia402.eds"
            )
        self._answers[(index, subindex)] = value
        self._asked_us = None
        if len(self._answers) == len(QUESTIONS):
            self.scale = self._checked_scale()

    def _open_question(self) -> tuple[int, int]:
        return next(question for question in QUESTIONS if question not in self._answers)

    def _checked_scale(self) -> DriveScale:
        modes = self._answers[SUPPORTED_MODES]
        if not modes & CST_SUPPORTED_BIT:
            raise BusError(
                f"{self._name} lacks cyclic synchronous torque (6502h is {modes:08X}h,"
                " bit 9 is clear): use a drive that has it"
            )
        rated, feed = self._answers[RATED_TORQUE], self._answers[FEED]
        if rated == 0 or feed == 0:
            raise BusError(
                f"{self._name} says 6076h = {rated}, 6092h:01 = {feed}; neither can be 0: configure the drive"
            )
        return DriveScale(rated_torque_mNm=rated, increments_per_turn=feed)
