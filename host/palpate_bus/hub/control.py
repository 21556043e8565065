"""Requests to a running hub and their replies: inject a fault, clear faults, statistics (JSON)."""

from __future__ import annotations

from typing import TypeAlias

import msgspec

from palpate_bus.hub.faults import FaultRule


class Inject(msgspec.Struct, frozen=True, tag="inject", forbid_unknown_fields=True):
    """Request to inject a fault."""

    rule: FaultRule


class ClearFaults(msgspec.Struct, frozen=True, tag="clear", forbid_unknown_fields=True):
    """Request to end every fault."""


class AskStatistics(msgspec.Struct, frozen=True, tag="statistics", forbid_unknown_fields=True):
    """Request for `Statistics`."""


Request: TypeAlias = Inject | ClearFaults | AskStatistics


class Done(msgspec.Struct, frozen=True, tag="done"):
    """Reply to a request that was carried out."""


class Refused(msgspec.Struct, frozen=True, tag="refused"):
    """Reply to a request that was not carried out; `reason` is one line."""

    reason: str


class IdCount(msgspec.Struct, frozen=True):
    """Frames and bits of one identifier since the hub started; bits as in `Statistics`."""

    can_id: int
    frames: int
    bits: int


class PortStatistics(msgspec.Struct, frozen=True):
    """Counters of one client of the hub.

    sent: frames transmitted on the wire. overruns: frames dropped because the client read too slowly.
    refused: frames that a tx-full fault refused. lost_to_bus_off: frames dropped because the port was
    bus-off. fd_withheld: CAN FD frames that passed its filters, but the client has no CAN FD.
    """

    name: str
    sent: int
    delivered: int
    overruns: int
    refused: int
    lost_to_bus_off: int
    bus_off: bool
    fd_withheld: int = 0


class FaultStatistics(msgspec.Struct, frozen=True):
    """An active fault and the number of frames it has affected."""

    rule: FaultRule
    hits: int


class Statistics(msgspec.Struct, frozen=True, tag="statistics"):
    """The hub's counters.

    bits are bit times of the nominal rate: the data phase of a CAN FD frame counts by its time. A hub without
    a bit rate (bitrate 0) counts that time as at 1 Mbit/s, and has no load.
    window_bits: bits on the wire in the last window_us. garbled_clients: clients that were disconnected
    because they violated the protocol. data_bitrate: None on a classic bus.
    """

    uptime_us: int
    bitrate: int
    txqueuelen: int
    frames: int
    bits: int
    window_us: int
    window_bits: int
    garbled_clients: int
    ids: list[IdCount]
    ports: list[PortStatistics]
    faults: list[FaultStatistics]
    data_bitrate: int | None = None

    @property
    def load(self) -> float | None:
        """The share of the window in which the wire was busy, 0 to 1; None without a bit rate."""
        return self.window_bits * 1_000_000 / (self.bitrate * self.window_us) if self.bitrate else None


Reply: TypeAlias = Done | Refused | Statistics

request_decoder: msgspec.json.Decoder[Request] = msgspec.json.Decoder(Request)
reply_decoder: msgspec.json.Decoder[Reply] = msgspec.json.Decoder(Reply)
