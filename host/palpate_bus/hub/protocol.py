"""Protocol between the hub and its clients: a stream of messages with version and length in every header.

Header (8 bytes, little endian): magic U16, version U8, kind U8, payload length U32. Payloads:

| kind    | direction | payload                                                                       |
|---------|-----------|-------------------------------------------------------------------------------|
| HELLO   | to hub    | flags U8 (1 receive own, 2 control only, 4 CAN FD), bit rate U32, with CAN FD |
|         |           | data bit rate U32, name (UTF-8)                                               |
| WELCOME | to client | transmit queue length U32, bit rate U32                                       |
| FILTERS | to hub    | all U8, then identifier U32, mask U32 for each filter                         |
| SEND    | to hub    | frames: identifier U16, flags U8 (1 remote, 2 verdict wanted), DLC U8, 8 data |
| DELIVER | to client | frames: start of frame U64 (epoch us), then as in SEND (flag 4: own frame)    |
| CREDIT  | to client | U32: frames that have left the transmit queue                                 |
| VERDICT | to client | U8: 1 queued, 0 refused; the reply to a frame sent with "verdict wanted"      |
| MODE    | to client | U8: bit 0 request a verdict on each frame, bit 1 bus-off                      |
| OVERRUN | to client | U32: frames dropped because this client read too slowly                       |
| REQUEST | to hub    | JSON, see control.py                                                          |
| REPLY   | to client | JSON                                                                          |
| REJECT  | to client | text; the hub then closes the connection                                      |
| SEND_FD | to hub    | CAN FD frames: as SEND, with the length in bytes for DLC and 64 data          |
| DELIVER_FD | to client | as DELIVER, with the length in bytes for DLC and 64 data                   |

Flow control: WELCOME grants `transmit queue length` credits, each frame sent takes one, CREDIT returns them
when frames are transmitted. A client without credit refuses the frame at once (ENOBUFS), so that the sender
learns of every frame that is not sent.

A client with flag 4 in HELLO sends and receives CAN FD frames; data bit rate 0 accepts the hub's.

Own frames: those of the same connection, and those that a connection of the same process and name had queued
before it was closed (the hub still transmits them).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import IntEnum, IntFlag
from itertools import groupby
from operator import attrgetter
from struct import Struct
from typing import Any

from palpate_edge.can_bus.can_frame import FD_LENGTHS, MAX_DATA_BYTES, MAX_STANDARD_ID, CanFrame
from palpate_edge.common.errors import BusError

MAGIC = 0x4350
VERSION = 1
MAX_PAYLOAD_BYTES = 256 * 1024

HEADER = Struct("<HBBI")
HELLO = Struct("<BI")
WELCOME = Struct("<II")
COUNT = Struct("<I")
FILTER = Struct("<II")
FRAME, FD_FRAME = Struct("<HBB8s"), Struct("<HBB64s")
STAMPED, FD_STAMPED = Struct("<QHBB8s"), Struct("<QHBB64s")


class GarbledStreamError(BusError):
    """The peer sent bytes that are not a valid message of this protocol."""


class Kind(IntEnum):
    """Kinds of messages."""

    HELLO = 1
    WELCOME = 2
    FILTERS = 3
    SEND = 4
    DELIVER = 5
    CREDIT = 6
    VERDICT = 7
    MODE = 8
    OVERRUN = 9
    REQUEST = 10
    REPLY = 11
    REJECT = 12
    SEND_FD = 13
    DELIVER_FD = 14


class HelloFlag(IntFlag):
    """Flags of HELLO."""

    RECEIVE_OWN = 1
    CONTROL_ONLY = 2
    FD = 4


class FrameFlag(IntFlag):
    """Flags of a frame in SEND and DELIVER."""

    REMOTE = 1
    VERDICT_WANTED = 2
    OWN = 4


class PortMode(IntFlag):
    """State of a port."""

    ASK_VERDICT = 1
    BUS_OFF = 2


# Plain integers, because IntFlag arithmetic would be the most expensive step for each frame.
_REMOTE = int(FrameFlag.REMOTE)
_KINDS = {int(kind): kind for kind in Kind}


@dataclass(frozen=True, slots=True)
class Hello:
    """Contents of a client's first message. data_bitrate: None for a client of classic CAN."""

    name: str
    bitrate: int
    receive_own: bool
    control_only: bool
    data_bitrate: int | None = None


