"""TPDO 10: a whole contact in one CAN FD frame, read with the EDS by the `canopen` package."""

from __future__ import annotations

import canopen
import pytest

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.contact import Contact, LabelEstimate
from palpate_edge.common.contact_quantities import POSE_LABELS, SensorOutputs
from palpate_edge.node.fingertip import FingertipNode
from palpate_edge.node.fingertip_objects import DOME_OUTPUTS, MethodCode
from palpate_edge.node.parsed_eds import FINGERTIP_EDS
from palpate_edge.node.stored_parameters import NOTHING_STORED, StoredParameters

NODE = 0x10
MBIT_5 = 5_000_000
START, PREOP = (CanFrame(0x000, bytes([command, 0])) for command in (0x01, 0x80))
COB_ID, COUNT = (0x1809, 1), (0x1A09, 0)
VALID_ID = 0x4000_0410  # docs/bus.md: 0x400 + id
DISABLED = 1 << 31
DOME_AND_POSE = SensorOutputs(pose=True)
DEVICE_STATE, TOO_LONG = 0x0800_0022, 0x0604_0042  # CiA 301, SDO abort codes


def node_of(
    data_bitrate: int | None, outputs: SensorOutputs = DOME_OUTPUTS, kept: StoredParameters = NOTHING_STORED
) -> FingertipNode:
    return FingertipNode(
        NODE, MethodCode.CORRECTED, "0123", outputs=outputs, data_bitrate=data_bitrate, kept=kept
    )


def contact() -> Contact:
    return Contact(
        sequence=70_007,
        exposed_at_us=123_456,
        valid=True,
        in_contact=True,
        position_mm=(1.5, -4.0, 29.7),
        normal_force_N=1.25,
        force_N=(0.1, -0.2, -1.25),
        quality=1.0,
        reason="",
        beads_found=140,
        beads_expected=140,
        radius95_mm=0.42,
        torsion_Nmm=-3.5,
        torsion95_Nmm=0.7,
        force95_N=0.031,
        pose=tuple(LabelEstimate(label, 1.5, 0.25) for label in POSE_LABELS),
    )


def sent(node: FingertipNode) -> list[CanFrame]:
    node.process(0, [START])
    node.publish(contact(), 5_000)
    return list(node.slave.due_tpdos(1))


def read_by_canopen(data: bytes, objects: int) -> dict[str, int]:
    """Return raw values by name, decoded with the first `objects` of the mapping by the other library."""
    remote = canopen.RemoteNode(NODE, str(FINGERTIP_EDS))
    found, offset = {}, 0
    for slot in range(1, 1 + objects):
        word = remote.object_dictionary[0x1A09][slot].default
        variable = remote.object_dictionary.get_variable(word >> 16, word >> 8 & 0xFF)
        assert variable is not None
        length = (word & 0xFF) // 8
        found[variable.qualname] = variable.decode_raw(data[offset : offset + length])
        offset += length
    assert set(data[offset:]) <= {0}
    return found


def write(node: FingertipNode, now_us: int, key: tuple[int, int], value: int, size: int) -> int:
    """Write by SDO (CiA 301, expedited download); return the abort code, 0 for none."""
    head = bytes([0x23 | (4 - size) << 2]) + key[0].to_bytes(2, "little") + bytes([key[1]])
    frame = CanFrame(0x600 + NODE, (head + value.to_bytes(size, "little")).ljust(8, b"\0"))
    (answer,) = [f for f in node.process(now_us, [frame]).frames_out if f.can_id == 0x580 + NODE]
    return int.from_bytes(answer.data[4:], "little") if answer.data[0] == 0x80 else 0


