"""Bus load of a hand before any hardware is bought: the bits of every periodic frame.

Frames and their lengths come from the two EDS files. A frame takes 47 + 8 n bits (with the interframe space)
and stuff bits: none at best, floor((34 + 8 n - 1) / 4) at worst (Davis, Burns, Bril, Lukkien, Real-Time
Systems 35, 2007, 239-272). The mean is counted bit by bit over ordinary values.

On a CAN FD bus a fingertip sends its contacts as TPDO 10, a CAN FD frame; the drives' PDOs may be such frames
or classic ones, and those of drive nodes with several axes are such frames. All other frames stay classic.
Bits are bit times of the nominal rate.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from random import Random
from statistics import fmean

import msgspec

from palpate_bus.eds.cia402 import CIA402_EDS
from palpate_bus.eds.cia402_axes import (
    axes_codec,
    axes_of_tpdos,
    command_words,
    profile_key,
    state_words,
)
from palpate_bus.load.bit_count import frame_bits
from palpate_bus.load.fd_bit_count import fd_frame_bits, least_fd_bits, worst_fd_bits
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.contact_quantities import AI_INPUT, POSE_TPDOS, QUANTITIES
from palpate_edge.node.cob_ids import NOT_VALID
from palpate_edge.node.eds import load_eds
from palpate_edge.node.fd_bus import on_fd_bus
from palpate_edge.node.object_dictionary import Entry, ObjectDictionary
from palpate_edge.node.parsed_eds import FINGERTIP_EDS
from palpate_edge.node.pdo_codec import PdoCodec, PdoDirection, pdo_codec
from palpate_edge.node.pdo_parameters import pdo_numbers, with_tpdos_enabled

SAMPLES = 200
FITS_PERCENT = 80.0
"""Worst-case load up to which a case fits; a fifth is left for unplanned traffic and errors."""

TIME_STAMP_ID = 0x1FF  # RPDO 1 of every fingertip
HOST_NODE, FIRST_FINGERTIP, FIRST_DRIVE = 0x7F, 0x10, 1
TARGET_TORQUE = 0x60710010  # mapping word of axis 0
NODE_IDS = 127

# Ordinary raw values of the objects. An object that is not listed takes the whole range of its type.
_USUAL: dict[tuple[int, int], tuple[int, int]] = {
    **{(AI_INPUT, quantity.channel): quantity.usual_raw for quantity in QUANTITIES},
    (0x2010, 0): (4, 5),
    (0x2011, 0): (200, 255),
    (0x2014, 0): (2000, 12000),
    (0x2020, 0): (200, 500),
    (0x2021, 0): (0, 3),
    (0x2022, 0): (0, 30),
    (0x6040, 0): (0x0F, 0x0F),
    (0x6041, 0): (0x1637, 0x1637),
    (0x6060, 0): (10, 10),
    (0x6061, 0): (10, 10),
    (0x6064, 0): (-60_000, 60_000),
    (0x606C, 0): (-10_000, 10_000),
    (0x6071, 0): (-100, 100),
    (0x6077, 0): (-100, 100),
}


@dataclass(frozen=True, slots=True)
class BudgetCase:
    """A hand on a bus. joints: those with a drive node of their own, of all fingers together.
    pose_fingertips: how many fingertips send the pose of a flat object. axis_nodes: number of axes of each
    drive node with several, which a CAN FD bus may have.

    data_bitrate: bit/s of the data phase of CAN FD frames; None for a classic bus. classic_drives: the drives
    send and receive classic frames on it.
    sdo_per_s: SDO requests reserved for the master, each with a response; time_stamps_per_s: 1013h.
    """

    fingertips: int = 3
    joints: int = 9
    frames_per_s: float = 30.0
    tick_Hz: float = 100.0
    bitrate: int = 1_000_000
    heartbeat_ms: float = 100.0
    time_stamps_per_s: float = 20.0
    sdo_per_s: float = 20.0
    pose_fingertips: int = 0
    data_bitrate: int | None = None
    classic_drives: bool = False
    axis_nodes: tuple[int, ...] = ()

    @property
    def nodes(self) -> int:
        """Number of nodes, with the host."""
        return self.fingertips + self.joints + len(self.axis_nodes) + 1

    @property
    def drives(self) -> int:
        """Number of drives, in nodes of their own or axes of a node."""
        return self.joints + sum(self.axis_nodes)

    def sharing_nodes(self, axes: int) -> BudgetCase:
        """Return the same hand with up to `axes` drives in a node."""
        full, rest = divmod(self.drives, axes)
        return replace(self, joints=0, axis_nodes=(axes,) * full + ((rest,) if rest else ()))


@dataclass(frozen=True, slots=True)
class FrameStream:
    """One kind of frame. per_s: of all senders together; least, mean, worst: bits per frame; senders: number
    of nodes that send it."""

    name: str
    length: int
    per_s: float
    least: float
    mean: float
    worst: float
    senders: int = 1


@dataclass(frozen=True, slots=True)
class Budget:
    """The streams of a case; loads in per cent of the bit rate.

    burst_us: longest time of one frame from each sender of the streams with 10 frames/s or more from each.
    """

    case: BudgetCase
    streams: tuple[FrameStream, ...]
    burst_us: float

    @property
    def mean_percent(self) -> float:
        """Mean load."""
        return self._percent(stream.per_s * stream.mean for stream in self.streams)

    @property
    def worst_percent(self) -> float:
        """Load if every frame has as many stuff bits as possible."""
        return self._percent(stream.per_s * stream.worst for stream in self.streams)

    @property
    def frames_per_s(self) -> float:
        """Frames of all streams together."""
        return sum(stream.per_s for stream in self.streams)

    @property
    def verdict(self) -> str:
        """Verdict: ``fits``, ``tight`` (at most 100 % at worst) or ``does not fit``."""
        if self.case.nodes > NODE_IDS or self.worst_percent > 100.0:
            return "does not fit"
        in_time = self.burst_us <= 1e6 / self.case.tick_Hz
        return "fits" if in_time and self.worst_percent <= FITS_PERCENT else "tight"

    def percent_of(self, stream: FrameStream) -> float:
        """Return the stream's mean load."""
        return self._percent([stream.per_s * stream.mean])

    def _percent(self, bits_per_s: Iterable[float]) -> float:
        return 100.0 * sum(bits_per_s) / self.case.bitrate


