"""`bus check-eds`: our files pass, each mistake is found in its line, and no file of any vendor stops it.

Expected values: CiA 306-1 and CiA 301. Each mistake is one line of a good file changed by hand.
"""

from __future__ import annotations

import random
import re

import canopen
import durand.network
import durand.node
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from palpate_bus.cli.main import bus
from palpate_bus.eds.check import check_file, check_text
from palpate_bus.eds.cia402 import CIA402_EDS
from palpate_bus.eds.objects import read_objects
from palpate_bus.eds.text import Findings, Severity, parse_sections
from palpate_edge.common.errors import ConfigError
from palpate_edge.node.parsed_eds import FINGERTIP_EDS

DRIVE = CIA402_EDS.read_text()


def errors(text):
    return [found for found in check_text(text, "cia402.eds") if found.severity is Severity.ERROR]


def changed(section, old, new):
    """DRIVE with `old` replaced in a section, and the line where it stands."""
    start = DRIVE.index(f"[{section}]\n")
    place = DRIVE.index(old, start)
    end = DRIVE.find("\n[", start)
    assert end == -1 or place < end, (section, old)
    return DRIVE[:place] + new + DRIVE[place + len(old) :], DRIVE[:place].count("\n") + 1


@pytest.mark.parametrize("path", [FINGERTIP_EDS, CIA402_EDS], ids=lambda path: path.name)
def test_our_files_are_without_a_finding(path):
    assert check_file(path) == []


@pytest.mark.parametrize(
    ("section", "old", "new", "problem"),
    [
        ("FileInfo", "CreationDate=11-21-2026", "CreationDate=21.11.2026", "is '21.11.2026'"),
        ("FileInfo", "EDSVersion=4.0", "EDSVersion=four", "is 'four'"),
        ("FileInfo", "FileRevision=1", "FileRevision=256", "is 256"),
        ("DeviceInfo", "BaudRate_125=1", "BaudRate_125=yes", "'yes' is not a number"),
        ("DeviceInfo", "NrOfTXPDO=2", "NrOfTXPDO=3", "is 3, but 2 are described"),
        ("DeviceInfo", "LSS_Supported=0", "LSS_Supported=2", "is 2"),
        (
            "MandatoryObjects",
            "SupportedObjects=3",
            "SupportedObjects=4",
            "SupportedObjects is 4, but 3 are listed",
        ),
        ("MandatoryObjects", "3=0x1018", "3=0x1019", "1019h is outside this list's range"),
        ("MandatoryObjects", "2=0x1001", "7=0x1001", "entry '7' instead of '2'"),
        ("OptionalObjects", "1=0x1005", "1=0x1006", "1006h has no section"),
        ("1000", "ParameterName=Device type", "ParameterName=", "has no ParameterName"),
        ("1000", "DataType=0x0007", "DataType=0x0006", "DataType 0x0006 is not that of CiA 301"),
        ("1000", "DataType=0x0007", "DataType=0x0017", "is not a data type of CiA 301"),
        ("1000", "AccessType=const", "AccessType=rw", "is writable, CiA 301 requires read-only"),
        ("1000", "AccessType=const", "AccessType=readonly", "AccessType is 'readonly'"),
        ("1000", "ObjectType=0x7", "ObjectType=0x4", "is not an object code"),
        ("1001", "DefaultValue=0", "DefaultValue=256", "is outside the range of UNSIGNED8, 0 to 255"),
        ("1001", "DefaultValue=0", "DefaultValue=none", "'none' is not a number"),
        ("1001", "PDOMapping=1", "PDOMapping=2", "is 2"),
        ("1018", "SubNumber=5", "SubNumber=4", "SubNumber is 4, but 5 sub-indices are described"),
        ("1018", "ObjectType=0x9", "ObjectType=0x8", "is not that of CiA 301, RECORD"),
        ("1018sub0", "DefaultValue=4", "DefaultValue=3", "is 3, but the highest described sub-index is 4"),
        ("1018sub0", "DataType=0x0005", "DataType=0x0006", "is not UNSIGNED8"),
        ("1600sub0", "DefaultValue=3", "DefaultValue=9", "above HighLimit 8"),
        ("1600sub0", "LowLimit=0", "LowLimit=9", "LowLimit 9 is above HighLimit 8"),
        ("1400sub2", "DefaultValue=255", "DefaultValue=252", "transmission type 252 is reserved"),
        ("1800sub2", "DefaultValue=1", "DefaultValue=241", "transmission type 241 is reserved"),
        (
            "1A00sub1",
            "DefaultValue=0x60640020",
            "DefaultValue=0x60640010",
            "maps 16 bits of 6064h:00, whose type is INTEGER32",
        ),
        (
            "1A00sub1",
            "DefaultValue=0x60640020",
            "DefaultValue=0x60650020",
            "6065h:00, which is not in this file",
        ),
        ("1A00sub1", "DefaultValue=0x60640020", "DefaultValue=0x10170010", "1017h:00, whose PDOMapping is 0"),
        ("1A00sub1", "DefaultValue=0x60640020", "DefaultValue=0x00070020", "maps dummy 0007h:00"),
        (
            "1A00sub2",
            "DefaultValue=0x606C0020",
            "DefaultValue=0",
            "is counted as mapped but contains no object",
        ),
        ("1600sub1", "DefaultValue=0x60400010", "DefaultValue=0x60410010", "6041h:00, whose access is ro"),
        ("1800sub1", "$NODEID+0x40000180", "$NODEID+0x40000280", None),  # found at TPDO 2, below
        ("1801sub1", "$NODEID+0x40000280", "$NODEID+0x40000180", "the identifier of TPDO 1"),
        ("1801sub1", "$NODEID+0x40000280", "$NODEID+0x580", "TPDO 2 has the identifier of SDO server 1"),
        ("1801sub1", "$NODEID+0x40000280", "0x00000001", "restricted identifier 001h"),
        ("1400sub1", "$NODEID+0x200", "$NODEID+$NODEID", "contains $NODEID 2 times"),
    ],
)
def test_each_mistake_is_found_in_its_line(section, old, new, problem):
    text, line = changed(section, old, new)
    found = errors(text)
    if problem is None:
        assert [error.problem for error in found] == [
            f"TPDO 2 has the identifier of TPDO 1 (line {line}), 281h at node 1"
        ]
        return
    assert [error for error in found if error.line == line and problem in error.problem], [
        error.text("cia402.eds") for error in found
    ]
    assert all(error.way_out for error in found)


