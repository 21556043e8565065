"""Reader of one topic of an MCAP file, also of a file that was never finished.

Reads as much of the format as our own recordings need: records in the order of the file, no index. Source of
the format: the MCAP specification, version 0 (mcap.dev): magic, then records of opcode (U8), length (U64),
body.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path

import pyarrow as pa

from palpate_edge.common.errors import ConfigError

STATUS_TOPIC = "/host/status"
MAGIC = b"\x89MCAP0\r\n"
RECORD = struct.Struct("<BQ")
CHANNEL, MESSAGE, CHUNK, DATA_END = 0x04, 0x05, 0x06, 0x0F
MESSAGE_HEADER = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
CHUNK_HEADER = struct.Struct("<QQQI")  # first and last time, size when unpacked, CRC


def messages(path: Path, topic: str) -> Iterator[bytes]:
    """Yield the payloads of `topic`. A truncated last record or chunk is omitted.

    Raises ConfigError if the file is no MCAP file, cannot be read, or has a chunk of unknown compression.
    """
    try:
        size = path.stat().st_size
        with path.open("rb") as file:
            if file.read(len(MAGIC)) != MAGIC:
                raise ConfigError(f"{path}: not an MCAP file: give another file")
            wanted: set[int] = set()
            while len(head := file.read(RECORD.size)) == RECORD.size:
                opcode, length = RECORD.unpack(head)
                if opcode == DATA_END:
                    return
                if length > size - file.tell():  # truncated, or a chunk that was not finished
                    return
                yield from _payloads(path, opcode, file.read(length), topic, wanted)
    except OSError as exc:
        raise ConfigError(f"{path}: cannot be read ({exc.strerror}): check the path") from exc


def _payloads(path: Path, opcode: int, body: bytes, topic: str, wanted: set[int]) -> Iterator[bytes]:
    """Yield the payloads in one record; `wanted` collects the ids of the topic's channels."""
    if opcode == CHANNEL:
        (channel,) = struct.unpack_from("<H", body)
        (length,) = struct.unpack_from("<I", body, 4)
        if body[8 : 8 + length].decode() == topic:
            wanted.add(channel)
    elif opcode == MESSAGE:
        if MESSAGE_HEADER.unpack_from(body)[0] in wanted:
            yield body[MESSAGE_HEADER.size :]
    elif opcode == CHUNK:
        records = _unpacked(path, body)
        place = 0
        while place + RECORD.size <= len(records):
            inner, length = RECORD.unpack_from(records, place)
            place += RECORD.size
            yield from _payloads(path, inner, records[place : place + length], topic, wanted)
            place += length


def _unpacked(path: Path, chunk: bytes) -> bytes:
    _, _, size, _ = CHUNK_HEADER.unpack_from(chunk)
    (length,) = struct.unpack_from("<I", chunk, CHUNK_HEADER.size)
    start = CHUNK_HEADER.size + 4
    packing = chunk[start : start + length].decode()
    data = chunk[start + length + 8 :]
    if not packing:
        return data
    try:
        return bytes(pa.decompress(data, size, codec=packing, asbytes=True))
    except (ValueError, OSError, pa.ArrowException) as exc:
        raise ConfigError(
            f"{path}: a chunk compressed with {packing} cannot be read ({exc}): record it again"
        ) from exc
