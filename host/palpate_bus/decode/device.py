"""One node as described by its EDS, of any vendor: names, units and PDO mappings."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

from palpate_bus.decode.units import Unit, meaning_of, si_unit, unit_of, unknown_text
from palpate_bus.eds.cia402 import CIA402_EDS
from palpate_bus.eds.cia402_axes import (
    CIA402_AXES_EDS,
    axes_of_tpdos,
    command_words,
    profile_key,
    state_words,
)
from palpate_bus.eds.objects import read_objects
from palpate_bus.eds.pdo import NOT_VALID, PDO_KINDS, pdo_numbers
from palpate_bus.eds.text import Findings, Section, parse_sections, read_text
from palpate_bus.eds.values import parse_integer
from palpate_bus.eds.variable import Variable, Variables
from palpate_edge.can_bus.can_frame import CanFrame, padded
from palpate_edge.common.errors import ConfigError
from palpate_edge.node.parsed_eds import FINGERTIP_EDS

Key = tuple[int, int]
Words = tuple[int, ...]
NO_MAPPINGS: Mapping[int, Words] = {}
NO_AXES: Mapping[int, Mapping[int, str]] = {}
AXES_KIND = "axes"
"""Kind of a drive node with several axes in a log's header."""
TARGET_TORQUE_WORD = 0x60710010
PROCESS_VALUES = (0x6130, 0x7130, 0x9130)  # CiA 404: REAL32, INTEGER16, INTEGER32
PHYSICAL_UNIT, DECIMAL_DIGITS = 0x6131, 0x6132

CAN_ID = 0x7FF  # bits of a COB-ID

FINGERTIP_NODES, DRIVE_NODES = range(0x10, 0x20), range(1, 0x10)
"""Default node ids, see docs/bus.md."""


@dataclass(frozen=True, slots=True)
class Reading:
    """One decoded value. value: in `unit`; raw: the transmitted integer; text: value and unit for display."""

    name: str
    value: float | int | str
    unit: str
    raw: int | None
    text: str


