"""Comparison of a node's PDO parameters, read by SDO, with its EDS."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from palpate_bus.decode.device import CAN_ID, Device, Key
from palpate_bus.eds.pdo import NOT_VALID, PDO_KINDS, TPDO, pdo_numbers
from palpate_bus.eds.values import parse_integer
from palpate_edge.common.contact_quantities import CONTACT_TPDOS, FD_TPDO, FD_TPDO_POSES
from palpate_edge.node.fingertip_objects import DATA_BITRATE
from palpate_edge.node.parsed_eds import FINGERTIP_EDS

Read = Callable[[Key], int | None]
"""Function that returns an object's number, None when the node does not have the object."""

ID_BITS = NOT_VALID | CAN_ID


def differences(device: Device, read: Read) -> Iterator[str]:
    """Yield one line for each PDO parameter that differs from the EDS: COB-ID, type and mapping.

    A PDO that the EDS disables may be enabled in the node. A fingertip on a CAN FD bus disables the TPDOs
    that TPDO 10 replaces, and maps more objects in it when its sensor gives poses.
    """
    is_fd = device.eds == FINGERTIP_EDS and bool(read((DATA_BITRATE, 0)))
    for kind in PDO_KINDS:
        for number in pdo_numbers(device.variables, kind):
            communication, mapping = kind.communication + number - 1, kind.mapping + number - 1
            is_replaced = is_fd and kind is TPDO and number in CONTACT_TPDOS
            yield from _compare(device, read, (communication, 1), CAN_ID if is_replaced else ID_BITS)
            yield from _compare(device, read, (communication, 2))
            count = _expected(device, (mapping, 0)) or 0
            if is_fd and kind is TPDO and number == FD_TPDO and read((mapping, 0)) == FD_TPDO_POSES:
                count = FD_TPDO_POSES
            else:
                yield from _compare(device, read, (mapping, 0))
            for slot in range(1, count + 1):
                yield from _compare(device, read, (mapping, slot))


def _compare(device: Device, read: Read, key: Key, mask: int = 0xFFFF_FFFF) -> Iterator[str]:
    expected = _expected(device, key)
    if expected is None:
        return
    found = read(key)
    if found is None:
        yield f"{device.name_of(key)}: missing in the node, 0x{expected:X} in the EDS"
        return
    differs = (found ^ expected) & mask
    if mask == ID_BITS and expected & NOT_VALID:
        differs &= ~NOT_VALID
    if differs:
        yield f"{device.name_of(key)}: 0x{found:X} in the node, 0x{expected:X} in the EDS"


def _expected(device: Device, key: Key) -> int | None:
    variable = device.variable(key)
    if variable is None:
        return None
    try:
        return parse_integer(variable.section.value("DefaultValue"), device.node_id)
    except ValueError:
        return None
