"""SDO access to objects by name or index: values with units, limits of the EDS, block transfer."""

# mypy: disallow-untyped-calls=False
# (the canopen package is typed in part)
from __future__ import annotations

import re
import struct
from collections.abc import Callable

from canopen.sdo.client import SdoClient
from canopen.sdo.exceptions import SdoAbortedError

from palpate_bus.decode.device import Device, Key
from palpate_bus.eds.values import DataTypeInfo, parse_integer
from palpate_bus.master.session import sdo_errors
from palpate_edge.common.errors import ConfigError

BLOCK_FROM_BYTES = 128  # for less data, block transfer needs more frames than segmented transfer
COMMAND_UNKNOWN, NO_OBJECT, NO_SUBINDEX = 0x0504_0001, 0x0602_0000, 0x0609_0011
_INDEX = re.compile(r"(?:0x)?(?P<index>[0-9a-fA-F]{4})h?(?::(?:0x)?(?P<sub>[0-9a-fA-F]{1,2})h?)?")
_SIGNATURE = re.compile(r"[a-z]{4}|ZERO")


def find_object(device: Device | None, text: str) -> Key:
    """Return the object given as ``1017``, as ``0x7130:1`` (hexadecimal sub-index) or by its name in the EDS.

    Raises ConfigError when there is no such object.
    """
    match = _INDEX.fullmatch(text.strip())
    if match:
        return int(match["index"], 16), int(match["sub"] or "0", 16)
    if device is None:
        raise ConfigError(
            f"{text!r} is a name, but no EDS is known for this node: give an index such as 1017 or --eds FILE"
        )
    return device.find(text)


def encode(device: Device | None, key: Key, text: str) -> bytes:
    """Return the bytes of a value given as a number, a number with its unit, text, or ``hex:0102``.

    Raises ConfigError when the object is read-only or the value exceeds its type or limits.
    """
    if text.startswith("hex:"):
        return _hex(text)
    variable = device.variable(key) if device else None
    if device is None or variable is None or variable.info is None:
        raise ConfigError(
            f"{text!r}: the type of {key[0]:04X}h:{key[1]:02X} is unknown: give --eds FILE, or write hex:0102"
        )
    name = device.name_of(key)
    if not variable.writable:
        raise ConfigError(
            f"{name} cannot be written: its access type in {device.eds.name} is {variable.access}"
        )
    info = variable.info
    if info.is_text:
        return text.encode("latin-1", "replace")
    if not info.is_integer:
        return struct.pack("<f" if info.bits == 32 else "<d", _real(name, text))
    raw = _raw(device, key, info, text)
    low, high = _limits(device, key, info)
    if not low <= raw <= high:
        unit = device.unit(key)
        shown = f"{unit.text(low)} to {unit.text(high)}" if unit else f"{low} to {high}"
        raise ConfigError(f"{name}: {text} is out of range: give {shown}")
    return raw.to_bytes((info.bits + 7) // 8, "little", signed=(info.low or 0) < 0)


def read(client: SdoClient, node_id: int, device: Device | None, key: Key, block: bool) -> bytes:
    """Return the object's bytes.

    Uses block transfer for a domain, or if `block` is set, when the node supports it.
    """
    variable = device.variable(key) if device else None
    large = block or (variable is not None and variable.info is not None and variable.info.name == "DOMAIN")
    what = f"reading {_name(device, key)}"

    def in_blocks() -> bytes:
        with client.open(*key, mode="rb", block_transfer=True) as stream:
            return bytes(stream.read())

    with sdo_errors(node_id, key[0], what, client.RESPONSE_TIMEOUT):
        return _blocks_or(in_blocks, lambda: client.upload(*key)) if large else client.upload(*key)


def read_number(client: SdoClient, node_id: int, device: Device, key: Key) -> int | None:
    """Return the object's bytes as an unsigned number, None when the node does not have the object.

    Raises BusError for any other failure.
    """
    with sdo_errors(node_id, key[0], f"reading {device.name_of(key)}", client.RESPONSE_TIMEOUT):
        try:
            return int.from_bytes(client.upload(*key), "little")
        except SdoAbortedError as error:
            if error.code not in (NO_OBJECT, NO_SUBINDEX):
                raise
            return None


def write(client: SdoClient, node_id: int, device: Device | None, key: Key, data: bytes, block: bool) -> None:
    """Write the object; by block transfer from BLOCK_FROM_BYTES on, when the node supports it."""

    def in_blocks() -> bytes:
        with client.open(*key, mode="wb", size=len(data), block_transfer=True) as stream:
            stream.write(data)
        return b""

    def segmented() -> bytes:
        client.download(*key, data)
        return b""

    with sdo_errors(node_id, key[0], f"writing {_name(device, key)}", client.RESPONSE_TIMEOUT):
        if block or len(data) >= BLOCK_FROM_BYTES:
            _blocks_or(in_blocks, segmented)
        else:
            segmented()


def _blocks_or(in_blocks: Callable[[], bytes], otherwise: Callable[[], bytes]) -> bytes:
    try:
        return in_blocks()
    except SdoAbortedError as error:
        if error.code != COMMAND_UNKNOWN:
            raise
        return otherwise()


def _raw(device: Device, key: Key, info: DataTypeInfo, text: str) -> int:
    """Return the raw integer of a number, a number with the object's unit, or a signature like ``save``."""
    name, unit = device.name_of(key), device.unit(key)
    if unit is not None and unit.name and text.replace(" ", "").endswith(unit.name.replace(" ", "")):
        plain = text.replace(" ", "").removesuffix(unit.name.replace(" ", ""))
        return round(_real(name, plain) / unit.factor)
    if info.bits == 32 and _SIGNATURE.fullmatch(text):
        return int.from_bytes(text.encode(), "little")
    try:
        return parse_integer(text)
    except ValueError as error:
        hint = f"a number, or one with the unit {unit.name}" if unit and unit.name else "a whole number"
        raise ConfigError(f"{name}: {error}: give {hint}") from error


def _limits(device: Device, key: Key, info: DataTypeInfo) -> tuple[int, int]:
    variable = device.variable(key)
    assert variable is not None and info.low is not None and info.high is not None
    low, high = info.low, info.high
    for limit, text in (
        ("low", variable.section.value("LowLimit")),
        ("high", variable.section.value("HighLimit")),
    ):
        try:
            number = parse_integer(text, device.node_id)
        except ValueError:
            continue
        number = number - (1 << info.bits) if info.low < 0 and number > info.high else number
        low, high = (max(low, number), high) if limit == "low" else (low, min(high, number))
    return low, high


def _real(name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError as error:
        raise ConfigError(f"{name}: {text!r} is not a number: give one such as 0.5") from error


def _hex(text: str) -> bytes:
    try:
        return bytes.fromhex(text.removeprefix("hex:"))
    except ValueError as error:
        raise ConfigError(
            f"{text!r} is not a list of hexadecimal bytes: write for example hex:01a2ff"
        ) from error


def _name(device: Device | None, key: Key) -> str:
    return device.name_of(key) if device else f"{key[0]:04X}h:{key[1]:02X}"
