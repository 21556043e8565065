"""docs/ros2_canopen/bus.yml fits the EDS; a fingertip configured by dcfgen sends the same contacts."""

from __future__ import annotations

import configparser
import shutil
import struct
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.contact import Contact
from palpate_edge.node.eds import load_eds
from palpate_edge.node.fingertip import FingertipNode
from palpate_edge.node.fingertip_objects import MethodCode
from palpate_edge.node.parsed_eds import FINGERTIP_EDS

ROOT = Path(__file__).resolve().parents[3]
BUS_YML = ROOT / "docs" / "ros2_canopen" / "bus.yml"
DCFGEN = ROOT / ".cache" / "dcfgen" / "bin" / "dcfgen"
FINGERS = {"finger_1": 0x10, "finger_2": 0x11, "finger_3": 0x12}
TOUCH = Contact(
    sequence=7,
    exposed_at_us=123_456,
    valid=True,
    in_contact=True,
    position_mm=(5.0, -8.0, 27.0),
    normal_force_N=2.0,
    force_N=(0.5, -1.2, -1.6),
    torsion_Nmm=-3.25,
    radius95_mm=0.42,
    quality=0.5,
    reason="",
    beads_found=28,
    beads_expected=28,
)


@pytest.fixture
def fingers() -> dict[str, dict]:
    """The fingertips of bus.yml with their settings."""
    yaml = pytest.importorskip("yaml", reason="PyYAML is not installed: make test installs it")
    content = yaml.safe_load(BUS_YML.read_text())
    return {
        name: settings
        for name, settings in content.items()
        if name not in ("options", "master") and not name.startswith(".")
    }


def test_the_configuration_is_of_three_fingertips(fingers):
    assert {name: settings["node_id"] for name, settings in fingers.items()} == FINGERS
    assert {settings["dcf"] for settings in fingers.values()} == {FINGERTIP_EDS.name}


@pytest.mark.parametrize("name", FINGERS)
def test_every_object_of_the_configuration_is_in_the_eds_and_may_be_mapped(fingers, name):
    settings = fingers[name]
    od = load_eds(FINGERTIP_EDS, settings["node_id"])
    od.entry(0x1017, 0).check(settings["heartbeat_producer"])
    for number, pdo in settings["tpdo"].items():
        od.entry(0x1800 + number - 1, 2).check(pdo["transmission"])
        entries = [od.entry(one["index"], one["sub_index"]) for one in pdo["mapping"]]
        assert all(entry.pdo_mappable for entry in entries)
        words = [entry.index << 16 | entry.subindex << 8 | 8 * entry.size_bytes for entry in entries]
        mapping = 0x1A00 + number - 1
        default = [od.entry(mapping, 1 + slot).default for slot in range(od.entry(mapping, 0).default)]
        assert words == default  # what palpate-host decodes


@pytest.fixture
def generated(tmp_path: Path) -> Path:
    """The folder in which dcfgen has made master.dcf and a concise DCF for each fingertip."""
    if not DCFGEN.exists():
        pytest.skip("dcfgen is not installed: make dcfgen-test")
    shutil.copy(BUS_YML, tmp_path)
    shutil.copy(FINGERTIP_EDS, tmp_path)
    done = subprocess.run(
        [DCFGEN, "-r", BUS_YML.name], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return tmp_path


def writes(path: Path) -> Iterator[tuple[int, int, bytes]]:
    """Yield (index, sub-index, value) of a concise DCF (CiA 302: 1F22h)."""
    content = path.read_bytes()
    (count,) = struct.unpack_from("<I", content)
    at = 4
    for _ in range(count):
        index, subindex, size = struct.unpack_from("<HBI", content, at)
        at += 7
        yield index, subindex, content[at : at + size]
        at += size
    assert at == len(content)


def contact_frames(node: FingertipNode, node_id: int) -> list[CanFrame]:
    """Start the node and return what it sends for a contact."""
    node.process(2, (CanFrame(0x000, bytes([0x01, node_id])),))
    node.publish(TOUCH, 5_000)
    return list(node.process(3, ()).frames_out)


@pytest.mark.dcfgen
@pytest.mark.parametrize(("name", "node_id"), FINGERS.items())
def test_a_fingertip_takes_what_dcfgen_writes_and_sends_the_same_contacts(generated, name, node_id):
    untouched, configured = (FingertipNode(node_id, MethodCode.CORRECTED, "0123456789abcdef") for _ in "ab")
    untouched.process(0, ())
    configured.process(0, ())
    requests = list(writes(generated / f"{name}.bin"))
    cob_ids = [struct.unpack("<I", value)[0] for index, sub, value in requests if index >> 8 == 0x18]
    assert cob_ids and not any(cob_id & 1 << 30 for cob_id in cob_ids)
    for index, subindex, value in requests:
        command = bytes([0x23 | 4 - len(value) << 2]) + struct.pack("<HB", index, subindex)
        output = configured.process(1, (CanFrame(0x600 + node_id, command + value.ljust(4, b"\x00")),))
        answers = [frame.data[0] for frame in output.frames_out if frame.can_id == 0x580 + node_id]
        assert answers == [0x60], f"{index:04X}h:{subindex:02X}"
    frames = contact_frames(configured, node_id)
    assert frames == contact_frames(untouched, node_id)
    assert {0x180 + node_id, 0x280 + node_id, 0x380 + node_id} <= {frame.can_id for frame in frames}


@pytest.mark.dcfgen
def test_the_master_receives_the_contacts_under_the_identifiers_of_the_fingertips(generated):
    master = configparser.ConfigParser(strict=False)
    master.read(generated / "master.dcf")
    received = {
        int(master[section].get("ParameterValue", master[section]["DefaultValue"]), 0)
        for section in master.sections()
        if section.startswith("14") and section.endswith("sub1")
    }
    wanted = {base + node_id for base in (0x180, 0x280, 0x380) for node_id in FINGERS.values()}
    assert wanted <= received
