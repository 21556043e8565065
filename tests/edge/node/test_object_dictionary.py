"""The typed object dictionary and the PDO codec of an EDS, and how they refuse."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate_edge.common.errors import BusError, ConfigError
from palpate_edge.node.eds import load_eds
from palpate_edge.node.object_dictionary import Access, DataType, ObjectDictionary
from palpate_edge.node.parsed_eds import FINGERTIP_EDS
from palpate_edge.node.pdo_codec import PdoDirection, pdo_codec

DRIVE = load_eds(Path(__file__).resolve().parents[3] / "host" / "palpate_bus" / "eds" / "cia402.eds", 0x10)
SHORT_EDS = """[DeviceInfo]
ProductName=short
[1000]
ParameterName=Device type
ObjectType=0x7
DataType=0x0007
AccessType=const
DefaultValue=0
PDOMapping=0
[1018]
ParameterName=Identity object
ObjectType=0x9
SubNumber=2
[1018sub0]
ParameterName=Highest sub-index supported
ObjectType=0x7
DataType=0x0005
AccessType=const
DefaultValue=1
LowLimit=1
HighLimit=1
[1018sub1]
ParameterName=Vendor-ID
ObjectType=0x7
DataType=0x0007
AccessType=ro
DefaultValue=$NODEID+0x10
"""
INT16 = st.integers(-(2**15), 2**15 - 1)


def test_entries_are_typed_and_formulas_worked_out(fingertip_od: ObjectDictionary) -> None:
    force = fingertip_od.entry(0x7130, 4)
    assert (force.data_type, force.access, force.pdo_mappable) == (DataType.INTEGER16, Access.READ_ONLY, True)
    assert fingertip_od.default_number(0x1800, 1) == 0x4000_0190
    assert fingertip_od.default_number(0x1200, 2) == 0x590


def test_encoding_is_little_endian(fingertip_od: ObjectDictionary) -> None:
    assert fingertip_od.entry(0x7130, 1).encode(-2) == b"\xfe\xff"
    assert fingertip_od.entry(0x2012).encode(0x01020304) == b"\x04\x03\x02\x01"
    assert fingertip_od.entry(0x1008).decode(b"abc") == "abc"


@pytest.mark.parametrize("value", [32768, -32769, "1", 1.5])
def test_a_value_that_does_not_fit_is_refused(fingertip_od: ObjectDictionary, value: object) -> None:
    with pytest.raises(BusError, match=r"7130h:01 .*INTEGER16"):
        fingertip_od.entry(0x7130, 1).encode(value)  # type: ignore[arg-type]


def test_an_object_that_is_not_there_is_refused(fingertip_od: ObjectDictionary) -> None:
    with pytest.raises(BusError, match=r"2FFFh:00 is not in fingertip\.eds"):
        fingertip_od.entry(0x2FFF)


@pytest.mark.parametrize("node_id", [0, 128, -1])
def test_a_node_id_out_of_range_is_refused(node_id: int) -> None:
    with pytest.raises(ConfigError, match=r"1\.\.127"):
        load_eds(FINGERTIP_EDS, node_id)


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"none\.eds cannot be read"):
        load_eds(tmp_path / "none.eds", 1)


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ("DataType=0x0006", "DataType=0x0008", "1017h:00.*8 is not a valid DataType"),
        ("AccessType=rw", "AccessType=maybe", "1017h:00.*not a valid Access"),
        ("DefaultValue=100", "DefaultValue=soon", "1017h:00.*'soon' is not a number"),
        ("DefaultValue=100", "DefaultValue=70000", "1017h:00.*does not fit UNSIGNED16"),
        ("ObjectType=0x7", "ObjectType=seven", "not a CiA 306 file"),
        ("[1017]", "[1018]", "not a CiA 306 file"),
    ],
)
def test_a_garbled_file_is_refused_with_its_place(tmp_path: Path, old: str, new: str, reason: str) -> None:
    head, tail = FINGERTIP_EDS.read_text().split("[1017]", 1)
    path = tmp_path / "garbled.eds"
    path.write_text(head + ("[1017]" + tail).replace(old, new, 1))
    with pytest.raises(ConfigError, match=reason) as refused:
        load_eds(path, 1)
    assert "garbled.eds" in str(refused.value)
    assert "\n" not in str(refused.value)


def test_an_eds_without_objects_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "notes.eds"
    path.write_text("[DeviceInfo]\nProductName=nothing\n")
    with pytest.raises(ConfigError, match="describes no object"):
        load_eds(path, 1)


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_a_damaged_file_is_read_or_refused_in_one_line(data: st.DataObject) -> None:
    """Lines are dropped, cut, doubled or overwritten; nothing but a ConfigError comes out."""
    lines = SHORT_EDS.splitlines()
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(2, len(lines) - 1))
        line = lines[at]
        cut = line[: data.draw(st.integers(0, len(line)))]
        lines[at] = data.draw(
            st.sampled_from(["", cut, line + "\n" + line, "x", "[1A00]", line.replace("0", "F")])
        )
    with TemporaryDirectory() as folder:
        path = Path(folder) / "damaged.eds"
        path.write_text("\n".join(lines))
        try:
            load_eds(path, 1)
        except ConfigError as refused:
            assert "damaged.eds" in str(refused)
            assert "\n" not in str(refused)


@pytest.mark.parametrize(
    ("number", "cob_id", "length_bytes"), [(1, 0x190, 8), (2, 0x290, 8), (3, 0x390, 8), (4, 0x490, 7)]
)
def test_the_fingertips_pdos(
    fingertip_od: ObjectDictionary, number: int, cob_id: int, length_bytes: int
) -> None:
    codec = pdo_codec(fingertip_od, PdoDirection.TRANSMIT, number)
    assert (codec.cob_id, codec.length_bytes) == (cob_id, length_bytes)


def test_a_payload_by_the_mapping(fingertip_od: ObjectDictionary) -> None:
    codec = pdo_codec(fingertip_od, PdoDirection.TRANSMIT, 2)
    assert codec.decode(bytes.fromhex("01 00 ff ff 00 80 07 fe")) == {
        (0x7130, 5): 1,
        (0x7130, 6): -1,
        (0x7130, 7): -32768,
        (0x2010, 0): 7,
        (0x2011, 0): 254,
    }


@pytest.mark.parametrize("length_bytes", [0, 1, 7])
def test_a_payload_of_another_length_is_refused(fingertip_od: ObjectDictionary, length_bytes: int) -> None:
    codec = pdo_codec(fingertip_od, PdoDirection.TRANSMIT, 1)
    with pytest.raises(
        BusError, match=rf"node 16 TPDO 1: {length_bytes} bytes, expected 8: use the same EDS"
    ):
        codec.decode(bytes(length_bytes))


@given(st.integers(0, 0xFFFF), st.integers(-128, 127), INT16)
def test_encode_and_decode_are_inverse(controlword: int, mode: int, torque: int) -> None:
    codec = pdo_codec(DRIVE, PdoDirection.RECEIVE, 1)
    values = {(0x6040, 0): controlword, (0x6060, 0): mode, (0x6071, 0): torque}
    assert codec.decode(codec.encode(values)) == values


def test_encode_refuses_what_is_missing_or_does_not_fit(drive_od: ObjectDictionary) -> None:
    codec = pdo_codec(drive_od, PdoDirection.RECEIVE, 1)
    with pytest.raises(BusError, match=r"node 16 RPDO 1: no value for 6060h:00"):
        codec.encode({(0x6040, 0): 0, (0x6071, 0): 0})
    with pytest.raises(BusError, match="node 16 RPDO 1"):
        codec.encode({(0x6040, 0): 0, (0x6060, 0): 0, (0x6071, 0): 40_000})


def test_a_pdo_that_the_eds_lacks_is_refused(fingertip_od: ObjectDictionary) -> None:
    with pytest.raises(BusError, match="1401h:01 is not in"):
        pdo_codec(fingertip_od, PdoDirection.RECEIVE, 2)
