"""Objects that a node needs for the host to decode its PDOs, with their values, in the order of reading.

The values are the defaults of the EDS that the host decodes with, so both sides agree if every object does.
`palpate-host check` compares the same parameters before a run (hand_check.py); boot_check.py during one.
"""

from __future__ import annotations

import enum
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass

from palpate_edge.node.cob_ids import NOT_VALID
from palpate_edge.node.object_dictionary import ObjectDictionary, ObjectKey
from palpate_edge.node.object_store import CONFIGURATION_SIGNATURE
from palpate_edge.node.pdo_codec import PdoDirection, is_fd_pdo
from palpate_edge.node.pdo_parameters import (
    COB_ID_NO_RTR,
    COB_ID_SUB,
    EVENT_DRIVEN,
    TYPE_SUB,
    pdo_numbers,
)

DEVICE_TYPE, SOFTWARE = (0x1000, 0), (0x100A, 0)
VENDOR, PRODUCT, REVISION, SERIAL = (0x1018, 1), (0x1018, 2), (0x1018, 3), (0x1018, 4)
CALIBRATION = (0x2001, 0)
ALL_BITS = 0xFFFF_FFFF
COB_ID_BITS = ALL_BITS & ~(NOT_VALID | COB_ID_NO_RTR)
PDO_PARAMETERS = range(0x1400, 0x1C00)
_DOWNLOADS = (1, 6)  # client command specifiers of CiA 301: initiate download, block download
_UPLOAD = (2,)  # initiate upload
EITHER_EVENT_TYPE = ~1 & 0xFF  # 254 and 255 differ in which profile defines the event


class Need(enum.Enum):
    """Kind of a comparison. REQUIRED_ID, OPTIONAL_ID: the COB-ID of a PDO, which must be valid or may be
    invalid; an invalid PDO's other parameters are not compared."""

    VALUE = enum.auto()
    REQUIRED_ID = enum.auto()
    OPTIONAL_ID = enum.auto()


@dataclass(frozen=True, slots=True)
class Wanted:
    """One object with its value. mask: the bits of a number that count. remedy: what to do if it differs.

    pdo: the PDO that the object describes, empty for none. also: another number that is as good.
    key_in_hand: of fingers[] in hand.toml, which an operator may set to another value; empty where none may.
    """

    key: ObjectKey
    value: int | str
    remedy: str
    mask: int = ALL_BITS
    need: Need = Need.VALUE
    pdo: str = ""
    also: int | None = None
    key_in_hand: str = ""

    def found(self, data: bytes) -> str | int:
        """Return the object's bytes as a value of this kind."""
        if isinstance(self.value, str):
            return data.decode("latin-1").rstrip("\0")
        return int.from_bytes(data, "little")

    def problem(self, data: bytes | None) -> str:
        """Return how the object's bytes differ, empty if they do not. data: None for a missing object."""
        name = f"{self.key[0]:04X}h:{self.key[1]:02X}"
        if data is None:
            missing = "" if self.need is Need.OPTIONAL_ID else f"{name} is missing, expected {self._wanted()}"
            return missing and f"{missing}: {self.remedy}"
        found = self.found(data)
        differs = found != self.value if isinstance(found, str) else self._differs(found)
        return f"{name} is {_text(found)}, expected {self._wanted()}: {self.remedy}" if differs else ""

    def is_disabled(self, data: bytes | None) -> bool:
        """Return whether this is the COB-ID of a PDO that the node does not use."""
        if self.need is Need.VALUE:
            return False
        return data is None or bool(int.from_bytes(data, "little") & NOT_VALID)

    def _wanted(self) -> str:
        return _text(self.value)

    def _differs(self, number: int) -> bool:
        assert isinstance(self.value, int)
        if self.need is not Need.VALUE and number & NOT_VALID:
            return self.need is Need.REQUIRED_ID
        return number != self.also and bool((number ^ self.value) & self.mask)


def _text(value: str | int) -> str:
    return repr(value) if isinstance(value, str) else f"0x{value:X}"


def identity_of(od: ObjectDictionary, remedy: str) -> Iterator[Wanted]:
    """Yield device type, vendor, product and revision of the EDS."""
    for key in (DEVICE_TYPE, VENDOR, PRODUCT, REVISION):
        yield Wanted(key, od.default_number(*key), remedy)


def pdos_of(
    od: ObjectDictionary,
    direction: PdoDirection,
    used: Collection[int],
    required: Collection[int],
    remedy: str,
    *,
    types: bool = True,
) -> Iterator[Wanted]:
    """Yield COB-ID, transmission type and mapping of the PDOs in `used`, of all others their COB-ID.

    A PDO that the host does not use may be disabled; with another COB-ID it could pass for one that is used.
    required: those that must be enabled. types: compare transmission types.
    """
    for number in pdo_numbers(od, direction):
        if is_fd_pdo(od, direction, number) and not od.has_fd:
            continue  # such a node refuses to enable it
        pdo = f"{direction.label} {number}"
        communication = direction.communication_index + number - 1
        mapping = direction.mapping_index + number - 1
        need = Need.REQUIRED_ID if number in required else Need.OPTIONAL_ID
        cob_id = od.default_number(communication, COB_ID_SUB) & ~NOT_VALID
        yield Wanted((communication, COB_ID_SUB), cob_id, remedy, COB_ID_BITS, need, pdo)
        if number not in used:
            continue
        if types:
            kind = od.default_number(communication, TYPE_SUB)
            mask = EITHER_EVENT_TYPE if kind in EVENT_DRIVEN else ALL_BITS
            yield Wanted((communication, TYPE_SUB), kind, remedy, mask, pdo=pdo)
        words = [od.default_number(mapping, 1 + slot) for slot in range(od.default_number(mapping, 0))]
        yield from mapping_of(direction, number, words, remedy)


def mapping_of(direction: PdoDirection, number: int, words: Sequence[int], remedy: str) -> Iterator[Wanted]:
    """Yield the mapping parameters of one PDO: the number of objects, then their words."""
    for subindex, value in enumerate((len(words), *words)):
        key = (direction.mapping_index + number - 1, subindex)
        yield Wanted(key, value, remedy, pdo=f"{direction.label} {number}")


def reads_contract(sdo_request: bytes) -> bool:
    """Return whether an SDO request begins an upload of PDO parameters or of the signature that stands for
    them."""
    index = _begins(sdo_request, _UPLOAD)
    return index == CONFIGURATION_SIGNATURE or index in PDO_PARAMETERS


def changes_contract(sdo_request: bytes) -> bool:
    """Return whether an SDO request begins a download into PDO parameters.

    The host sends none to a fingertip, so such a request is of another client.
    """
    return _begins(sdo_request, _DOWNLOADS) in PDO_PARAMETERS


def _begins(sdo_request: bytes, specifiers: Collection[int]) -> int:
    """Return the index of a request with one of these command specifiers, -1 for another frame."""
    if len(sdo_request) != 8 or sdo_request[0] >> 5 not in specifiers:
        return -1
    return int.from_bytes(sdo_request[1:3], "little")
