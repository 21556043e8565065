"""The time of a simulated hand, in a file that all its processes map: one keeps it, the others go by it.

It is CLOCK_MONOTONIC, held back whenever the simulation could not keep up. A slow machine then makes
everything slow alike, and nothing late. The file holds three words of this machine, each read and written at
once:

    0   8 bytes  magic
    8   i64      held back so far, us
    16  i64      until: the time that must not be passed before the keeper says so, us

A keeper that has not spoken for GONE_US no longer holds the time: what it simulated is missed, as it must be.
"""

from __future__ import annotations

import mmap
import os
import struct
from collections.abc import Callable
from pathlib import Path

from palpate_edge.can_bus.bus import BusConfig
from palpate_edge.common.errors import ConfigError
from palpate_edge.common.local_clock import LocalClock, monotonic_us

MAGIC = b"PALPTIME"
FORMAT = struct.Struct("@8sqq")
HELD, UNTIL = 1, 2
FOR_EVER_US = 2**62
GONE_US = 5_000_000
AHEAD_US = 3_000
"""The time goes on by itself for so long after the keeper's last word."""
SLOWLY = 20
"""How much slower than CLOCK_MONOTONIC the time goes while the keeper waits: what it waits for needs time."""


def make_clock(path: Path) -> LocalClock:
    """A new clock, without a keeper yet. Raises ConfigError where the file cannot be made."""
    fresh = path.with_name(f"{path.name}.{os.getpid()}")
    try:
        fresh.write_bytes(FORMAT.pack(MAGIC, 0, FOR_EVER_US))
        fresh.replace(path)
    except OSError as error:
        raise ConfigError(f"{path} cannot be made: {error.strerror}: give another path") from None
    return LocalClock(SimulatedClock(path).now_us)


class SimulatedClock:
    """`now_us` never goes back. Raises ConfigError for a file that is missing or no clock."""

    def __init__(self, path: Path, machine_us: Callable[[], int] = monotonic_us) -> None:
        self._words = _mapped(path, mmap.ACCESS_READ)
        self._machine_us = machine_us
        self._last_us = 0

    def now_us(self) -> int:
        free_us = self._machine_us() - self._words[HELD]
        until_us = max(self._words[UNTIL], free_us - GONE_US)
        self._last_us = max(self._last_us, min(free_us, until_us))
        return self._last_us


class ClockKeeper:
    """Holds the time back; to be called more often than AHEAD_US. held_us: how far behind it is.

    One keeper a clock. Raises ConfigError as SimulatedClock.
    """

    def __init__(self, path: Path, machine_us: Callable[[], int] = monotonic_us) -> None:
        self._clock = SimulatedClock(path, machine_us)
        self._words = _mapped(path, mmap.ACCESS_WRITE)
        self._machine_us = machine_us
        self._spoken_us = machine_us()
        self.held_us = 0

    def now_us(self) -> int:
        return self._clock.now_us()

    def go_on(self, *, slowly: bool) -> None:
        """The time may pass: as the machine's does, or slowly."""
        free_us, now_us = self._machine_us(), self.now_us()
        ahead_us = (free_us - self._spoken_us) // SLOWLY if slowly else AHEAD_US
        self._spoken_us, self.held_us = free_us, free_us - now_us
        # In this order: between the two, a reader sees the time stand still.
        self._words[HELD] = self.held_us
        self._words[UNTIL] = now_us + ahead_us

    def close(self) -> None:
        """From now on nobody holds the time."""
        self.go_on(slowly=False)
        self._words[UNTIL] = FOR_EVER_US


def clock_of(bus: BusConfig) -> LocalClock:
    """By which everything on this bus goes. Raises ConfigError as SimulatedClock, or for a real bus."""
    if not bus.clock:
        return LocalClock()
    if bus.interface != "palpate":
        raise ConfigError(
            f"bus.clock is of a simulated hand on the hub, not of {bus.interface}: leave it out"
        )
    return LocalClock(SimulatedClock(Path(bus.clock)).now_us)


def _mapped(path: Path, access: int) -> memoryview:
    """The words; a memoryview gives and takes each in one piece, which struct does not."""
    try:
        with path.open("r+b" if access == mmap.ACCESS_WRITE else "rb") as file:
            is_whole = os.fstat(file.fileno()).st_size == FORMAT.size and file.read(len(MAGIC)) == MAGIC
            if is_whole:
                return memoryview(mmap.mmap(file.fileno(), FORMAT.size, access=access)).cast("q")
    except FileNotFoundError:
        raise ConfigError(
            f"{path} is missing: start what makes it (palpate-host bus hub --clock), or leave bus.clock out"
        ) from None
    except OSError as error:
        raise ConfigError(f"{path} cannot be read: {error.strerror}") from None
    raise ConfigError(f"{path} is no clock of a simulated hand: start palpate-host bus hub --clock again")