@pytest.mark.parametrize(("outputs", "length", "objects"), [(DOME_OUTPUTS, 32, 15), (DOME_AND_POSE, 64, 27)])
def test_a_contact_is_one_fd_frame(outputs: SensorOutputs, length: int, objects: int) -> None:
    (frame,) = sent(node_of(MBIT_5, outputs))
    assert (frame.can_id, frame.fd, len(frame.data)) == (0x410, True, length)
    found = read_by_canopen(frame.data, objects)
    value = "AI input PV.Value of "
    assert [found[f"{value}contact {axis}"] for axis in "xyz"] == [150, -400, 2970]
    assert (found[f"{value}normal force"], found[f"{value}error radius"]) == (1250, 42)
    assert (found[f"{value}torsion"], found[f"{value}torsion error"]) == (-350, 70)
    assert found[f"{value}force error"] == 31
    assert (found["Contact flags"], found["Frame sequence"]) == (0x05, 70_007 - 65_536)
    assert (found["Exposure time"], found["Processing latency"]) == (123_456, 5_000)
    if objects > 15:
        assert (found[f"{value}object depth"], found[f"{value}object torsion error"]) == (1500, 25)


def test_a_classic_node_sends_classic_frames_alone() -> None:
    frames = sent(node_of(None))
    assert [frame.can_id for frame in frames] == [0x190, 0x290, 0x310, 0x390]
    assert not any(frame.fd for frame in frames)


@pytest.mark.parametrize(("data_bitrate", "announced"), [(None, 0), (MBIT_5, 5_000_000)])
def test_the_data_bit_rate_is_announced(data_bitrate: int | None, announced: int) -> None:
    assert node_of(data_bitrate).slave.read(0x2005) == announced


def test_everything_else_stays_classic() -> None:
    node = node_of(MBIT_5)
    frames = [*node.process(0, [START]).frames_out, *node.process(2_000_000, []).frames_out]
    upload = CanFrame(0x600 + NODE, bytes.fromhex("40 08 10 00 00 00 00 00"))
    frames += node.process(2_000_001, [upload]).frames_out
    assert {frame.can_id for frame in frames} >= {0x710, 0x490, 0x590}
    assert not any(frame.fd or len(frame.data) > 8 for frame in frames)


def test_a_classic_node_refuses_to_enable_it() -> None:
    node = node_of(None)
    node.process(0, [])
    assert write(node, 1, COB_ID, VALID_ID, 4) == DEVICE_STATE
    assert write(node, 2, COB_ID, VALID_ID | DISABLED, 4) == 0


def test_a_running_node_refuses_a_remap() -> None:
    node = node_of(MBIT_5)
    node.process(0, [START])
    assert write(node, 1, COB_ID, VALID_ID | DISABLED, 4) == DEVICE_STATE


def test_a_remap_holds_up_to_64_bytes_and_stays_an_fd_frame() -> None:
    node = node_of(MBIT_5)
    node.process(0, [])
    assert write(node, 1, COB_ID, VALID_ID | DISABLED, 4) == 0
    assert write(node, 2, COUNT, 0, 1) == 0
    for slot in range(1, 18):  # 2012h, of 4 bytes
        assert write(node, 2 + slot, (0x1A09, slot), 0x2012_0020, 4) == 0
    assert write(node, 30, COUNT, 17, 1) == TOO_LONG
    assert write(node, 31, COUNT, 2, 1) == 0
    assert write(node, 32, COB_ID, VALID_ID, 4) == 0
    (frame,) = sent(node)
    assert (frame.fd, frame.data) == (True, (123_456).to_bytes(4, "little") * 2)


def test_a_classic_pdo_of_an_fd_node_keeps_its_8_bytes() -> None:
    node = node_of(MBIT_5)
    node.process(0, [])
    assert write(node, 1, (0x1A00, 0), 0, 1) == 0
    for slot in (1, 2, 3):
        assert write(node, 1 + slot, (0x1A00, slot), 0x2012_0020, 4) == 0
    assert write(node, 9, (0x1A00, 0), 3, 1) == TOO_LONG


def test_a_stored_fd_pdo_is_not_used_on_a_classic_bus() -> None:
    """The node was moved: it must not disturb a classic bus with frames that nobody else receives."""
    checksum = node_of(None).slave._store.od.checksum
    kept = StoredParameters(eds_checksum=checksum, objects={COB_ID: 0x4000_0411})
    moved = node_of(None, kept=kept)
    assert "1809h:01" in str(moved.slave.stored_fault)
    assert all(not frame.fd for frame in sent(moved))
    assert [frame.can_id for frame in sent(node_of(MBIT_5, kept=kept))] == [0x411]
