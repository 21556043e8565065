"""Decoder of the SDO transfers of one node: expedited, segmented and block (CiA 301, 7.2.4.3)."""

from __future__ import annotations

import struct
from enum import Enum

from palpate_bus.decode.device import Device, Key, Reading
from palpate_bus.decode.sdo_abort_text import abort_text

MAX_VALUE_BYTES = 1 << 20  # further bytes of a value are not kept
SEGMENT_BYTES = 7

Text = tuple[str, tuple[Reading, ...]]


class _Block(Enum):
    """Sender of the block segments in progress."""

    NOBODY = 0
    CLIENT = 1
    SERVER = 2


class SdoListener:
    """Decoder of one node's SDO channel. device: None when its EDS is unknown."""

    def __init__(self, device: Device | None) -> None:
        self._device = device
        self._key: Key = (0, 0)
        self._verb = ""
        self._value = bytearray()
        self._in_block = _Block.NOBODY
        self._next_segment = 1
        self._last_came = False

    def listen(self, from_client: bool, data: bytes) -> Text:
        """Return the frame's text, and the value when the frame completes one."""
        if len(data) != 8:
            return f"malformed: {len(data)} bytes, SDO has 8", ()
        if data[0] == 0x80:
            return self._abort(from_client, data)
        sender = _Block.CLIENT if from_client else _Block.SERVER
        if self._in_block is sender:
            return self._block_segment(data)
        return self._client(data) if from_client else self._server(data)

    def _client(self, data: bytes) -> Text:  # noqa: PLR0911 - one case a command of the standard's table
        command, key = data[0] >> 5, _key(data)
        match command:
            case 0:
                return self._segment("download segment", data)
            case 1:
                self._begin("write", key)
                if data[0] & 2:
                    return self._expedited(data)
                return f"{self._what()}, {_size(data, bool(data[0] & 1))}", ()
            case 2:
                self._begin("read", key)
                return self._what(), ()
            case 3:
                return "request next segment", ()
            case 5 if data[0] & 3 == 0:
                self._begin("read", key)
                return f"{self._what()}, in blocks of {data[4]}", ()
            case 5 if data[0] & 3 == 3:
                self._start_block(_Block.SERVER)
                return "start block transfer", ()
            case 5 if data[0] & 3 == 2:
                return self._acknowledged(_Block.SERVER, data[1])
            case 5:
                return "end block transfer", ()
            case 6 if data[0] & 1 == 0:
                self._begin("write", key)
                return f"{self._what()}, in blocks, {_size(data, bool(data[0] & 2))}", ()
            case 6:
                return self._block_end(data)
        return f"unknown command {data[0]:02X}h", ()

    def _server(self, data: bytes) -> Text:  # noqa: PLR0911
        match data[0] >> 5:
            case 0:
                return self._segment("upload segment", data)
            case 1:
                return "segment confirmed", ()
            case 2:
                self._key = _key(data)
                if data[0] & 2:
                    return self._expedited(data)
                return f"{self._name()}: {_size(data, bool(data[0] & 1))}", ()
            case 3:
                self._key = _key(data)
                return f"{self._name()}: {'written' if self._value else 'ready for segments'}", ()
            case 5 if data[0] & 3 == 0:
                self._start_block(_Block.CLIENT)
                return f"{self._name()}: ready for blocks of {data[4]}", ()
            case 5 if data[0] & 3 == 2:
                return self._acknowledged(_Block.CLIENT, data[1])
            case 5:
                return f"{self._name()}: written", ()
            case 6 if data[0] & 1 == 0:
                return f"{self._name()}: in blocks, {_size(data, bool(data[0] & 2))}", ()
            case 6:
                return self._block_end(data)
        return f"unknown command {data[0]:02X}h", ()

    def _begin(self, verb: str, key: Key) -> None:
        self._verb, self._key = verb, key
        self._value.clear()
        self._in_block = _Block.NOBODY

    def _start_block(self, sender: _Block) -> None:
        self._in_block, self._next_segment, self._last_came = sender, 1, False

    def _acknowledged(self, sender: _Block, up_to: int) -> Text:
        """Process the receiver's acknowledgement of a block: another one follows, except after the last."""
        lost = self._next_segment - 1 - up_to
        if lost > 0:  # these segments are sent again
            del self._value[-SEGMENT_BYTES * lost :]
        if lost or not self._last_came:
            self._start_block(sender)
        return f"block received up to segment {up_to}", ()

    def _expedited(self, data: bytes) -> Text:
        length = 4 - (data[0] >> 2 & 3) if data[0] & 1 else 4
        self._value[:] = data[4 : 4 + length]
        return self._whole()

    def _segment(self, label: str, data: bytes) -> Text:
        count = SEGMENT_BYTES - (data[0] >> 1 & 7)
        self._keep(data[1 : 1 + count])
        return self._whole() if data[0] & 1 else (f"{label}, {count} bytes", ())

    def _block_segment(self, data: bytes) -> Text:
        number = data[0] & 0x7F
        if number == self._next_segment:
            self._keep(data[1:])
            self._next_segment += 1
        if data[0] & 0x80:
            self._in_block, self._last_came = _Block.NOBODY, True
        return f"block segment {number}{', the last' if data[0] & 0x80 else ''}", ()

    def _block_end(self, data: bytes) -> Text:
        self._in_block = _Block.NOBODY
        unused = data[0] >> 2 & 7
        if unused:
            del self._value[-unused:]
        return self._whole()

    def _abort(self, from_client: bool, data: bytes) -> Text:
        code: int = struct.unpack_from("<I", data, 4)[0]
        self._key = _key(data)
        self._in_block = _Block.NOBODY
        sender = "client" if from_client else "node"
        return f"{self._name()}: {sender} aborts, {code:08X}h {abort_text(code)}", ()

    def _whole(self) -> Text:
        data = bytes(self._value)
        reading = self._device.reading(self._key, data) if self._device else None
        if reading is None:
            return f"{self._what()} = {data.hex(' ')}", ()
        return f"{self._what()} = {reading.text}", (reading,)

    def _keep(self, data: bytes) -> None:
        if len(self._value) < MAX_VALUE_BYTES:
            self._value += data

    def _what(self) -> str:
        return f"{self._verb} {self._name()}".lstrip()

    def _name(self) -> str:
        index, subindex = self._key
        return self._device.name_of(self._key) if self._device else f"{index:04X}h:{subindex:02X}"


def _key(data: bytes) -> Key:
    index, subindex = struct.unpack_from("<HB", data, 1)
    return index, subindex


def _size(data: bytes, is_given: bool) -> str:
    return f"{int.from_bytes(data[4:], 'little')} bytes" if is_given else "size not given"