def budget(case: BudgetCase) -> Budget:
    """Return the load of a case."""
    streams = [
        *_fingertip_streams(case),
        *_drive_streams(case),
        *_axes_streams(case),
        _stream("SYNC", 0x080, (b"",), case.tick_Hz),
        _stream("heartbeats", 0x700 + FIRST_FINGERTIP, (b"\x05",), case.nodes * 1000.0 / case.heartbeat_ms),
    ]
    dice = Random(0)
    transfers = tuple(b"\x43" + dice.randbytes(7) for _ in range(SAMPLES))
    streams.append(_stream("SDO reserve", 0x600 + FIRST_FINGERTIP, transfers, 2 * case.sdo_per_s))
    periodic = [stream for stream in streams if stream.name.startswith(("fingertip", "drive", "SYNC"))]
    fast = [stream for stream in periodic if stream.per_s >= 10.0 * stream.senders]
    burst_us = sum(stream.worst * stream.senders for stream in fast) * 1e6 / case.bitrate
    return Budget(case, tuple(stream for stream in streams if stream.per_s), burst_us)


def largest_frame_rate(case: BudgetCase) -> float:
    """Return the camera frames/s at which the worst-case load is FITS_PERCENT; 0 if the rest exceeds it."""
    none, one = (budget(replace(case, frames_per_s=rate)).worst_percent for rate in (0.0, 1.0))
    return max(0.0, (FITS_PERCENT - none) / (one - none)) if one > none else 0.0