@dataclass(frozen=True, slots=True)
class Pdo:
    """One PDO. label: such as ``TPDO 1``. fields: objects and their bits, in the order of the frame.

    enabled: False when the EDS disables it; the node may enable it. more_fields: those in the mapping behind
    `fields`, which the node may map too.
    """

    label: str
    can_id: int
    fields: tuple[tuple[Key, int], ...]
    enabled: bool
    more_fields: tuple[tuple[Key, int], ...] = ()

    @property
    def bits(self) -> int:
        return sum(bits for _, bits in self.fields)

    def in_frame(self, frame: CanFrame) -> Pdo | None:
        """Return the PDO with the fields of a frame of this length, None when no mapping has it.

        A CAN FD frame is filled up to the next length of its kind.
        """
        for pdo in (self, replace(self, fields=self.fields + self.more_fields)):
            data = bytes((pdo.bits + 7) // 8)
            if len(frame.data) == len(padded(data) if frame.fd else data):
                return pdo
        return None


@lru_cache(maxsize=16)
def _described(text: str) -> tuple[dict[str, Section], Variables]:
    """Return sections and objects of an EDS, which nothing changes: the nodes of a hand share a few files."""
    sections = parse_sections(text, Findings())
    return sections, read_objects(sections, Findings())


class Device:
    """A node with its EDS. `name`: its name in output, such as ``finger-1``."""

    def __init__(
        self, node_id: int, name: str, eds: Path, mappings: Mapping[int, Words] = NO_MAPPINGS
    ) -> None:
        """Read the EDS. mappings: words of the mapping parameters that the master changes, by index.

        Raises ConfigError when the file cannot be read or describes no object.
        """
        sections, self.variables = _described(read_text(eds))
        self.node_id = node_id
        self.name = name
        self.eds = eds
        if not self.variables:
            raise ConfigError(
                f"EDS {eds} describes no object: check it with palpate-host bus check-eds {eds}"
            )
        self._containers = {
            int(section, 16): sections[section].value("ParameterName")
            for section in {f"{index:04x}" for index, _ in self.variables}
            if section in sections
        }
        device_info = sections.get("deviceinfo")
        self.product = device_info.value("ProductName") if device_info else ""
        pdos = list(self._read_pdos(mappings))
        enabled = [pdo for pdo in pdos if pdo.enabled]
        self.pdos = {pdo.can_id: pdo for pdo in (*pdos, *enabled)}

    def variable(self, key: Key) -> Variable | None:
        """Return the object as described in the EDS, None when it is not."""
        return self.variables.get(key)

    def name_of(self, key: Key) -> str:
        """Return an object's full name, such as ``7130h:01 AI input PV / Value of contact x``."""
        label = f"{key[0]:04X}h:{key[1]:02X}"
        variable = self.variables.get(key)
        container = self._containers.get(key[0], "")
        if variable is None:
            return f"{label} {container}".rstrip() if container else f"{label} (not in {self.eds.name})"
        return (
            f"{label} {container}" if variable.name == container else f"{label} {container} / {variable.name}"
        )

    def find(self, name: str) -> Key:
        """Return the object with a name: that of the sub-index, of the object, or ``object / sub-index``.

        Raises ConfigError when there is none or more than one.
        """
        wanted = _plain(name)
        found = [key for key in self.variables if wanted in self._names(key)]
        if len(found) != 1:
            close = sorted({part for key in self.variables for part in self._names(key) if wanted in part})
            reason = "has no object" if not found else f"has {len(found)} objects"
            hint = f"such as {', '.join(close[:5])}" if close else "give its index, such as 1017"
            raise ConfigError(f"{self.eds.name} {reason} named {name!r}: {hint}")
        return found[0]

    def unit(self, key: Key) -> Unit | None:
        """Return the unit of an object's raw value, None when it has none."""
        index, subindex = key
        if index in PROCESS_VALUES:
            code, digits = self._number((PHYSICAL_UNIT, subindex)), self._number((DECIMAL_DIGITS, subindex))
            if code is not None:
                return si_unit(code, 0 if index == PROCESS_VALUES[0] else digits or 0)
        return unit_of(self.product, index, subindex)

    def reading(self, key: Key, data: bytes) -> Reading:
        """Decode `data` by the object's data type.

        Bytes of an unknown object, or of a length that does not fit, are shown in hexadecimal.
        """
        variable = self.variables.get(key)
        name = variable.name if variable else f"{key[0]:04X}h:{key[1]:02X}"
        info = variable.info if variable else None
        if info is None:
            return _bytes(name, data)
        if info.name == "VISIBLE_STRING":
            text = data.decode("latin-1").rstrip("\0")
            return Reading(name, text, "", None, repr(text))
        if info.is_integer and len(data) == (info.bits + 7) // 8:
            return self._integer(key, name, int.from_bytes(data, "little", signed=(info.low or 0) < 0))
        if info.name in ("REAL32", "REAL64") and len(data) == info.bits // 8:
            value = float(struct.unpack("<f" if info.bits == 32 else "<d", data)[0])
            unit = self.unit(key)
            return Reading(
                name,
                value,
                unit.name if unit else "",
                None,
                f"{value:g} {unit.name if unit else ''}".rstrip(),
            )
        return _bytes(name, data)

    def pdo_readings(self, pdo: Pdo, data: bytes) -> tuple[Reading, ...]:
        """Return the values of a PDO whose length is that of its mapping."""
        whole, offset = int.from_bytes(data, "little"), 0
        readings = []
        for key, bits in pdo.fields:
            part = whole >> offset & ((1 << bits) - 1)
            offset += bits
            if key[0] >= 8:  # not a dummy
                readings.append(self.reading(key, part.to_bytes((bits + 7) // 8, "little")))
        return tuple(readings)

    def _integer(self, key: Key, name: str, raw: int) -> Reading:
        unknown = unknown_text(self.product, *key, raw)
        meaning = unknown or meaning_of(self.product, *key, raw)
        unit = self.unit(key)
        if unit is not None and not unknown:
            return Reading(name, raw * unit.factor, unit.name, raw, unit.text(raw))
        wide = profile_key(key)[0] in (0x6040, 0x6041) or (key[0] < 0x2000 and raw > 0xFFFF)
        text = f"0x{raw:X}" if wide else str(raw)
        return Reading(name, raw, "", raw, f"{text} ({meaning})" if meaning else text)

    def _number(self, key: Key) -> int | None:
        variable = self.variables.get(key)
        return variable.number() if variable else None

    def _names(self, key: Key) -> set[str]:
        container, own = self._containers.get(key[0], ""), self.variables[key].name
        names = {_plain(own), _plain(f"{container}/{own}")}
        return names if key[1] else names | {_plain(container)}

    def _read_pdos(self, mappings: Mapping[int, Words]) -> Iterable[Pdo]:
        for kind in PDO_KINDS:
            for number in pdo_numbers(self.variables, kind):
                cob_id = self._cob_id((kind.communication + number - 1, 1))
                mapping = kind.mapping + number - 1
                count = self._number((mapping, 0)) or 0
                words = [self._number((mapping, sub)) or 0 for sub in range(1, count + 1)]
                while word := self._number((mapping, 1 + len(words))):
                    words.append(word)
                if mapping in mappings:
                    words = list(mappings[mapping])
                    count = len(words)
                fields = tuple(((word >> 16, word >> 8 & 0xFF), word & 0xFF) for word in words)
                if cob_id is not None and cob_id & CAN_ID:
                    enabled = not cob_id & NOT_VALID
                    label = f"{kind.label} {number}"
                    yield Pdo(label, cob_id & CAN_ID, fields[:count], enabled, fields[count:])

    def _cob_id(self, key: Key) -> int | None:
        variable = self.variables.get(key)
        if variable is None:
            return None
        try:
            return parse_integer(variable.section.value("DefaultValue"), self.node_id)
        except ValueError:
            return None


def _bytes(name: str, data: bytes) -> Reading:
    return Reading(name, data.hex(), "", None, data.hex(" ") or "(empty)")


def _plain(name: str) -> str:
    return "".join(name.lower().split())


def usual_device(node_id: int) -> Device | None:
    """Return the device of a default node id, None for any other id."""
    if node_id in FINGERTIP_NODES:
        return Device(node_id, f"fingertip 0x{node_id:02X}", FINGERTIP_EDS)
    if node_id in DRIVE_NODES:
        return Device(node_id, f"drive {node_id}", CIA402_EDS)
    return None


def axes_text(names: Mapping[int, str]) -> str:
    """Return the axes of a node with their joints as in a log's header, such as ``0=abduction,1=flexion``."""
    return ",".join(f"{axis}={name}" for axis, name in names.items())


def axes_device(node_id: int, name: str, axes: Sequence[int]) -> Device:
    """Return a drive node with these axes, whose PDOs the host has mapped; the targets are torques."""
    mappings = {0x1600: command_words(axes, TARGET_TORQUE_WORD)}
    mappings |= {0x1A00 + place: state_words(part) for place, part in enumerate(axes_of_tpdos(axes))}
    return Device(node_id, name, CIA402_AXES_EDS, mappings)


def devices_of_header(entries: Mapping[str, str]) -> dict[int, Device]:
    """Return the nodes listed in a log's header (``node.0x10: fingertip:finger-1``)."""
    devices = {}
    for key, value in entries.items():
        kind, _, name = value.partition(":")
        eds = {"fingertip": FINGERTIP_EDS, "drive": CIA402_EDS}.get(kind)
        if key.startswith("node.0x"):
            try:
                node_id = int(key.removeprefix("node."), 16)
                if kind == AXES_KIND:
                    axes = [int(part.partition("=")[0]) for part in name.split(",")]
                    devices[node_id] = axes_device(node_id, name, axes)
            except ValueError:
                continue
            if eds is not None:
                devices[node_id] = Device(node_id, name, eds)
    return devices


def devices_by_kind(
    fingertips: Mapping[int, str],
    drives: Mapping[int, str],
    axes: Mapping[int, Mapping[int, str]] = NO_AXES,
) -> dict[int, Device]:
    """Return the devices of a hand. fingertips, drives: node id to name; axes: node id to axis to joint."""
    devices = {node_id: Device(node_id, name, FINGERTIP_EDS) for node_id, name in fingertips.items()}
    devices |= {node_id: Device(node_id, name, CIA402_EDS) for node_id, name in drives.items()}
    return devices | {
        node_id: axes_device(node_id, "+".join(names.values()), tuple(names))
        for node_id, names in axes.items()
    }