def test_a_pdo_of_more_than_64_bits():
    text, line = changed("1A00sub0", "DefaultValue=2", "DefaultValue=3")
    text = text.replace("[1A00sub3]", "[1A00sub3]", 1)
    start = text.index("[1A00sub3]")
    text = text[:start] + text[start:].replace("DefaultValue=0x00000000", "DefaultValue=0x60770010", 1)
    (found,) = errors(text)
    assert (found.line, found.problem) == (line, "maps 80 bits, a frame has 64")
    enabled = "DefaultValue=$NODEID+0x40000180"
    assert text.count(enabled) == 1
    assert not errors(text.replace(enabled, "DefaultValue=$NODEID+0xC0000180"))  # a CAN FD PDO that is off


@pytest.mark.parametrize(
    ("text", "line", "problem"),
    [
        ("x=1\n", 1, "precedes the first section"),
        ("[FileInfo]\nFileName\n", 2, "is not key=value"),
        ("[FileInfo]\n[FileInfo]\n", 2, "is already defined in line 1"),
        ("[FileInfo\n", 1, "is not a [section] line"),
        ("[1018sub1]\nParameterName=a\n", 1, "the section [1018] of its object is missing"),
        ("[1000]\n[1000]\n", 2, "is already defined in line 1"),
        ("", 0, "is missing"),
    ],
)
def test_lines_and_sections(text, line, problem):
    assert [found for found in check_text(text, "x.eds") if found.line == line and problem in found.problem]


def test_a_missing_mandatory_object_is_named():
    start = DRIVE.index("[1001]")
    text = DRIVE[:start] + DRIVE[DRIVE.index("[1018]") :]
    assert {(found.where, found.problem) for found in errors(text)} >= {
        ("[1001]", "is mandatory and missing"),
        ("[MandatoryObjects]", "1001h has no section"),
    }