def largest_tick_rate(case: BudgetCase) -> float:
    """Return the ticks/s at which the case just fits: worst-case load FITS_PERCENT, and a burst no longer
    than a tick; 0 if the rest exceeds the load."""
    none, one = (budget(replace(case, tick_Hz=rate)).worst_percent for rate in (0.0, 1.0))
    if none > FITS_PERCENT:
        return 0.0
    rate_Hz = (FITS_PERCENT - none) / (one - none) if one > none else 1e6
    return min(rate_Hz, 1e6 / budget(replace(case, tick_Hz=rate_Hz)).burst_us)


def most_drives(case: BudgetCase) -> int | None:
    """Return the largest number of drives with a node each that fits; None if not even none fits."""
    for count in range(NODE_IDS):
        if budget(replace(case, joints=count, axis_nodes=())).verdict != "fits":
            return count - 1 if count else None
    return NODE_IDS - 1


def on_classic_can(case: BudgetCase) -> BudgetCase:
    """Return the same hand on a bus of classic CAN, where each drive has a node of its own."""
    return replace(case, joints=case.drives, axis_nodes=(), data_bitrate=None, classic_drives=False)


def further_classic_frames(result: Budget) -> int:
    """Return the frames/s of classic CAN with 8 bytes that fit beside a case, by their worst-case bits."""
    return max(0, int((FITS_PERCENT - result.worst_percent) / 100 * result.case.bitrate / worst_bits(8)))


def worst_bits(length: int) -> int:
    """Return the bits of a data frame of `length` bytes with as many stuff bits as possible."""
    return 47 + 8 * length + (34 + 8 * length - 1) // 4


def _fingertip_streams(case: BudgetCase) -> list[FrameStream]:
    """Return a stream for each TPDO of the fingertips, and one for the time stamp that all receive."""
    od, posed = load_eds(FINGERTIP_EDS, FIRST_FINGERTIP), case.pose_fingertips
    if case.data_bitrate is None:
        plain, with_poses = od, with_tpdos_enabled(od, POSE_TPDOS)
    else:
        plain, with_poses = (on_fd_bus(od, poses=poses) for poses in (False, True))
    streams, sent_by_all = [], set()
    for codec in _enabled(plain):
        senders = case.fingertips - (posed if codec.layout.fd else 0)
        if not codec.layout.fd:
            sent_by_all.add(str(codec))
        streams.append(
            _pdo_stream(case, f"fingertip {codec.label}", codec, _rate(plain, codec, case), senders)
        )
    for codec in _enabled(with_poses):
        if str(codec) not in sent_by_all:
            name = f"fingertip {codec.label}" + (", poses" if codec.layout.fd else "")
            streams.append(_pdo_stream(case, name, codec, _rate(od, codec, case), posed))
    return streams


def _drive_streams(case: BudgetCase) -> list[FrameStream]:
    od = load_eds(CIA402_EDS, FIRST_DRIVE)
    is_fd = case.data_bitrate is not None and not case.classic_drives
    streams = []
    for codec in _enabled(od):
        as_sent = msgspec.structs.replace(codec, layout=msgspec.structs.replace(codec.layout, fd=is_fd))
        rate = _rate(od, codec, case)
        streams.append(_pdo_stream(case, f"drive {codec.label}", as_sent, rate, case.joints))
    return streams


def _axes_streams(case: BudgetCase) -> Iterator[FrameStream]:
    """Yield the streams of drive nodes with several axes, by their number of axes."""
    for count, nodes in sorted(Counter(case.axis_nodes).items(), reverse=True):
        parts = axes_of_tpdos(range(count))
        codecs = [
            axes_codec(FIRST_DRIVE, PdoDirection.TRANSMIT, number, state_words(axes))
            for number, axes in enumerate(parts, 1)
        ]
        words = command_words(range(count), TARGET_TORQUE)
        codecs.append(axes_codec(FIRST_DRIVE, PdoDirection.RECEIVE, 1, words))
        for codec in codecs:
            name = f"drive {codec.label}, {count} axes"
            yield _pdo_stream(case, name, codec, case.tick_Hz, nodes)


