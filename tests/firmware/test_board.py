"""The board's boot lines, wiring and fuses: by the kernel's overlays, the chips' tables and the binary."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest
from firmware_rig.need import need

PROJECT = Path(__file__).resolve().parents[2]
BOARD = PROJECT / "firmware" / "board"
README = BOARD / "README.md"
ROLE = PROJECT / "ansible/roles/illumination/defaults/main.yml"
MAKEFILE = BOARD.parent / "illumination" / "Makefile"

# __overrides__ of arch/arm/boot/dts/overlays/NAME-overlay.dts in Raspberry Pi's kernel, and of its boards.
OVERLAYS = {
    "mcp251xfd": {
        *(f"spi{n}-{m}" for n, m in ((0, 0), (0, 1), (1, 0), (1, 1), (1, 2), (2, 0), (2, 1), (2, 2))),
        *("oscillator", "speed", "interrupt", "rx_interrupt", "xceiver_enable", "xceiver_active_high"),
    },
    "i2c-gpio": {"i2c_gpio_sda", "i2c_gpio_scl", "i2c_gpio_delay_us", "bus"},
    "dwc2": {"dr_mode", "g-np-tx-fifo-size", "g-rx-fifo-size"},
}
PULLED_DOWN = set(range(9, 28))  # after reset: BCM2835 ARM peripherals, table 6-31
PULL_OHM = (33_000, 73_000)  # BCM2711 data sheet, table 95
SUPPLY_V, RESET_HIGH = 3.3, 0.9  # ATmega328P data sheet, table 29-1: of the supply
PARAMETERS = {"spi", "i2c_arm", "i2s", "audio"}
GPIO_PARAMETERS = {"interrupt", "rx_interrupt", "xceiver_enable", "i2c_gpio_sda", "i2c_gpio_scl"}
CLOCK_HZ = range(1_000_000, 40_000_001)  # what the mcp251xfd driver takes without the chip's PLL

# The 40-pin header by BCM2835's numbers, and SPI 0 on it (BCM2835 ARM peripherals, alternative function 0).
HEADER = {
    2: 3,
    3: 5,
    4: 7,
    14: 8,
    15: 10,
    17: 11,
    18: 12,
    27: 13,
    22: 15,
    23: 16,
    24: 18,
    10: 19,
    9: 21,
    25: 22,
}
HEADER |= {
    11: 23,
    8: 24,
    7: 26,
    0: 27,
    1: 28,
    5: 29,
    6: 31,
    12: 32,
    13: 33,
    19: 35,
    16: 36,
    26: 37,
    20: 38,
    21: 40,
}
POWER = {"3.3 V": {1, 17}, "5 V": {2, 4}, "ground": {6, 9, 14, 20, 25, 30, 34, 39}}
SPI0 = {7: "CE1", 8: "CE0", 9: "MISO", 10: "MOSI", 11: "SCLK"}


def boot_lines() -> list[tuple[str, str, dict[str, str]]]:
    """(dtoverlay, dtparam or gpio, name, parameters) of each line without a comment."""
    lines = []
    for line in (BOARD / "config.txt").read_text().splitlines():
        if line and not line.startswith("#"):
            kind, _, rest = line.partition("=")
            name, *parameters = [rest] if kind != "dtoverlay" else rest.split(",")
            lines.append((kind, name, dict(re.match(r"([^=]+)=?(.*)", p).groups() for p in parameters)))
    return lines


def overlay(name: str) -> dict[str, str]:
    return next(parameters for _, found, parameters in boot_lines() if found == name)


def wiring() -> list[tuple[int, int, str, str]]:
    """GPIO, header pin, signal and taken-by of the README's table."""
    rows = re.findall(
        r"^\| (\d+) \| (\d+) \| ([^|]+) \| [^|]+ \| ([^|]+) \|$",
        (BOARD / "README.md").read_text(),
        re.MULTILINE,
    )
    return [(int(gpio), int(pin), signal, by) for gpio, pin, signal, by in rows]


def test_the_kernel_knows_every_parameter() -> None:
    for kind, name, parameters in boot_lines():
        if kind == "dtparam":
            assert name.split("=")[0] in PARAMETERS
            assert name.split("=")[1] in {"on", "off"}
        elif kind == "gpio":
            assert re.fullmatch(r"\d+=(ip|op|a[0-5]|dh|dl|pu|pd|np|pn)", name)
        else:
            assert set(parameters) <= OVERLAYS[name], name
            assert all(int(parameters[key]) in HEADER for key in GPIO_PARAMETERS & set(parameters))
    assert overlay("mcp251xfd").get("spi0-0") == ""
    assert int(overlay("mcp251xfd")["oscillator"]) in CLOCK_HZ
    assert overlay("dwc2")["dr_mode"] in {"host", "peripheral", "otg"}


