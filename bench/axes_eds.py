"""Write host/palpate_bus/eds/cia402_axes.eds: the objects of cia402.eds for each of eight axes.

python -m bench.axes_eds   # after a change of cia402.eds
"""

from __future__ import annotations

import re

from palpate_bus.eds.cia402 import CIA402_EDS
from palpate_bus.eds.cia402_axes import (
    AXIS_STEP,
    CIA402_AXES_EDS,
    FIRST_INDEX,
    MAX_AXES,
    axes_of_tpdos,
    command_words,
    state_words,
)

SINGLE_DEVICE_TYPE = 0x67FF
STEPPER_DRIVE = 0x00040192  # 1000h of cia402.eds: profile 402, stepper motor
SEVERAL_DEVICES = 0xFFFF0192  # CiA 301: FFFFh, each device has its own type in 67FFh + n * 800h
TARGET_TORQUE = 0x60710010
SYNC_TYPE, EVENT_TYPE = 1, 255

HEAD = {
    "; palpate joint drive\n; CiA 306 electronic data sheet. What the host asks of a CiA 402 joint drive, no "
    "more.": "; palpate multi-axis drive\n; CiA 306 electronic data sheet. What the host asks of a CiA 402 "
    "node with several axes, no more.\n; Made from cia402.eds: python -m bench.axes_eds",
    "FileName=cia402.eds": "FileName=cia402_axes.eds",
    "Description=CiA 402 joint drive: torque, velocity, position and homing": "Description=CiA 402 drive "
    "with eight axes on CAN FD",
    "ProductName=palpate joint drive": "ProductName=palpate multi-axis drive",
    "ProductNumber=0x00000402": "ProductNumber=0x00008402",
}
COMMENTS = """[Comments]
Lines=4
Line1=Axis n, from 0 on, has the objects 6000h to 67FFh of CiA 402-2 n times 800h higher.
Line2=RPDO 1: controlword and target of each axis; acted on at once. TPDO 1, 2: their state at every SYNC.
Line3=The PDOs are CAN FD frames. The master maps the axes that it uses, and enables them.
Line4=Without CAN FD they cannot be enabled.
"""


def section(name: str, entries: dict[str, object]) -> str:
    """Return one section with its lines."""
    return f"[{name}]\n" + "".join(f"{key}={value}\n" for key, value in entries.items())


def variable(name: str, text: str, data_type: int, access: str, default: object, **limits: int) -> str:
    """Return the section of a variable."""
    entries: dict[str, object] = {
        "ParameterName": text,
        "ObjectType": "0x7",
        "DataType": f"0x{data_type:04X}",
        "AccessType": access,
        "DefaultValue": default,
        "PDOMapping": 0,
    }
    return section(name, entries | limits)


def pdo(label: str, number: int, cob_id: str, kind: int, words: tuple[int, ...], subs: dict[int, str]) -> str:
    """Return communication and mapping parameters. subs: further ones by sub-index, with their default."""
    communication = (0x1400 if label == "RPDO" else 0x1800) + number - 1
    mapping = communication + 0x200
    names = {3: "Inhibit time", 5: "Event timer"}
    parts = [
        section(
            f"{communication:04X}",
            {
                "ParameterName": f"{label} {number} communication parameter",
                "ObjectType": "0x9",
                "SubNumber": 3 + len(subs),
            },
        ),
        variable(f"{communication:04X}sub0", "Highest sub-index supported", 5, "const", 5),
        variable(f"{communication:04X}sub1", f"COB-ID used by {label} {number}", 7, "rw", cob_id),
        variable(f"{communication:04X}sub2", "Transmission type", 5, "rw", kind),
    ]
    parts += [variable(f"{communication:04X}sub{sub}", names[sub], 6, "rw", one) for sub, one in subs.items()]
    mapping_head = {"ParameterName": f"{label} {number} mapping parameter", "ObjectType": "0x9"}
    parts.append(section(f"{mapping:04X}", mapping_head | {"SubNumber": 1 + len(words)}))
    count = variable(f"{mapping:04X}sub0", "Number of mapped objects", 5, "rw", len(words))
    parts.append(count + f"LowLimit=0\nHighLimit={len(words)}\n")
    for slot, word in enumerate(words, 1):
        name = f"{mapping:04X}sub{slot:X}"
        parts.append(variable(name, f"Mapped object {slot}", 7, "rw", f"0x{word:08X}"))
    return "\n".join(parts)


