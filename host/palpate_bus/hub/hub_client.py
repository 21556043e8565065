"""The hub's record of one connection."""

from __future__ import annotations

from dataclasses import dataclass, field

from palpate_bus.hub import protocol
from palpate_bus.hub.control import PortStatistics
from palpate_bus.hub.protocol import PortMode

NO_MODE = PortMode(0)


@dataclass(slots=True)
class Client:
    """State and counters of one connection.

    output: bytes to be written to its socket. port: None before HELLO, and for a client that only sends
    requests. has_fd: it sends and receives CAN FD frames. process: of the peer, 0 if not known.
    overruns_untold: dropped frames that are not reported to the client yet.
    """

    splitter: protocol.Splitter = field(default_factory=protocol.Splitter)
    output: bytearray = field(default_factory=bytearray)
    name: str = ""
    port: int | None = None
    has_fd: bool = False
    process: int = 0
    mode: PortMode = NO_MODE
    credits_owed: int = 0
    overruns_untold: int = 0
    sent: int = 0
    delivered: int = 0
    overruns: int = 0
    refused: int = 0
    lost_to_bus_off: int = 0
    fd_withheld: int = 0

    def statistics(self) -> PortStatistics:
        """Return the connection's counters."""
        return PortStatistics(
            name=self.name,
            sent=self.sent,
            delivered=self.delivered,
            overruns=self.overruns,
            refused=self.refused,
            lost_to_bus_off=self.lost_to_bus_off,
            bus_off=bool(self.mode & PortMode.BUS_OFF),
            fd_withheld=self.fd_withheld,
        )
