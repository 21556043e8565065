"""The messages between the hub and its clients: one stream, version and length in every header.

Header (8 bytes, little endian): magic U16, version U8, kind U8, payload length U32. Payloads:

| kind    | direction | payload                                                                       |
|---------|-----------|-------------------------------------------------------------------------------|
| HELLO   | to hub    | flags U8 (bit 0 receive own, bit 1 control only), bit rate U32, name (UTF-8)  |
| WELCOME | to client | transmit queue length U32, bit rate U32                                       |
| FILTERS | to hub    | all U8, then identifier U32, mask U32 for each filter                         |
| SEND    | to hub    | frames: identifier U16, flags U8 (1 remote, 2 verdict wanted), DLC U8, 8 data |
| DELIVER | to client | frames: won the wire at U64 (epoch us), then as in SEND (flag 4: own frame)   |
| CREDIT  | to client | U32: frames that have left the transmit queue                                 |
| VERDICT | to client | U8: 1 queued, 0 refused: answers a frame sent with "verdict wanted"           |
| MODE    | to client | U8: bit 0 ask for a verdict on each frame, bit 1 bus-off                      |
| OVERRUN | to client | U32: frames this client was too slow to take                                  |
| REQUEST | to hub    | JSON, see control.py                                                          |
| REPLY   | to client | JSON                                                                          |
| REJECT  | to client | text; the hub then hangs up                                                   |

Flow control: WELCOME grants `transmit queue length` credits, each frame sent takes one, CREDIT gives them
back when frames have won the wire. A client without credit refuses the frame at once (ENOBUFS), so no frame
is lost behind the sender's back.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum, IntFlag
from struct import Struct

from palpate_edge.can_bus.can_frame import MAX_DATA_BYTES, MAX_STANDARD_ID, CanFrame
from palpate_edge.common.errors import BusError

MAGIC = 0x4350
VERSION = 1
MAX_PAYLOAD_BYTES = 256 * 1024

HEADER = Struct("<HBBI")
HELLO = Struct("<BI")
WELCOME = Struct("<II")
COUNT = Struct("<I")
FILTER = Struct("<II")
FRAME = Struct("<HBB8s")
STAMPED = Struct("<QHBB8s")


class GarbledStreamError(BusError):
    """The other side sent bytes that are no message of this protocol."""


class Kind(IntEnum):
    """What a message is."""

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


class HelloFlag(IntFlag):
    """What a client asks for."""

    RECEIVE_OWN = 1
    CONTROL_ONLY = 2


class FrameFlag(IntFlag):
    """Flags of a frame in SEND and DELIVER."""

    REMOTE = 1
    VERDICT_WANTED = 2
    OWN = 4


class PortMode(IntFlag):
    """State of a port."""

    ASK_VERDICT = 1
    BUS_OFF = 2


# Plain integers for the paths taken for each frame: IntFlag arithmetic costs more than the rest of it.
_REMOTE = int(FrameFlag.REMOTE)
_KINDS = {int(kind): kind for kind in Kind}


@dataclass(frozen=True, slots=True)
class Hello:
    """A client's first message."""

    name: str
    bitrate: int
    receive_own: bool
    control_only: bool


class Splitter:
    """Cuts a byte stream into messages; keeps the unfinished rest."""

    def __init__(self) -> None:
        self._rest = b""

    def feed(self, data: bytes) -> Iterator[tuple[Kind, bytes]]:
        """The messages that `data` completes.

        Raises GarbledStreamError at a wrong magic, version, kind or length; the stream is then lost.
        """
        buffer = self._rest + data if self._rest else data
        start = 0
        while len(buffer) - start >= HEADER.size:
            magic, version, number, length = HEADER.unpack_from(buffer, start)
            kind = _KINDS.get(number)
            if magic != MAGIC or kind is None or length > MAX_PAYLOAD_BYTES:
                raise GarbledStreamError(
                    f"not a message of the CAN hub: header {buffer[start : start + 8].hex()}"
                )
            if version != VERSION:
                raise GarbledStreamError(
                    f"the other side speaks version {version} of the hub's protocol, this one {VERSION}: "
                    "update palpate on both sides and restart the hub"
                )
            end = start + HEADER.size + length
            if end > len(buffer):
                break
            yield kind, buffer[start + HEADER.size : end]
            start = end
        self._rest = buffer[start:]


def message(kind: Kind, payload: bytes = b"") -> bytes:
    """One message with its header."""
    return HEADER.pack(MAGIC, VERSION, kind, len(payload)) + payload


def count_message(kind: Kind, count: int) -> bytes:
    """A message whose payload is one U32 (CREDIT, OVERRUN)."""
    return message(kind, COUNT.pack(count))


