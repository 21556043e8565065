"""Write docs/objects.md: every object of firmware/fingertip.eds, with its comments, units and emergencies.

python -m bench.objects
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path

from palpate_bus.decode.device import Device
from palpate_bus.decode.emcy_text import emcy_text
from palpate_bus.decode.units import FINGERTIP
from palpate_bus.eds.variable import Variable
from palpate_edge.node.emcy import EmcyCode
from palpate_edge.node.emergencies import Emergency
from palpate_edge.node.parsed_eds import FINGERTIP_EDS

PAGE = Path(__file__).parents[1] / "docs" / "objects.md"
PARTS = (
    (range(0x1000, 0x2000), "Communication (CiA 301)"),
    (range(0x2000, 0x6000), "Fingertip"),
    (range(0x6000, 0xA000), "Analog input (CiA 404)"),
)
HEAD = """# Objects of the fingertip

Every object of `firmware/fingertip.eds`; names, types, access, defaults and notes are those of that file.
Defaults with the node id are those of node 1. A default is a raw value; units are those of
`palpate-host bus sdo read`. `python -m bench.objects` writes this page; a test compares it.

The counters of 2041h are also in the health report and in `palpate-edge check`. 2040h counts frames by
latency, from exposure to transmission. 2042h is the state of the bus clock ([the bus](bus.md)).
"""
EMERGENCIES = """## Emergencies

Sent once when the error appears and once with code 0000h when it is over.

| code | error |
|---|---|
"""
SECTION = re.compile(r"\[([0-9A-Fa-f]{4})(?:sub([0-9A-Fa-f]+))?\]$")


def notes() -> dict[tuple[int, int | None], str]:
    """Return the comments of the EDS by index and sub-index; None for an object as a whole."""
    found: dict[tuple[int, int | None], str] = {}
    comment: list[str] = []
    for line in FINGERTIP_EDS.read_text(encoding="utf-8").splitlines():
        if line.startswith(";"):
            comment.append(line.lstrip("; ").strip())
            continue
        if comment and (section := SECTION.match(line)):
            sub = None if section[2] is None else int(section[2], 16)
            found[int(section[1], 16), sub] = " ".join(comment)
        comment = []
    return found


def default_text(variable: Variable) -> str:
    """Return the raw default: hexadecimal for identifiers, mappings and wide numbers."""
    value = variable.default
    if isinstance(value, int) and not isinstance(value, bool) and value > 0xFFFF:
        return f"{value:X}h"
    return "" if value is None else str(value)


def rows(
    device: Device, variables: list[Variable], comments: dict[tuple[int, int | None], str]
) -> Iterator[str]:
    """Yield the table rows of one object; its own note stands in the first."""
    first, index = True, variables[0].index
    for variable in variables:
        texts = [
            comments.get((index, None), "") if first else "",
            comments.get((index, variable.subindex), ""),
        ]
        unit = device.unit(variable.key)
        name = device.name_of(variable.key).split(" ", 1)[1]
        factor = "" if unit is None else (f"{unit.factor:g} " if unit.factor != 1 else "") + unit.name
        kind = variable.info.name if variable.info else f"{variable.data_type:04X}h"
        cells = (
            f"{index:04X}h:{variable.subindex:02X}",
            name,
            kind,
            variable.access,
            factor,
            default_text(variable),
            "yes" if variable.mappable else "",
            " ".join(text for text in texts if text),
        )
        yield "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"
        first = False


def page() -> str:
    """Return the text of docs/objects.md."""
    device, comments = Device(1, "fingertip", FINGERTIP_EDS), notes()
    text = HEAD
    for part, title in PARTS:
        text += f"\n## {title}\n\n| object | name | type | access | unit | default | PDO | note |\n"
        text += "|---|---|---|---|---|---|---|---|\n"
        inside = sorted((v for v in device.variables.values() if v.index in part), key=lambda v: v.key)
        for _, group in groupby(inside, key=lambda variable: variable.index):
            text += "".join(row + "\n" for row in rows(device, list(group), comments))
    text += "\n" + EMERGENCIES
    codes = sorted({int(code) for code in (*EmcyCode, *Emergency)})
    return text + "".join(f"| {code:04X}h | {emcy_text(code, FINGERTIP)} |\n" for code in codes)


def main() -> None:
    """Write the page."""
    PAGE.write_text(page(), encoding="utf-8")


if __name__ == "__main__":
    main()
