"""Notify systemd of READY, STATUS, WATCHDOG and STOPPING, if it listens (sd_notify(3))."""

from __future__ import annotations

import os
import socket
from collections.abc import Mapping


class Notifier:
    """A datagram socket to $NOTIFY_SOCKET.

    watchdog_us: systemd expects a notification within this time; None without a watchdog.
    """

    def __init__(self, environment: Mapping[str, str] = os.environ, pid: int | None = None) -> None:
        address = environment.get("NOTIFY_SOCKET", "")
        self._address = "\0" + address[1:] if address.startswith("@") else address
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
        self._socket.setblocking(False)
        watched = environment.get("WATCHDOG_PID", "") in {"", str(os.getpid() if pid is None else pid)}
        microseconds = environment.get("WATCHDOG_USEC", "")
        self.watchdog_us = int(microseconds) if address and watched and microseconds.isdigit() else None

    def ready(self, status: str) -> None:
        self._say(f"READY=1\nSTATUS={status}")

    def status(self, status: str) -> None:
        self._say(f"STATUS={status}")

    def feed_watchdog(self) -> None:
        self._say("WATCHDOG=1")

    def stopping(self) -> None:
        self._say("STOPPING=1")

    def close(self) -> None:
        self._socket.close()

    def _say(self, text: str) -> None:
        if not self._address:
            return
        try:
            self._socket.sendto(text.encode(), self._address)
        except OSError:  # systemd's queue is full, or it restarts: the next message repeats the state
            return


class WatchdogGate:
    """Lets the watchdog be fed only when frames and bus have both gone on since it was fed last.

    Asked every third of the watchdog's time, so that one late answer costs nothing.
    """

    def __init__(self, watchdog_us: int | None) -> None:
        self._period_us = None if watchdog_us is None else watchdog_us // 3
        self._next_us = 0
        self._frames = self._bus_frames = 0

    @property
    def due_us(self) -> int | None:
        return None if self._period_us is None else self._next_us

    def may_feed(self, now_us: int, frames: int, bus_frames: int) -> bool:
        """frames, bus_frames: counted since the start: contacts published, CAN frames sent and received."""
        if self._period_us is None or now_us < self._next_us:
            return False
        self._next_us = now_us + self._period_us
        if frames <= self._frames or bus_frames <= self._bus_frames:
            return False
        self._frames, self._bus_frames = frames, bus_frames
        return True