class Splitter:
    """Splitter of a byte stream into messages; it keeps the incomplete message at the end."""

    def __init__(self) -> None:
        self._incomplete = b""

    def feed(self, data: bytes) -> Iterator[tuple[Kind, bytes]]:
        """Yield the messages that `data` completes.

        Raises GarbledStreamError for a wrong magic, version, kind or length; the stream is then unusable.
        """
        buffer = self._incomplete + data if self._incomplete else data
        start = 0
        while len(buffer) - start >= HEADER.size:
            magic, version, number, length = HEADER.unpack_from(buffer, start)
            kind = _KINDS.get(number)
            if magic != MAGIC or kind is None or length > MAX_PAYLOAD_BYTES:
                raise GarbledStreamError(
                    f"not a message of the CAN hub's protocol: header {buffer[start : start + 8].hex()}"
                )
            if version != VERSION:
                raise GarbledStreamError(
                    f"version {version} of the hub's protocol received, version {VERSION} expected:"
                    " install the same palpate on both sides and restart the hub"
                )
            end = start + HEADER.size + length
            if end > len(buffer):
                break
            yield kind, buffer[start + HEADER.size : end]
            start = end
        self._incomplete = buffer[start:]


def message(kind: Kind, payload: bytes = b"") -> bytes:
    """Return one message with its header."""
    return HEADER.pack(MAGIC, VERSION, kind, len(payload)) + payload


def count_message(kind: Kind, count: int) -> bytes:
    """Return a message whose payload is one U32 (CREDIT, OVERRUN)."""
    return message(kind, COUNT.pack(count))


def hello_message(hello: Hello) -> bytes:
    """Return a HELLO message."""
    flags = HelloFlag.RECEIVE_OWN * hello.receive_own | HelloFlag.CONTROL_ONLY * hello.control_only
    data_rate = b""
    if hello.data_bitrate is not None:
        flags |= HelloFlag.FD
        data_rate = COUNT.pack(hello.data_bitrate)
    return message(Kind.HELLO, HELLO.pack(flags, hello.bitrate) + data_rate + hello.name.encode())


def parse_hello(payload: bytes) -> Hello:
    """Parse the payload of HELLO. Raises GarbledStreamError."""
    is_fd = bool(payload) and bool(payload[0] & HelloFlag.FD)
    name_at = HELLO.size + COUNT.size * is_fd
    if len(payload) < name_at:
        raise GarbledStreamError(f"HELLO of {len(payload)} bytes is shorter than {name_at} bytes")
    flags, bitrate = HELLO.unpack_from(payload)
    data_bitrate: int | None = COUNT.unpack_from(payload, HELLO.size)[0] if is_fd else None
    try:
        name = payload[name_at:].decode()
    except UnicodeDecodeError as error:
        raise GarbledStreamError("the name in HELLO is not UTF-8") from error
    if not name or len(name) > 64 or not name.isprintable():
        raise GarbledStreamError(
            f"the name in HELLO is empty, longer than 64 characters or not printable: {name[:80]!r}"
        )
    return Hello(
        name,
        bitrate,
        receive_own=bool(flags & HelloFlag.RECEIVE_OWN),
        control_only=bool(flags & HelloFlag.CONTROL_ONLY),
        data_bitrate=data_bitrate,
    )


def filters_message(filters: list[tuple[int, int]] | None) -> bytes:
    """Return a FILTERS message; None accepts every frame, an empty list none."""
    records = b"".join(FILTER.pack(can_id, mask) for can_id, mask in filters or ())
    return message(Kind.FILTERS, bytes([filters is None]) + records)


def parse_filters(payload: bytes) -> list[tuple[int, int]] | None:
    """Parse the payload of FILTERS. Raises GarbledStreamError."""
    if len(payload) % FILTER.size != 1:
        raise GarbledStreamError(f"FILTERS of {len(payload)} bytes, not 1 byte and {FILTER.size} per filter")
    return None if payload[0] else list(FILTER.iter_unpack(payload[1:]))


