"""Drive nodes of a recorded hand, live: they answer each SYNC on the kernel's bus with the next TPDO 1."""

from __future__ import annotations

import os
import socket
import struct
import threading
from collections.abc import Sequence
from typing import Self

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_host.network.nmt_master import SYNC

STANDARD_IDS = 0x7FF
WAIT_S = 0.1
REAL_TIME = 10  # priority in the guest's scheduler, before every other process
_FD_FRAME = struct.Struct("=IBB2x64s")  # struct canfd_frame
_BRS = 0x01


class AnsweringDrives(threading.Thread):
    """A context in which a thread answers; its socket receives SYNC alone, so that nothing else wakes it.

    answers: the frames to each SYNC, from the first one on. answered: number of SYNCs received.
    """

    def __init__(self, interface: str, answers: Sequence[Sequence[CanFrame]]) -> None:
        super().__init__()
        self._answers = [[_packed(frame) for frame in frames] for frames in answers]
        self._socket = socket.socket(socket.PF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        self._socket.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FD_FRAMES, 1)
        only_sync = struct.pack("=II", SYNC.can_id, STANDARD_IDS)
        self._socket.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, only_sync)
        self._socket.settimeout(WAIT_S)
        self._socket.bind((interface,))
        self._ends = threading.Event()
        self.answered = 0

    def run(self) -> None:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(REAL_TIME))  # a drive has its own processor
        while not self._ends.is_set():
            try:
                self._socket.recv(_FD_FRAME.size)
            except TimeoutError:
                continue
            for answer in self._answers[self.answered]:
                self._socket.send(answer)
            self.answered += 1

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_error: object) -> None:
        self._ends.set()
        self.join()
        self._socket.close()


def _packed(frame: CanFrame) -> bytes:
    return _FD_FRAME.pack(frame.can_id, len(frame.data), _BRS, frame.data)
