"""The electronic data sheets against the rules of CiA 306, read with configparser; and in the wheel."""

from __future__ import annotations

import re
import subprocess
import sys
import zipfile
from configparser import RawConfigParser
from pathlib import Path

import pytest

PROJECT = Path(__file__).resolve().parents[3]
EDS_FILES = {
    "fingertip": PROJECT / "firmware" / "fingertip.eds",
    "drive": PROJECT / "host" / "palpate_bus" / "eds" / "cia402.eds",
    "axes": PROJECT / "host" / "palpate_bus" / "eds" / "cia402_axes.eds",
}
OBJECT = re.compile(r"[0-9A-F]{4}$")
DATA_TYPE_BITS = {2: 8, 3: 16, 4: 32, 5: 8, 6: 16, 7: 32}


@pytest.fixture(params=EDS_FILES.values(), ids=EDS_FILES.keys())
def eds(request: pytest.FixtureRequest) -> RawConfigParser:
    return parse(request.param)


def parse(path: Path) -> RawConfigParser:
    parser = RawConfigParser()  # strict: a section or key that is there twice raises
    parser.read_string(path.read_text())
    return parser


def listed(eds: RawConfigParser, section: str) -> list[int]:
    count = int(eds[section]["SupportedObjects"])
    assert set(eds[section]) == {"supportedobjects", *(str(n) for n in range(1, count + 1))}
    return [int(eds[section][str(n)], 0) for n in range(1, count + 1)]


def number(eds: RawConfigParser, section: str, key: str = "DefaultValue") -> int:
    return int(eds[section][key], 0)


def test_every_object_is_listed_in_its_own_list(eds: RawConfigParser) -> None:
    mandatory, optional, manufacturer = (
        listed(eds, name) for name in ("MandatoryObjects", "OptionalObjects", "ManufacturerObjects")
    )
    assert mandatory == [0x1000, 0x1001, 0x1018]
    assert all(0x2000 <= index < 0x6000 for index in manufacturer)
    assert not any(0x2000 <= index < 0x6000 for index in optional)
    sections = {int(name, 16) for name in eds.sections() if OBJECT.match(name)}
    assert sections == {*mandatory, *optional, *manufacturer}


def test_sub_indices_agree_with_sub_number_and_sub_0(eds: RawConfigParser) -> None:
    for name in filter(OBJECT.match, eds.sections()):
        subs = [section for section in eds.sections() if section.startswith(f"{name}sub")]
        if number(eds, name, "ObjectType") == 7:
            assert not subs
            continue
        assert number(eds, name, "SubNumber") == len(subs)
        counts = int(name, 16) == 0x1003 or int(name, 16) >> 8 in (0x16, 0x1A)
        if not counts:  # else sub 0 says how many are in use, which changes
            assert number(eds, f"{name}sub0") == max(int(sub.split("sub")[1], 16) for sub in subs)


def test_device_info_counts_the_pdos(eds: RawConfigParser) -> None:
    sections = eds.sections()
    assert number(eds, "DeviceInfo", "NrOfTXPDO") == sum(
        name.startswith("18") for name in sections if OBJECT.match(name)
    )
    assert number(eds, "DeviceInfo", "NrOfRXPDO") == sum(
        name.startswith("14") for name in sections if OBJECT.match(name)
    )
    assert number(eds, "DeviceInfo", "ProductNumber") == number(eds, "1018sub2")
    assert number(eds, "DeviceInfo", "RevisionNumber") == number(eds, "1018sub3")


def test_mappings_name_mappable_objects_of_that_length(eds: RawConfigParser) -> None:
    for name in filter(re.compile(r"1[6A][0-9A-F]{2}$").match, eds.sections()):
        bits = 0
        for slot in range(1, number(eds, f"{name}sub0") + 1):
            word = number(eds, f"{name}sub{slot:X}")
            index, sub = f"{word >> 16:04X}", word >> 8 & 0xFF
            section = f"{index}sub{sub:X}" if eds.has_section(f"{index}sub{sub:X}") else index
            assert eds[section]["PDOMapping"] == "1"
            assert DATA_TYPE_BITS[number(eds, section, "DataType")] == word & 0xFF
            bits += word & 0xFF
        cob_id = eds[f"{'18' if name[:2] == '1A' else '14'}{name[2:]}sub1"]["DefaultValue"]
        off = bool(int(cob_id.replace("$NODEID+", ""), 0) >> 31)
        assert bits <= (512 if off else 64)  # CAN FD or classic


def test_the_fingertips_units_are_those_of_its_process_values() -> None:
    """CiA 303-2: metre 01h, newton 21h, joule 23h in the numerator; prefix milli is FDh (-3)."""
    eds = parse(EDS_FILES["fingertip"])
    mm, newton, millijoule = 0xFD010000, 0x00210000, 0xFD230000
    units = [number(eds, f"6131sub{channel}") for channel in range(1, 9)]
    digits = [number(eds, f"6132sub{channel}") for channel in range(1, 9)]
    assert units == [mm] * 3 + [newton] * 3 + [millijoule, mm]
    assert digits == [2, 2, 2, 3, 3, 3, 2, 2]


def test_the_device_types_name_the_profiles() -> None:
    """CiA 404 with the analog input block (bit 17); CiA 402 of type stepper motor (bit 18)."""
    assert number(parse(EDS_FILES["fingertip"]), "1000") == 404 | 1 << 17
    assert number(parse(EDS_FILES["drive"]), "1000") == 402 | 1 << 18


def test_the_wheel_carries_the_files(tmp_path: Path) -> None:
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path)],
        cwd=PROJECT,
        check=True,
        capture_output=True,
    )
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        packed = archive.read("palpate_edge/node/fingertip.eds")
        assert packed == EDS_FILES["fingertip"].read_bytes()
        for name in ("drive", "axes"):
            path = EDS_FILES[name]
            assert archive.read(f"palpate_bus/eds/{path.name}") == path.read_bytes()