def send_messages(frames: Iterable[CanFrame], flags: int = 0) -> bytes:
    """Return SEND and SEND_FD messages with the frames in their order."""
    return b"".join(
        message(Kind.SEND_FD if is_fd else Kind.SEND, b"".join([_packed(frame, flags) for frame in run]))
        for is_fd, run in groupby(frames, attrgetter("fd"))
    )


def deliver_message(won_at_us: int, flags: int, frame: CanFrame) -> bytes:
    """Return a DELIVER or DELIVER_FD message with one frame."""
    if frame.remote:
        flags |= _REMOTE
    kind, layout = (Kind.DELIVER_FD, FD_STAMPED) if frame.fd else (Kind.DELIVER, STAMPED)
    return message(kind, layout.pack(won_at_us, frame.can_id, flags, len(frame.data), frame.data))


def parse_frames(kind: Kind, payload: bytes) -> Iterator[tuple[int, CanFrame]]:
    """Yield (flags, frame) of SEND or SEND_FD.

    Raises GarbledStreamError for a length, identifier or DLC out of range.
    """
    is_fd = kind is Kind.SEND_FD
    for can_id, flags, length, data in _records(kind, FD_FRAME if is_fd else FRAME, payload):
        yield flags, _frame(kind, can_id, flags, data[:length], length, is_fd)


def parse_stamped(kind: Kind, payload: bytes) -> Iterator[tuple[int, int, CanFrame]]:
    """Yield (start of frame in us, flags, frame) of DELIVER or DELIVER_FD. Raises GarbledStreamError."""
    is_fd = kind is Kind.DELIVER_FD
    for won_at_us, can_id, flags, length, data in _records(kind, FD_STAMPED if is_fd else STAMPED, payload):
        yield won_at_us, flags, _frame(kind, can_id, flags, data[:length], length, is_fd)


def _packed(frame: CanFrame, flags: int) -> bytes:
    if frame.remote:
        flags |= _REMOTE
    return (FD_FRAME if frame.fd else FRAME).pack(frame.can_id, flags, len(frame.data), frame.data)


def _records(kind: Kind, layout: Struct, payload: bytes) -> Iterator[tuple[Any, ...]]:
    if len(payload) % layout.size:
        raise GarbledStreamError(f"{kind.name} of {len(payload)} bytes is not a multiple of {layout.size}")
    return layout.iter_unpack(payload)


def _frame(kind: Kind, can_id: int, flags: int, data: bytes, length: int, is_fd: bool) -> CanFrame:
    is_remote = bool(flags & _REMOTE)
    fits = length in FD_LENGTHS and not is_remote if is_fd else length <= MAX_DATA_BYTES
    if can_id > MAX_STANDARD_ID or not fits:
        raise GarbledStreamError(
            f"{kind.name} contains a frame with identifier {can_id:#x} and {length} data bytes"
        )
    return CanFrame(can_id, data, is_remote, is_fd)


def welcome_message(txqueuelen: int, bitrate: int) -> bytes:
    """Return a WELCOME message."""
    return message(Kind.WELCOME, WELCOME.pack(txqueuelen, bitrate))


def parse_welcome(payload: bytes) -> tuple[int, int]:
    """Return (transmit queue length, bit rate) of WELCOME. Raises GarbledStreamError."""
    if len(payload) != WELCOME.size:
        raise GarbledStreamError(f"WELCOME of {len(payload)} bytes, not {WELCOME.size}")
    txqueuelen, bitrate = WELCOME.unpack(payload)
    return txqueuelen, bitrate


def parse_count(payload: bytes) -> int:
    """Parse the payload of CREDIT or OVERRUN. Raises GarbledStreamError."""
    if len(payload) != COUNT.size:
        raise GarbledStreamError(f"CREDIT or OVERRUN of {len(payload)} bytes, not {COUNT.size}")
    count: int = COUNT.unpack(payload)[0]
    return count


def parse_byte(payload: bytes) -> int:
    """Parse the payload of VERDICT or MODE. Raises GarbledStreamError."""
    if len(payload) != 1:
        raise GarbledStreamError(f"VERDICT or MODE of {len(payload)} bytes, not 1")
    return payload[0]