@pytest.mark.parametrize("path", [FINGERTIP_EDS, CIA402_EDS], ids=lambda path: path.name)
def test_objects_are_those_that_the_canopen_package_reads(path):
    """Defaults at node 1 and all, by a second reader."""
    ours = read_objects(parse_sections(path.read_text(), Findings()), Findings())
    theirs = {}
    for item in canopen.import_od(str(path), node_id=1).values():
        for variable in [item] if isinstance(item, canopen.objectdictionary.ODVariable) else item.values():
            theirs[variable.index, variable.subindex] = variable
    assert ours.keys() == theirs.keys()
    for key, variable in ours.items():
        assert (variable.name, variable.data_type) == (theirs[key].name, theirs[key].data_type)
        assert variable.mappable == theirs[key].pdo_mappable
        if isinstance(variable.default, int):
            assert variable.default == theirs[key].default


class Silent(durand.network.NetworkABC):
    """No bus: only durand's own EDS is wanted."""

    def add_subscription(self, cob_id, callback):
        pass

    def remove_subscription(self, cob_id):
        pass

    def send(self, cob_id, msg):
        pass


def test_a_foreign_exporter_is_read_and_its_faults_are_named():
    """durand 0.5.0 writes ARRAY for records, a float into UNSIGNED16 and no bit rate."""
    text = durand.node.MinimalNode(Silent(), 2).eds.content
    problems = {(found.where, found.problem) for found in errors(text)}
    assert ("[1015] DefaultValue", "'0.0' is not a number") in problems
    assert ("[DeviceInfo]", "supports no bit rate") in problems
    assert ("[1018]", "ObjectType 0x8 is not that of CiA 301, RECORD") in problems


def check_shape(text):
    lines = len(re.split(r"\r\n|\r|\n", text))
    for found in check_text(text, "x.eds"):
        assert 0 <= found.line <= lines
        assert len(found.text("x.eds").splitlines()) == 1


KEYS = (
    "ParameterName ObjectType DataType AccessType DefaultValue LowLimit HighLimit PDOMapping SubNumber "
    "CompactSubObj 1"
)
LINES = st.one_of(
    st.text(max_size=30),
    st.sampled_from(DRIVE.splitlines()),
    st.builds(
        "{}={}".format,
        st.sampled_from(KEYS.split()),
        st.one_of(
            st.text(max_size=12),
            st.integers().map(str),
            st.integers(0, 1 << 70).map(hex),
            st.sampled_from(
                ["$NODEID", "$NODEID+", "+$NODEID+0x80", "1e999", "nan", "-", "0x", "08", "rw", "0x9"]
            ),
        ),
    ),
    st.builds("[{:04X}]".format, st.sampled_from([0x1000, 0x1018, 0x1400, 0x1600, 0x1A00, 0x1800, 0x2000])),
    st.builds(
        "[{:04X}sub{:X}]".format, st.sampled_from([0x1018, 0x1600, 0x1A00, 0x1800]), st.integers(0, 300)
    ),
)


@pytest.mark.long
@given(st.lists(LINES, max_size=60).map("\n".join))
def test_no_text_stops_it(text):
    check_shape(text)


@given(st.integers(0, 1 << 32))
def test_no_damage_to_a_good_file_stops_it(seed):
    dice = random.Random(seed)
    data = bytearray(DRIVE.encode())
    for _ in range(dice.randint(1, 20)):
        place, length = dice.randrange(len(data)), dice.choice((0, 1, 1, 5, 200))
        data[place : place + length] = bytes(dice.randrange(1, 256) for _ in range(dice.choice((0, 1, 3))))
    check_shape(data.decode("latin-1"))


def test_the_command_prints_line_and_count_and_fails(tmp_path):
    path = tmp_path / "cia402.eds"
    text, line = changed("1001", "DefaultValue=0", "DefaultValue=256")
    path.write_text(text)
    result = CliRunner().invoke(bus, ["check-eds", str(path), str(CIA402_EDS)])
    assert result.exit_code == 1
    said = result.output.splitlines()
    assert said[0].startswith(
        f"{path}:{line}: error: [1001] DefaultValue: 256 is outside the range of UNSIGNED8"
    )
    assert said[1:] == [f"{path}: 1 errors, 0 warnings", f"{CIA402_EDS}: 0 errors, 0 warnings"]
    assert CliRunner().invoke(bus, ["check-eds", str(CIA402_EDS)]).exit_code == 0


@pytest.mark.parametrize(("data", "problem"), [(None, "cannot be read"), (b"[a]\n\0", "byte 4 is zero")])
def test_what_is_no_text_is_refused(tmp_path, data, problem):
    path = tmp_path / "x.eds"
    if data is not None:
        path.write_bytes(data)
    with pytest.raises(ConfigError, match=problem):
        check_file(path)