def test_every_wire_is_where_the_header_has_it_and_no_pin_is_used_twice() -> None:
    wires = wiring()
    assert len(wires) == 9
    assert [(gpio, pin) for gpio, pin, _, _ in wires] == [(gpio, HEADER[gpio]) for gpio, *_ in wires]
    assert len({gpio for gpio, *_ in wires}) == len(wires)
    assert {gpio: signal for gpio, _, signal, by in wires if by == "spi0"} == SPI0
    text = " ".join((BOARD / "README.md").read_text().split())
    for rail, pins in POWER.items():
        listed = re.search(rf"{re.escape(rail)} from pins ([\d, and]+)", text)
        assert listed is not None
        assert {int(pin) for pin in re.findall(r"\d+", listed[1])} == pins


def test_pins_of_the_overlays_are_those_of_the_wiring() -> None:
    taken = {(by, signal): gpio for gpio, _, signal, by in wiring()}
    assert taken["mcp251xfd", "CAN interrupt"] == int(overlay("mcp251xfd")["interrupt"])
    assert taken["i2c-gpio", "SDA"] == int(overlay("i2c-gpio")["i2c_gpio_sda"])
    assert taken["i2c-gpio", "SCL"] == int(overlay("i2c-gpio")["i2c_gpio_scl"])
    text = (BOARD / "README.md").read_text()
    assert f"illumination.i2c_bus = {overlay('i2c-gpio')['bus']}`" in text
    resets = set(re.findall(r"/dev/gpiochip0:(\d+)", text))
    assert resets == {str(taken["avrdude", "reset"])}


def test_reset_is_high_enough_beside_the_pins_pull_resistor() -> None:
    """RESET's pull-up of 10 kOhm and a pull-down of the board divide the supply."""
    (reset,) = re.findall(
        r"^\| (\d+) \| \d+ \| reset \|[^|]*10 kOhm to 3.3 V", README.read_text(), re.MULTILINE
    )
    off = ("gpio", f"{reset}=np", {}) in boot_lines()
    if int(reset) in PULLED_DOWN and not off:
        assert all(SUPPLY_V * pull / (pull + 10_000) >= RESET_HIGH * SUPPLY_V for pull in PULL_OHM)


def test_the_chips_own_i2c_stays_off_the_pins_that_software_clocks() -> None:
    assert ("dtparam", "i2c_arm=on", {}) not in boot_lines()


def test_the_playbook_writes_the_same_lines() -> None:
    role = (PROJECT / "ansible" / "roles" / "can" / "defaults" / "main.yml").read_text()
    written = re.findall(r"^  ((?:dt|gpio).+)$", role, re.MULTILINE)
    assert written == [
        line for line in (BOARD / "config.txt").read_text().splitlines() if line and line[0] != "#"
    ]
    example = (PROJECT / "ansible" / "inventory" / "example" / "group_vars" / "fingertips.yml").read_text()
    assert f"fingertip_i2c_bus: {overlay('i2c-gpio')['bus']}\n" in example


def fuses_in(text: str) -> list[int]:
    """Low, high, extended as an avrdude command line writes them."""
    found = dict(re.findall(r"-U ([lhe])fuse:w:(0x[0-9A-F]{2}):m", text))
    return [int(found[which], 16) for which in "lhe"]


def test_fuses_of_the_command_lines_are_those_of_the_binary(build: Path) -> None:
    section = build / "fuses.bin"
    command = ["avr-objcopy", "-O", "binary", "-j", ".fuse", "--set-section-flags", ".fuse=alloc,load"]
    subprocess.run([*command, build / "illumination.elf", section], check=True)
    fuses = list(section.read_bytes())
    assert fuses_in(MAKEFILE.read_text()) == fuses
    assert fuses_in((BOARD / "README.md").read_text()) == fuses
    assert fuses_in(ROLE.read_text()) == fuses
    low, high, extended = fuses
    # ATmega328P data sheet, tables 9-8, 28-7 to 28-9
    assert (low >> 7, low & 0x0F, low >> 4 & 3) == (1, 0b0010, 0b10), (
        "8 MHz internal, not divided, slow start"
    )
    assert (high >> 5 & 1, high & 1) == (0, 1), "serial programming on, reset vector at 0"
    assert extended & 0b111 == 0b101, "brown-out at 2.7 V"


@pytest.mark.parametrize("target", ["fuses", "flash"])
def test_avrdude_understands_the_command_lines(build: Path, target: str) -> None:
    """Up to the programmer, which is not there."""
    need("avrdude", "avrdude")
    programmer = "AVRDUDE=avrdude -c linuxspi -P /dev/no-spi:/dev/no-gpio:22 -p m328p"
    done = subprocess.run(
        ["make", "-C", MAKEFILE.parent, target, f"BUILD={build}", programmer],
        check=False,
        capture_output=True,
        text=True,
    )
    assert done.returncode != 0
    assert re.search(r"/dev/no-|unable to open", done.stderr), done.stderr
    assert "invalid" not in done.stderr
