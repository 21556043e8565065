"""The clock of a simulated hand: a file that all its processes map. One process keeps the time, all read it.

The time is CLOCK_MONOTONIC, held back while the simulation does not keep up: on a slow machine the simulation
slows down, and no deadline is missed. The file has three words in the machine's byte order, each read and
written in one piece:

    0   8 bytes  magic
    8   i64      held back so far, us
    16  i64      limit: the time that must not be passed before the keeper allows it, us

A keeper that has not updated the file for GONE_US has failed: the time runs on, so that others miss its
frames.
"""

from __future__ import annotations

import mmap
import os
import struct
from collections.abc import Callable
from pathlib import Path

from palpate_edge.can_bus.bus import BusConfig
from palpate_edge.common.atomic_write import write_atomically
from palpate_edge.common.errors import ConfigError, reason_of
from palpate_edge.common.local_clock import LocalClock, monotonic_us

MAGIC = b"PALPTIME"
FORMAT = struct.Struct("@8sqq")
HELD, LIMIT = 1, 2
NO_LIMIT_US = 2**62
GONE_US = 5_000_000
AHEAD_US = 3_000
"""The time runs on by itself for this long after the keeper's last update."""
SLOW_FACTOR = 20
"""While the keeper waits, the time runs slower than CLOCK_MONOTONIC by this factor: others need time to
answer."""


def make_clock(path: Path) -> LocalClock:
    """Make a new clock, without a keeper yet. Raises ConfigError when the file cannot be written."""
    write_atomically(path, FORMAT.pack(MAGIC, 0, NO_LIMIT_US), ConfigError, sync_folder=False)
    return LocalClock(SimulatedClock(path).now_us)


class SimulatedClock:
    """Reads the clock; `now_us` never decreases. Raises ConfigError for a file that is missing or is no
    clock."""

    def __init__(self, path: Path, machine_us: Callable[[], int] = monotonic_us) -> None:
        self._words = _mapped(path, mmap.ACCESS_READ)
        self._machine_us = machine_us
        self._last_us = 0

    def now_us(self) -> int:
        free_us = self._machine_us() - self._words[HELD]
        limit_us = max(self._words[LIMIT], free_us - GONE_US)
        self._last_us = max(self._last_us, min(free_us, limit_us))
        return self._last_us


class ClockKeeper:
    """Holds the time back; call `go_on` more often than AHEAD_US. held_us: total time held back.

    One keeper a clock. Raises ConfigError as SimulatedClock does.
    """

    def __init__(self, path: Path, machine_us: Callable[[], int] = monotonic_us) -> None:
        self._clock = SimulatedClock(path, machine_us)
        self._words = _mapped(path, mmap.ACCESS_WRITE)
        self._machine_us = machine_us
        self._updated_us = machine_us()
        self.held_us = 0

    def now_us(self) -> int:
        return self._clock.now_us()

    def go_on(self, *, slowly: bool) -> None:
        """Let the time run: as fast as the machine's, or slowly."""
        free_us, now_us = self._machine_us(), self.now_us()
        ahead_us = (free_us - self._updated_us) // SLOW_FACTOR if slowly else AHEAD_US
        self._updated_us, self.held_us = free_us, free_us - now_us
        # In this order, so that a reader between the two writes sees the time stand still.
        self._words[HELD] = self.held_us
        self._words[LIMIT] = now_us + ahead_us

    def close(self) -> None:
        """Stop holding the time back."""
        self.go_on(slowly=False)
        self._words[LIMIT] = NO_LIMIT_US


def clock_of(bus: BusConfig) -> LocalClock:
    """Return the clock that all programs on this bus use: simulated if bus.clock is set, else the machine's.

    Raises ConfigError as SimulatedClock does, and for bus.clock on a real bus.
    """
    if not bus.clock:
        return LocalClock()
    if bus.interface != "palpate":
        raise ConfigError(
            f"bus.clock works on the local hub only, and bus.interface is {bus.interface}: remove bus.clock"
        )
    return LocalClock(SimulatedClock(Path(bus.clock)).now_us)


def _mapped(path: Path, access: int) -> memoryview:
    """Return the mapped words; a memoryview reads and writes each in one piece, which struct does not."""
    try:
        with path.open("r+b" if access == mmap.ACCESS_WRITE else "rb") as file:
            is_whole = os.fstat(file.fileno()).st_size == FORMAT.size and file.read(len(MAGIC)) == MAGIC
            if is_whole:
                return memoryview(mmap.mmap(file.fileno(), FORMAT.size, access=access)).cast("q")
    except FileNotFoundError:
        raise ConfigError(
            f"{path}: no such file: start palpate-host bus hub --clock {path}, or remove bus.clock"
        ) from None
    except OSError as error:
        raise ConfigError(
            f"{path} cannot be read: {reason_of(error)}; "
            "bus.clock is the file of palpate-host bus hub --clock"
        ) from None
    raise ConfigError(
        f"{path} is not the clock of a simulated hand: start palpate-host bus hub --clock again"
    )
