"""Simulated serial line: two pseudo terminals connected by a thread, in place of an RS-485 cable.

Bytes are delayed by their duration at the bit rate, so the throughput is that of a real port.
"""

from __future__ import annotations

import os
import select
import threading
import time
import tty
from collections.abc import Iterator
from contextlib import contextmanager

BITS_A_BYTE = 11  # 8E1: start, 8 data, parity, stop
CHUNK_BYTES = 256


@contextmanager
def pty_line(baud_rate: int) -> Iterator[tuple[str, str]]:
    """Yield the paths of the line's two ends, which exist during the context."""
    masters, slaves = zip(*(os.openpty() for _ in range(2)), strict=True)
    for fd in slaves:
        tty.setraw(fd)
    wake_read, wake_write = os.pipe()
    pump = threading.Thread(target=_pump, args=(masters, wake_read, baud_rate), name="pty line")
    pump.start()
    try:
        yield os.ttyname(slaves[0]), os.ttyname(slaves[1])
    finally:
        os.write(wake_write, b"x")
        pump.join()
        for fd in (*masters, *slaves, wake_read, wake_write):
            os.close(fd)


def _pump(masters: tuple[int, ...], wake: int, baud_rate: int) -> None:
    other = {masters[0]: masters[1], masters[1]: masters[0]}
    while True:
        ready, _, _ = select.select([*masters, wake], [], [])
        if wake in ready:
            return
        for fd in ready:
            data = os.read(fd, CHUNK_BYTES)
            time.sleep(len(data) * BITS_A_BYTE / baud_rate)
            os.write(other[fd], data)
