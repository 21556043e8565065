"""Counters of a bus."""

from __future__ import annotations

import msgspec


class BusCounters(msgspec.Struct):
    """Counters of a `Bus` since it was opened.

    send_retries: attempts that a full transmit queue refused. error_frames: reported by the controller,
    of any kind. foreign_frames: 29-bit frames, and CAN FD frames on a classic bus, left out.
    receive_overruns: reports that the controller or the socket's buffer lost received frames. restarts:
    recoveries from bus-off. own_echoes: frames received that this program had sent itself, left out.
    """

    sent: int = 0
    received: int = 0
    send_retries: int = 0
    error_frames: int = 0
    foreign_frames: int = 0
    receive_overruns: int = 0
    restarts: int = 0
    own_echoes: int = 0

    def plus(self, other: BusCounters) -> BusCounters:
        """Return the sums of both, counter by counter."""
        return BusCounters(
            self.sent + other.sent,
            self.received + other.received,
            self.send_retries + other.send_retries,
            self.error_frames + other.error_frames,
            self.foreign_frames + other.foreign_frames,
            self.receive_overruns + other.receive_overruns,
            self.restarts + other.restarts,
            self.own_echoes + other.own_echoes,
        )
