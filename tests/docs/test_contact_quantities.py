"""The table of contact quantities against docs/bus.md, and against every file that may name a quantity.

After a meant change: python tests/docs/test_contact_quantities.py writes the table of docs/bus.md.
"""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import pytest

from palpate_edge.common.contact_quantities import AI_INPUT, QUANTITIES, Quantity
from palpate_edge.diagnostics.contact_csv import COLUMNS

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "bus.md"
BLOCK = re.compile(
    r"(<!-- made by: python tests/docs/test_contact_quantities.py -->\n).*?(<!-- end -->\n)", re.S
)
HEAD = ("quantity", "object", "increment", "TPDO", "estimate", "recording", "MCAP", "plot")

TABLE = "edge/palpate_edge/common/contact_quantities.py"
PARSED = "edge/palpate_edge/node/fingertip.parsed.json"
EDS = ("firmware/fingertip.eds", "edge/palpate_edge/node/fingertip.eds", PARSED)
PRODUCERS = (
    *(
        f"edge/palpate_edge/{room}/"
        for room in ("estimation", "calibration", "datasets", "diagnostics", "press_rig")
    ),
    *(f"host/palpate_twin/{room}/" for room in ("camera", "dome", "press_rig")),
)
"""Rooms that make the quantity, its label, or a drawing of its making; they do not carry it."""

ALSO_NAMED = {
    "radius95_mm": {
        "edge/palpate_edge/cli/estimate.py",  # its help text
        "edge/palpate_edge/console/terminal/dome_lines.py",  # draws a circle of this radius
        "edge/palpate_edge/console/terminal/fingertip_lines.py",  # a figure of the view
        "host/palpate_host/control/manipulation.py",  # within it a contact corrects nothing
        "host/palpate_twin/demo/fingertip_panels.py",  # draws a ring of this radius
    },
    "torsion_Nmm": {
        "edge/palpate_edge/console/terminal/fingertip_lines.py",  # a figure of the view
        "host/palpate_host/control/tip_friction.py",  # part of the friction ratio
        "host/palpate_host/ros/contents.py",  # part of a wrench
    },
    "depth_mm": {  # of a press in the twin
        "host/palpate_twin/cli/dome.py",
        "host/palpate_twin/closed_loop/tactile_rendering.py",
    },
}


def row_of(quantity: Quantity) -> tuple[str, ...]:
    not_given = "" if quantity.not_given is None else ", 8000h not given"
    return (
        quantity.name,
        f"{AI_INPUT:04X}h:{quantity.channel:02X}",
        f"{1 / quantity.increments_per_unit:g} {quantity.unit}{not_given}",
        "{}, place {}".format(*quantity.tpdo),
        quantity.column if quantity.column in COLUMNS and quantity.csv_digits is not None else "",
        quantity.recording_column("FINGER"),
        quantity.column,
        quantity.plot.format(finger="FINGER"),
    )


def rendered() -> str:
    """Return the table as docs/bus.md has it."""
    rows = [HEAD, ("---",) * len(HEAD), *(row_of(quantity) for quantity in QUANTITIES)]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in rows)


@cache
def sources() -> dict[str, str]:
    """Return every file of the programs that is read by a person or by Python: its text by its path."""
    kinds = {".py", ".eds", ".json", ".toml"}
    found = [path for part in ("edge", "host", "firmware") for path in (ROOT / part).rglob("*")]
    read = [path for path in found if path.suffix in kinds and path.is_file()]
    return {str(path.relative_to(ROOT)): path.read_text() for path in read}


def files_with(pattern: str) -> set[str]:
    """Return the source files in which `pattern` occurs, without those that make a contact's estimate."""
    others = {name: text for name, text in sources().items() if not name.startswith(PRODUCERS)}
    return {name for name, text in others.items() if re.search(pattern, text)}


def test_the_page_has_the_table() -> None:
    found = BLOCK.search(PAGE.read_text())
    assert found is not None
    assert found.group() == f"{found[1]}{rendered()}{found[2]}", (
        f"run: python {Path(__file__).relative_to(ROOT)}"
    )


@pytest.mark.parametrize(
    "quantity", [row for row in QUANTITIES if row.not_given is not None], ids=lambda row: row.column
)
def test_a_quantity_that_only_travels_is_named_in_the_table_and_the_eds_alone(quantity: Quantity) -> None:
    """One more such quantity changes the table, the EDS with its parsed copy, and golden files: no code."""
    field = quantity.element if isinstance(quantity.element, str) else quantity.attribute
    named = files_with(rf"\b{field}\b|\b{quantity.column}\b")
    assert named - ALSO_NAMED.get(field, set()) == {TABLE} | twins_that_give_none(quantity)
    assert files_with(rf"(Value|Unit|Status|Decimal digits) of {quantity.name}|Autozero {quantity.name}") == {
        *EDS
    }


def twins_that_give_none(quantity: Quantity) -> set[str]:
    """Return the files of the twin that make contacts in place of an estimator."""
    return {name for name in files_with(rf"\b{quantity.attribute}=") if name.startswith("host/palpate_twin/")}


@pytest.mark.parametrize("index", ["7130", "6150", "6132", "6131", "6125"])
def test_the_objects_of_a_channel_are_named_in_the_table_alone(index: str) -> None:
    """Except where any vendor's CiA 404 file is read, and in the example of an object's address."""
    any_vendor = {"host/palpate_bus/decode/device.py"} if index in ("7130", "6131", "6132") else set()
    example = {"host/palpate_bus/master/sdo_access.py"} if index == "7130" else set()
    assert files_with(rf"0[xX]{index}\b") - {*EDS} == {TABLE} | any_vendor | example


def test_columns_of_the_estimate_are_a_contract() -> None:
    """New ones go last."""
    first = "frame,contact,x_mm,y_mm,z_mm,fn_N,fx_N,fy_N,fz_N,quality,ms,reason,radius95_mm,torsion_Nmm"
    assert ",".join(COLUMNS).startswith(first)


if __name__ == "__main__":
    PAGE.write_text(BLOCK.sub(lambda found: f"{found[1]}{rendered()}{found[2]}", PAGE.read_text()))