def _enabled(od: ObjectDictionary) -> Iterator[PdoCodec]:
    for direction in PdoDirection:
        for number in pdo_numbers(od, direction):
            if not od.default_number(direction.communication_index + number - 1, 1) & NOT_VALID:
                yield pdo_codec(od, direction, number)


def _with_camera_frame(od: ObjectDictionary, codec: PdoCodec) -> bool:
    """Return whether a node sends the PDO with each camera frame: event-driven, without an event timer."""
    index = codec.direction.communication_index + codec.number - 1
    if codec.direction is PdoDirection.RECEIVE or od.default_number(index, 2) <= 240:
        return False
    return (index, 5) not in od.entries or not od.default_number(index, 5)


def _rate(od: ObjectDictionary, codec: PdoCodec, case: BudgetCase) -> float:
    """Return the frames/s of one node by the PDO's transmission type and event timer."""
    index = codec.direction.communication_index + codec.number - 1
    if codec.direction is PdoDirection.RECEIVE:
        return case.tick_Hz
    if _with_camera_frame(od, codec):
        return case.frames_per_s
    transmission = od.default_number(index, 2)
    if 1 <= transmission <= 240:
        return case.tick_Hz / transmission
    return 1000.0 / od.default_number(index, 5)


@cache
def _payloads(codec: PdoCodec) -> tuple[bytes, ...]:
    dice = Random(0)
    return tuple(
        codec.encode({entry.key: dice.randint(*_usual_range(entry)) for entry in codec.layout.entries})
        for _ in range(SAMPLES)
    )


def _usual_range(entry: Entry) -> tuple[int, int]:
    bits = 8 * (entry.size_bytes or 0)
    signed = entry.data_type.name.startswith("INTEGER")
    whole = (-(1 << bits - 1), (1 << bits - 1) - 1) if signed else (0, (1 << bits) - 1)
    return _USUAL.get(entry.key) or _USUAL.get(profile_key(entry.key), whole)


def _pdo_stream(case: BudgetCase, name: str, codec: PdoCodec, rate: float, senders: int) -> FrameStream:
    """Return the stream of one PDO. rate: of one sender; the time stamp has one for all its receivers."""
    if codec.cob_id == TIME_STAMP_ID:
        name, per_s = "time stamp", case.time_stamps_per_s if senders else 0.0
    else:
        per_s = senders * rate
    payloads = _payloads(codec)
    if not codec.layout.fd or case.data_bitrate is None:
        return _stream(name, codec.cob_id, payloads, per_s, senders)
    rates = case.bitrate, case.data_bitrate
    mean = _mean_fd_bits(codec.cob_id, payloads, *rates)
    length = codec.length_bytes
    least, worst = (bits(length).nominal_bits(*rates) for bits in (least_fd_bits, worst_fd_bits))
    return FrameStream(name, length, per_s, least, mean, worst, senders)


def _stream(
    name: str, can_id: int, payloads: tuple[bytes, ...], per_s: float, senders: int = 1
) -> FrameStream:
    length, mean = len(payloads[0]), _mean_bits(can_id, payloads)
    return FrameStream(name, length, per_s, 47 + 8 * length, mean, worst_bits(length), senders)


@cache
def _mean_bits(can_id: int, payloads: tuple[bytes, ...]) -> float:
    return fmean(frame_bits(CanFrame(can_id, data)) for data in payloads)


@cache
def _mean_fd_bits(can_id: int, payloads: tuple[bytes, ...], bitrate: int, data_bitrate: int) -> float:
    """Return the mean in bits of the nominal rate."""
    return fmean(fd_frame_bits(can_id, data).nominal_bits(bitrate, data_bitrate) for data in payloads)