def hello_message(hello: Hello) -> bytes:
    """HELLO."""
    flags = HelloFlag.RECEIVE_OWN * hello.receive_own | HelloFlag.CONTROL_ONLY * hello.control_only
    return message(Kind.HELLO, HELLO.pack(flags, hello.bitrate) + hello.name.encode())


def parse_hello(payload: bytes) -> Hello:
    """The content of HELLO; raises GarbledStreamError."""
    if len(payload) < HELLO.size:
        raise GarbledStreamError(f"HELLO of {len(payload)} bytes is too short")
    flags, bitrate = HELLO.unpack_from(payload)
    try:
        name = payload[HELLO.size :].decode()
    except UnicodeDecodeError as error:
        raise GarbledStreamError("the name in HELLO is no UTF-8") from error
    if not name or len(name) > 64 or not name.isprintable():
        raise GarbledStreamError(
            f"the name in HELLO is empty, longer than 64 characters or not printable: {name[:80]!r}"
        )
    return Hello(name, bitrate, bool(flags & HelloFlag.RECEIVE_OWN), bool(flags & HelloFlag.CONTROL_ONLY))


def filters_message(filters: list[tuple[int, int]] | None) -> bytes:
    """FILTERS; None accepts every frame, an empty list none."""
    records = b"".join(FILTER.pack(can_id, mask) for can_id, mask in filters or ())
    return message(Kind.FILTERS, bytes([filters is None]) + records)


def parse_filters(payload: bytes) -> list[tuple[int, int]] | None:
    """The content of FILTERS; raises GarbledStreamError."""
    if len(payload) % FILTER.size != 1:
        raise GarbledStreamError(f"FILTERS of {len(payload)} bytes")
    return None if payload[0] else list(FILTER.iter_unpack(payload[1:]))


def pack_frame(frame: CanFrame, flags: int = 0) -> bytes:
    """One frame as in SEND."""
    if frame.remote:
        flags |= _REMOTE
    return FRAME.pack(frame.can_id, flags, len(frame.data), frame.data)


def parse_frames(payload: bytes) -> Iterator[tuple[int, CanFrame]]:
    """(flags, frame) of SEND; raises GarbledStreamError at a length, identifier or DLC out of range."""
    if len(payload) % FRAME.size:
        raise GarbledStreamError(f"SEND of {len(payload)} bytes is no multiple of {FRAME.size}")
    for can_id, flags, length, data in FRAME.iter_unpack(payload):
        if can_id > MAX_STANDARD_ID or length > MAX_DATA_BYTES:
            raise GarbledStreamError(
                f"SEND holds a frame with identifier {can_id:#x} and {length} data bytes"
            )
        yield flags, CanFrame(can_id, data[:length], bool(flags & _REMOTE))


def parse_stamped(payload: bytes) -> Iterator[tuple[int, int, CanFrame]]:
    """(won at us, flags, frame) of DELIVER; raises GarbledStreamError."""
    if len(payload) % STAMPED.size:
        raise GarbledStreamError(f"DELIVER of {len(payload)} bytes is no multiple of {STAMPED.size}")
    for won_at_us, can_id, flags, length, data in STAMPED.iter_unpack(payload):
        if can_id > MAX_STANDARD_ID or length > MAX_DATA_BYTES:
            raise GarbledStreamError(
                f"DELIVER holds a frame with identifier {can_id:#x} and {length} data bytes"
            )
        yield won_at_us, flags, CanFrame(can_id, data[:length], bool(flags & _REMOTE))


def welcome_message(txqueuelen: int, bitrate: int) -> bytes:
    """WELCOME."""
    return message(Kind.WELCOME, WELCOME.pack(txqueuelen, bitrate))


def parse_welcome(payload: bytes) -> tuple[int, int]:
    """(transmit queue length, bit rate) of WELCOME; raises GarbledStreamError."""
    if len(payload) != WELCOME.size:
        raise GarbledStreamError(f"WELCOME of {len(payload)} bytes")
    txqueuelen, bitrate = WELCOME.unpack(payload)
    return txqueuelen, bitrate


def parse_count(payload: bytes) -> int:
    """The content of CREDIT, OVERRUN; raises GarbledStreamError."""
    if len(payload) != COUNT.size:
        raise GarbledStreamError(f"a count of {len(payload)} bytes")
    count: int = COUNT.unpack(payload)[0]
    return count


def parse_byte(payload: bytes) -> int:
    """The content of VERDICT, MODE; raises GarbledStreamError."""
    if len(payload) != 1:
        raise GarbledStreamError(f"a flag of {len(payload)} bytes")
    return payload[0]
