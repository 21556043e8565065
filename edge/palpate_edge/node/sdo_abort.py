"""SDO abort codes of CiA 301 (7.2.4.3.17) that these nodes send."""

from __future__ import annotations

from enum import IntEnum

from palpate_edge.common.errors import BusError


class AbortCode(IntEnum):
    """Reasons for aborting an SDO transfer."""

    TOGGLE_BIT = 0x0503_0000
    TIMED_OUT = 0x0504_0000
    COMMAND_UNKNOWN = 0x0504_0001
    BLOCK_SIZE = 0x0504_0002
    SEQUENCE_NUMBER = 0x0504_0003
    CRC = 0x0504_0004
    OUT_OF_MEMORY = 0x0504_0005
    WRITE_ONLY = 0x0601_0001
    READ_ONLY = 0x0601_0002
    NO_OBJECT = 0x0602_0000
    NOT_MAPPABLE = 0x0604_0041
    PDO_TOO_LONG = 0x0604_0042
    PARAMETER_CLASH = 0x0604_0043
    HARDWARE = 0x0606_0000
    LENGTH_MISMATCH = 0x0607_0010
    TOO_LONG = 0x0607_0012
    TOO_SHORT = 0x0607_0013
    NO_SUBINDEX = 0x0609_0011
    VALUE_INVALID = 0x0609_0030
    VALUE_TOO_HIGH = 0x0609_0031
    VALUE_TOO_LOW = 0x0609_0032
    NOT_STORED = 0x0800_0020
    LOCAL_CONTROL = 0x0800_0021
    DEVICE_STATE = 0x0800_0022
    NO_DATA = 0x0800_0024


class SdoAbortError(BusError):
    """An SDO access is not allowed; the server sends `code` to the client."""

    def __init__(self, code: AbortCode) -> None:
        super().__init__(f"SDO access aborted with {code:08X}h ({code.name}): correct the request")
        self.code = code
