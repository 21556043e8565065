"""Compute the bus load of a log, over time and per identifier."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from palpate_bus.load.bit_count import frame_bits
from palpate_bus.logs.candump import LogRecord
from palpate_edge.common.contact_quantities import EXTRA_TPDOS, FD_TPDO
from palpate_edge.node.eds import load_eds
from palpate_edge.node.parsed_eds import FINGERTIP_EDS
from palpate_edge.node.pdo_codec import PdoDirection, pdo_codec
from palpate_host.config.hand_config import HandConfig

BIN_US = 100_000

# CiA 301, predefined connection set: function by identifier minus node id.
_BROADCASTS = {0x000: "NMT", 0x080: "SYNC"}
_FUNCTIONS = {
    0x080: "EMCY",
    0x180: "TPDO 1",
    0x200: "RPDO 1",
    0x280: "TPDO 2",
    0x300: "RPDO 2",
    0x380: "TPDO 3",
    0x400: "RPDO 3",
    0x480: "TPDO 4",
    0x500: "RPDO 4",
    0x580: "SDO response",
    0x600: "SDO request",
    0x700: "heartbeat",
}


@dataclass(frozen=True, slots=True)
class IdLoad:
    """Load of one identifier. load_percent: share of the bit rate over the whole log."""

    can_id: int
    name: str
    frames: int
    frames_per_s: float
    load_percent: float


@dataclass(frozen=True, slots=True)
class Traffic:
    """Load of the whole log.

    bin_percent: load in each interval of BIN_US from the first frame, without the incomplete last one;
    peak_percent: the largest of them.
    """

    frames: int
    bits: int
    duration_s: float
    mean_percent: float
    peak_percent: float
    bin_percent: tuple[float, ...]
    ids: tuple[IdLoad, ...]


def traffic(records: Sequence[LogRecord], bitrate: int, hand: HandConfig) -> Traffic:
    """Return the load of `records`, at least two in the order of time."""
    begin_us = records[0].stamp_us
    duration_us = records[-1].stamp_us - begin_us
    bins = [0] * max(1, duration_us // BIN_US)
    frames: dict[int, int] = {}
    bits: dict[int, int] = {}
    for record in records:
        count = frame_bits(record.frame)
        can_id = record.frame.can_id
        frames[can_id] = frames.get(can_id, 0) + 1
        bits[can_id] = bits.get(can_id, 0) + count
        number = (record.stamp_us - begin_us) // BIN_US
        if number < len(bins):
            bins[number] += count
    seconds = duration_us / 1e6
    bin_percent = tuple(100.0 * count * 1e6 / (BIN_US * bitrate) for count in bins)
    return Traffic(
        frames=len(records),
        bits=sum(bits.values()),
        duration_s=seconds,
        mean_percent=100.0 * sum(bits.values()) / (bitrate * seconds),
        peak_percent=max(bin_percent),
        bin_percent=bin_percent,
        ids=tuple(
            IdLoad(
                can_id=can_id,
                name=id_name(can_id, hand),
                frames=frames[can_id],
                frames_per_s=frames[can_id] / seconds,
                load_percent=100.0 * bits[can_id] / (bitrate * seconds),
            )
            for can_id in sorted(bits)
        ),
    )


def id_name(can_id: int, hand: HandConfig) -> str:
    """Return function and node of an identifier as text."""
    if can_id in _BROADCASTS:
        return _BROADCASTS[can_id]
    node = can_id & 0x7F
    fingertips = {finger.fingertip_node for finger in hand.fingers}
    own = _extra_tpdos(node) if node in fingertips else {}
    function = own.get(can_id) or _FUNCTIONS.get(can_id - node, "unknown")
    names = hand.node_names | {hand.network.host_node: "host"}
    return f"{function}, {names.get(node, f'node 0x{node:02X}')}"


def _extra_tpdos(node: int) -> dict[int, str]:
    """Return the TPDOs that a fingertip sends beyond the predefined connection set, by identifier."""
    od = load_eds(FINGERTIP_EDS, node)
    return {
        pdo_codec(od, PdoDirection.TRANSMIT, number).cob_id: f"TPDO {number}"
        for number in (*EXTRA_TPDOS, FD_TPDO)
    }
