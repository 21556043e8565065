"""The host outside: receives a board's frames on the bus, and starts its node whenever that waits for it."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import pairwise

from palpate_edge.can_bus.bus import Bus, BusConfig, open_bus
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.errors import BusError

VALID = 0x04  # of TPDO 2's flags (docs/bus.md)
NODE = 0x10
WAITS = CanFrame(0x700 + NODE, b"\x7f")  # a heartbeat in PRE-OPERATIONAL
START = CanFrame(0x000, bytes((0x01, NODE)))
TPDO_2 = 0x280 + NODE


class Master:
    """Contacts of node 10h, received in a thread. times_s: time.monotonic of each valid contact that came."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self.times_s: list[float] = []
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._listen)
        self._thread.start()

    def close(self) -> None:
        self._stop.set()
        self._thread.join()

    def contact_after(self, begin_s: float, patience_s: float = 60.0) -> float:
        """Waits for a valid contact later than this; returns how many s later it came."""
        end_s = time.monotonic() + patience_s
        while True:
            later = [at_s for at_s in self.times_s[-1000:] if at_s > begin_s]
            if later:
                return later[0] - begin_s
            assert time.monotonic() < end_s, f"no valid contact came in {patience_s} s"
            time.sleep(0.01)

    def longest_gap_s(self, begin_s: float) -> float:
        """Between valid contacts since then."""
        times_s = [at_s for at_s in self.times_s if at_s > begin_s]
        return max((after - before for before, after in pairwise(times_s)), default=0.0)

    def _listen(self) -> None:
        while not self._stop.is_set():
            with suppress(BusError):  # a bus that is cut on purpose
                for _, frame in self._bus.receive(0.1):
                    if frame == WAITS:
                        self._bus.send([START])
                    elif frame.can_id == TPDO_2 and frame.data[6] & VALID:
                        self.times_s.append(time.monotonic())


@contextmanager
def master_on(config: BusConfig) -> Iterator[Master]:
    """A master as long as it is wanted."""
    with open_bus(config, "master") as bus:
        master = Master(bus)
        try:
            yield master
        finally:
            master.close()