def pdos() -> str:
    """Return all PDOs, disabled, with every axis in its place."""
    axes = range(MAX_AXES)
    states = [state_words(part) for part in axes_of_tpdos(axes)]
    command = command_words(axes, TARGET_TORQUE)
    return "\n".join(
        [
            pdo("RPDO", 1, "$NODEID+0x80000200", EVENT_TYPE, command, {5: "200"}),
            pdo("TPDO", 1, "$NODEID+0xC0000180", SYNC_TYPE, states[0], {3: "0", 5: "0"}),
            pdo("TPDO", 2, "$NODEID+0xC0000280", SYNC_TYPE, states[1], {3: "0", 5: "0"}),
        ]
    )


def of_axis(text: str, axis: int) -> str:
    """Return sections of cia402.eds for another axis: index and name."""

    def renamed(found: re.Match[str]) -> str:
        index, rest, name = int(found[1], 16), found[2], found[3]
        own = name if rest else f"Axis {axis} {name[0].lower()}{name[1:]}"
        return f"[{index + axis * AXIS_STEP:04X}{rest}]\nParameterName={own}\n"

    return re.sub(r"\[([0-9A-F]{4})(sub\d+|)\]\nParameterName=(.*)\n", renamed, text)


def axes_eds() -> str:
    """Return the text of the file."""
    head, _, rest = CIA402_EDS.read_text().partition("[Comments]\n")
    for old, new in HEAD.items():
        assert old in head, old
        head = head.replace(old, new)
    parts = re.split(r"(?m)^(?=(?:;.*\n)*\[)", rest.partition("[MandatoryObjects]\n")[2])
    by_index: dict[int, str] = {}
    for part in parts:
        found = re.search(r"(?m)^\[([0-9A-F]{4})", part)
        if found:
            index = int(found[1], 16)
            by_index[index] = by_index.get(index, "") + part.rstrip("\n") + "\n\n"
    by_index[0x1000] = by_index[0x1000].replace(f"0x{STEPPER_DRIVE:08X}", f"0x{SEVERAL_DEVICES:08X}")
    by_index[0x1018] = by_index[0x1018].replace("0x00000402", "0x00008402")
    by_index[0x1008] = by_index[0x1008].replace("palpate joint drive", "palpate multi-axis drive")
    mandatory = [0x1000, 0x1001, 0x1018]
    common = [index for index in by_index if index < 0x1400 and index not in mandatory]
    pdo_indices = [0x1400, 0x1600, 0x1800, 0x1801, 0x1A00, 0x1A01]
    profile = [index for index in by_index if index >= FIRST_INDEX]
    axes, of_axes = [], []
    for axis in range(MAX_AXES):
        axes += [of_axis(by_index[index], axis) for index in profile]
        kind = variable(
            f"{SINGLE_DEVICE_TYPE + axis * AXIS_STEP:04X}",
            f"Axis {axis} single device type",
            7,
            "const",
            f"0x{STEPPER_DRIVE:08X}",
        )
        axes.append(kind + "\n")
        of_axes += [index + axis * AXIS_STEP for index in (*profile, SINGLE_DEVICE_TYPE)]
    listed = [*common, *pdo_indices, *of_axes]
    return "".join(
        [
            head,
            COMMENTS,
            "\n[MandatoryObjects]\nSupportedObjects=3\n1=0x1000\n2=0x1001\n3=0x1018\n\n",
            *(by_index[index] for index in mandatory),
            f"[OptionalObjects]\nSupportedObjects={len(listed)}\n",
            *(f"{place}=0x{index:04X}\n" for place, index in enumerate(listed, 1)),
            "\n",
            *(by_index[index] for index in common),
            pdos(),
            "\n",
            *axes,
            "[ManufacturerObjects]\nSupportedObjects=0\n",
        ]
    )


if __name__ == "__main__":
    CIA402_AXES_EDS.write_text(axes_eds())
