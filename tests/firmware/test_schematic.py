"""The schematic of the light: its netlist against the firmware's pins, the wiring table and KiCad's rules."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections import Counter
from pathlib import Path

import pytest

PROJECT = Path(__file__).resolve().parents[2]
BOARD = PROJECT / "firmware" / "board"
SCHEMATIC = BOARD / "light.kicad_sch"
NETLIST = BOARD / "light-netlist.asc"
README = (BOARD / "README.md").read_text(encoding="utf-8")
MAIN = (BOARD.parent / "illumination" / "main.c").read_text(encoding="utf-8")

# ATmega328P data sheet, figure 1-1, TQFP-32.
PINS = {f"PD{n}": pin for n, pin in enumerate((30, 31, 32, 1, 2, 9, 10, 11))}
PINS |= {f"PB{n}": pin for n, pin in enumerate((12, 13, 14, 15, 16, 17, 7, 8))}
PINS |= {f"PC{n}": pin for n, pin in enumerate((23, 24, 25, 26, 27, 28, 29))}
SUPPLY = {"+3V3": {4, 6, 18}, "GND": {3, 5, 21}}  # VCC, AVCC; GND
AREF = 20


def nets_of(text: str) -> set[frozenset[str]]:
    """Return the nets of a PADS netlist, each the set of its pins such as ``U1.27``."""
    blocks = text.split("*SIGNAL* ")[1:]
    return {frozenset(re.findall(r"\b[A-Z]+\d+\.\d+", block.split("\n", 1)[1])) for block in blocks}


def parts_of(text: str) -> dict[str, str]:
    """Return the values by reference."""
    return dict(re.findall(r"^([A-Z]+\d+)\s+(\S+)$", text.split("*NET*", maxsplit=1)[0], re.MULTILINE))


NETS, PARTS = nets_of(NETLIST.read_text()), parts_of(NETLIST.read_text())


def net(pin: str) -> frozenset[str]:
    (found,) = (one for one in NETS if pin in one)
    return found


def controller(port: str) -> frozenset[str]:
    return net(f"U1.{PINS[port]}")


def across(part: str, pins: frozenset[str]) -> frozenset[str]:
    """Return the net at the other end of a part with two ends."""
    (end,) = (pin for pin in pins if pin.startswith(f"{part}."))
    return net(f"{part}.{3 - int(end[-1])}")


def parts_on(pins: frozenset[str], value: str) -> list[str]:
    return [part for pin in sorted(pins) if PARTS[part := pin.split(".")[0]] == value]


def test_every_pin_that_the_firmware_uses_is_connected_and_no_other_but_those_for_flashing() -> None:
    used = set(re.findall(r"\bP[BCD]\d\b", MAIN.split("*/")[0]))
    assert used == {"PB1", "PD2", "PC0", "PC1", "PC4", "PC5"}
    flashing = {"PB3", "PB4", "PB5", "PC6"}
    connected = {pin for pins in NETS if len(pins) > 1 for pin in pins if pin.startswith("U1.")}
    supply = set().union(*SUPPLY.values()) | {AREF}
    assert connected == {f"U1.{pin}" for pin in supply} | {f"U1.{PINS[port]}" for port in used | flashing}


def test_the_firmwares_only_output_drives_the_gate_which_is_off_in_reset() -> None:
    assert re.findall(r"DDR[BCD] = _BV\((\w+)\);", MAIN) == ["DDB1"]
    (series,) = parts_on(controller("PB1"), "100")
    gate = across(series, controller("PB1"))
    assert "Q1.1" in gate
    (down,) = parts_on(gate, "10k")
    assert across(down, gate) == net("Q1.2") == net(f"U1.{min(SUPPLY['GND'])}")
    cathodes = {pin.split(".")[0] for pin in net("Q1.3") if pin.startswith("D")}
    assert len(cathodes) == 6
    for diode in cathodes:
        (resistor,) = parts_on(net(f"{diode}.2"), "100")
        assert across(resistor, net(f"{diode}.2")) >= {"J1.2", "J1.4"}  # 5 V of the header


@pytest.mark.parametrize(("port", "part"), [("PC0", "TH1"), ("PC1", "TH2")])
def test_a_thermistor_divides_the_supply(port: str, part: str) -> None:
    node = controller(port)
    (up,) = parts_on(node, "10k_1%")
    (filtered,) = parts_on(node, "100n")
    assert "J1.1" in across(up, node)
    assert across(part, node) == across(filtered, node) == net("J1.6")


def test_the_trigger_is_low_without_a_camera() -> None:
    assert "ISC01) | _BV(ISC00)" in MAIN  # rising edge of INT0, which is PD2 (data sheet, 13.3)
    trigger = controller("PD2")
    assert "J2.1" in trigger
    (down,) = parts_on(trigger, "10k")
    assert across(down, trigger) == net("J2.2") == net("J1.6")


def test_the_header_is_wired_as_in_the_table() -> None:
    rows = re.findall(r"^\| \d+ \| (\d+) \| [^|]*\| ([^|]*ATmega (P\w\d)[^|]*) \|", README, re.MULTILINE)
    assert {port for _, _, port in rows} == {"PC4", "PC5", "PB3", "PB4", "PB5", "PC6"}
    for header_pin, circuit, port in rows:
        pins = net(f"J1.{header_pin}")
        if "by 1 kOhm" in circuit:
            (series,) = parts_on(pins, "1k")
            pins = across(series, pins)
        assert pins == controller(port)
        if "10 kOhm to 3.3 V" in circuit:
            (up,) = parts_on(pins, "10k")
            assert "J1.1" in across(up, pins)


def test_supplies_and_parts_are_those_of_the_page() -> None:
    for name, numbers in (("3.3 V", (1, 17)), ("5 V", (2, 4)), ("ground", (6, 9, 14, 20, 25, 30, 34, 39))):
        assert f"{name} from pins {numbers[0]}" in README
        assert len({net(f"J1.{number}") for number in numbers}) == 1
    for header_pin, name in (("J1.1", "+3V3"), ("J1.6", "GND")):
        assert {f"U1.{pin}" for pin in SUPPLY[name]} <= net(header_pin)
    values = Counter(value for part, value in PARTS.items() if part[0] in "RDC")
    for text, value, of_page in (
        ("LED | white", "white", 6),
        ("resistor | 100 Ohm", "100", 7),
        ("resistor | 1 kOhm", "1k", 3),
        ("capacitor | 10 uF", "10u", 1),
    ):
        (number,) = re.findall(rf"^\| {re.escape(text)}.*\| (\d+) \|$", README, re.MULTILINE)
        assert int(number) == of_page == values[value]
    assert values["10k"] + values["10k_1%"] == int(re.findall(r"resistor \| 10 kOhm.*\| (\d+) \|", README)[0])
    reference = net(f"U1.{AREF}")
    (capacitor,) = parts_on(reference, "100n")
    assert reference == {f"U1.{AREF}", f"{capacitor}.1"}
    assert across(capacitor, reference) == net("J1.6")


@pytest.mark.kicad
def test_kicad_finds_no_violation_and_the_netlist_is_that_of_the_schematic(tmp_path: Path) -> None:
    kicad = shutil.which("kicad-cli")
    if kicad is None:
        pytest.skip("kicad-cli is missing: install KiCad 8 or newer (Debian 12: from bookworm-backports)")
    checked = subprocess.run(
        [kicad, "sch", "erc", "--severity-all", "--exit-code-violations", "-o", tmp_path / "erc", SCHEMATIC],
        check=False,
        capture_output=True,
    )
    assert checked.returncode == 0, (tmp_path / "erc").read_text()
    made = tmp_path / "netlist.asc"
    subprocess.run(
        [kicad, "sch", "export", "netlist", "--format", "pads", "-o", made, SCHEMATIC],
        check=True,
        capture_output=True,
    )
    assert nets_of(made.read_text()) == NETS
    assert parts_of(made.read_text()) == PARTS
