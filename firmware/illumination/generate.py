"""Write the files made from registers.toml: the C header, the client's constants, the page of the docs.

python firmware/illumination/generate.py          # write
python firmware/illumination/generate.py --check  # exit status 1 if a file differs from what would be written
"""

from __future__ import annotations

import math
import sys
import tomllib
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
PROJECT = HERE.parents[1]
TABLE = HERE / "registers.toml"
OUTPUTS = {
    "header": HERE / "registers.h",
    "client": PROJECT / "edge" / "palpate_edge" / "illumination" / "registers.py",
    "page": PROJECT / "docs" / "illumination.md",
}
SOURCES = "registers.toml and page.md"
NOTE = "Written by firmware/illumination/generate.py from registers.toml: edit registers.toml."

# Thermistor 10 kOhm at 25 degC, B = 3950 K, to ground, with 10 kOhm to the ADC's reference.
B_K, R25_over_pull_up, T25_K, ZERO_K = 3950.0, 1.0, 298.15, 273.15
ADC_STEPS, POINTS = 1024, 33

CONSTANTS = ("identity", "version", "i2c_address")
MEANING = ("address", "name", "access", "unit", "min", "max", "default", "signed")  # covered by the CRC


def crc16(data: bytes) -> int:
    """CRC-16/XMODEM (polynomial 1021h, start 0)."""
    crc = 0
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ 0x1021 if crc & 0x8000 else crc << 1) & 0xFFFF
    return crc


def temperature_dC(adc: float) -> int:
    """Return the temperature at an ADC reading in 0.1 degC, by the B equation."""
    ratio = adc / (ADC_STEPS - adc)  # of thermistor over pull-up
    kelvin = 1 / (1 / T25_K + math.log(ratio / R25_over_pull_up) / B_K)
    return round((kelvin - ZERO_K) * 10)


def load() -> dict[str, Any]:
    """Return the table with its CRC and all defaults."""
    table = tomllib.loads(TABLE.read_text())
    for register in table["register"]:
        register.setdefault("access", "r")
        register.setdefault("unit", "")
        register.setdefault("min", 0)
        register.setdefault("max", 0xFFFF)
        register.setdefault("default", register["min"] if "w" in register["access"] else 0)
        register.setdefault("signed", False)
    meaning = [[register[key] for key in MEANING] for register in table["register"]]
    faults = [[fault["bit"], fault["name"]] for fault in table["fault"]]
    table["crc"] = crc16(repr((table["version"], meaning, faults)).encode())
    return table


def header(table: dict[str, Any]) -> str:
    lines = [f"/* {NOTE} */", "#ifndef REGISTERS_H", "#define REGISTERS_H", ""]
    lines += [
        f"#define {name.upper()} 0x{table[name]:04X}" for name in ("identity", "version", "i2c_address")
    ]
    lines += [f"#define TABLE_CRC 0x{table['crc']:04X}", ""]
    lines += [f"#define REG_{r['name']} 0x{r['address']:02X}" for r in table["register"]]
    lines += [f"#define REGISTER_COUNT {max(r['address'] for r in table['register']) + 1}", ""]
    lines += [f"#define FAULT_{f['name']} 0x{1 << f['bit']:02X}" for f in table["fault"]]
    dark = sum(1 << f["bit"] for f in table["fault"] if f.get("dark"))
    lines += [f"#define FAULTS_DARK 0x{dark:02X} /* the light is off while one of these is present */", ""]
    lines += ["/* writable registers: register, least and greatest value, value after reset */"]
    rows = [
        f"    X(REG_{r['name']}, {r['min']}, {r['max']}, {r['default']})"
        for r in table["register"]
        if "w" in r["access"]
    ]
    lines += ["#define WRITABLE(X) \\", " \\\n".join(rows), ""]
    lines += ["/* readable registers */", "#define READABLE(X) \\"]
    readable = [f"    X(REG_{r['name']})" for r in table["register"] if "r" in r["access"]]
    lines += [" \\\n".join(readable), ""]
    step = ADC_STEPS // (POINTS - 1)
    values = [temperature_dC(min(max(i * step, 1), ADC_STEPS - 1)) for i in range(POINTS)]
    lines += [f"/* 0.1 degC at ADC readings 0, {step}, {2 * step}, ... */", f"#define THERMISTOR_STEP {step}"]
    lines += ["#define THERMISTOR { \\"]
    rows = [", ".join(map(str, values[i : i + 8])) for i in range(0, POINTS, 8)]
    lines += ["    " + ", \\\n    ".join(rows) + " }", "", "#endif"]
    return "\n".join(lines) + "\n"


def client(table: dict[str, Any]) -> str:
    lines = [f'"""The illumination controller\'s registers.\n\n{NOTE}\n"""', ""]
    lines += ["from __future__ import annotations", "", "import enum", ""]
    lines += [f"{name.upper()} = 0x{table[name]:04X}" for name in CONSTANTS]
    lines += [f"MAP_CRC = 0x{table['crc']:04X}", "", "", "class LightRegister(enum.IntEnum):"]
    lines += ['    """SMBus command of each 16-bit register."""', ""]
    lines += [f"    {r['name']} = 0x{r['address']:02X}" for r in table["register"]]
    lines += ["", "", "class Fault(enum.IntFlag):", '    """Bits of FAULTS and FAULT_CLEAR."""', ""]
    lines += [f"    {f['name']} = 0x{1 << f['bit']:02X}" for f in table["fault"]]
    lines += ["", "", "RANGES = {"]
    lines += [
        f"    LightRegister.{r['name']}: ({r['min']}, {r['max']}),"
        for r in table["register"]
        if "w" in r["access"]
    ]
    lines += ["}", '"""Least and greatest value of each register that can be written."""', ""]
    signed = ", ".join(f"LightRegister.{r['name']}" for r in table["register"] if r["signed"])
    lines += [f"SIGNED = frozenset({{{signed}}})"]
    return "\n".join(lines) + "\n"


def page(table: dict[str, Any]) -> str:
    text = (HERE / "page.md").read_text()
    rows = ["| register | name | access | unit | range | after reset | |", "|---|---|---|---|---|---|---|"]
    for r in table["register"]:
        limits = f"{r['min']}-{r['max']}" if "w" in r["access"] else ""
        default = r["default"] if "w" in r["access"] else ""
        cells = f"{r['address']:02X}h", r["name"], r["access"], r["unit"], limits, default, r["doc"]
        rows.append("| " + " | ".join(map(str, cells)) + " |")
    faults = ["| bit | name | light | |", "|---|---|---|---|"]
    for f in table["fault"]:
        light = "off" if f.get("dark") else "by LEVEL"
        faults.append(f"| {f['bit']} | {f['name']} | {light} | {f['doc']} |")
    text = text.replace("{registers}", "\n".join(rows)).replace("{faults}", "\n".join(faults))
    return text.replace("{address}", f"{table['i2c_address']:02X}h")


def main() -> int:
    table = load()
    wanted = {name: globals()[name](table) for name in OUTPUTS}
    stale = [
        OUTPUTS[n] for n, text in wanted.items() if not OUTPUTS[n].exists() or OUTPUTS[n].read_text() != text
    ]
    if "--check" in sys.argv:
        for path in stale:
            print(f"error: {path.relative_to(PROJECT)} does not match {SOURCES}: run make registers")
        return bool(stale)
    for name, text in wanted.items():
        OUTPUTS[name].write_text(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
