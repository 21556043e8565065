"""Poses and places without newtons on the bus, read with the EDS by the `canopen` package."""

from __future__ import annotations

import canopen
import pytest

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.contact import Contact, LabelEstimate, refused_contact
from palpate_edge.common.contact_quantities import POSE_LABELS, SensorOutputs
from palpate_edge.node.fingertip import FingertipNode
from palpate_edge.node.fingertip_objects import MethodCode
from palpate_edge.node.parsed_eds import FINGERTIP_EDS

VALUES = (1.234, -2.5, 3.25, -0.75, 0.5, 12.34)
HALF_WIDTHS = (0.05, 0.4, 0.3, 0.2, 0.1, 1.5)
POSES = SensorOutputs(place=False, force=False, pose=True)
PLACES = SensorOutputs(force=False)
RAW = (1234, -250, 325, -750, 500, 1234)  # docs/bus.md: 0.001 mm, 0.01 deg
RAW_HALF_WIDTHS = (50, 40, 30, 200, 100, 150)
UNKNOWN = -0x8000


def contact(
    *, touching: bool = True, place: tuple[float, float, float] | None = None, labels: int = 6
) -> Contact:
    estimates = zip(POSE_LABELS[:labels], VALUES, HALF_WIDTHS, strict=False)
    return Contact(
        sequence=70_007,
        exposed_at_us=123_456,
        valid=True,
        in_contact=touching,
        position_mm=place,
        normal_force_N=None,
        force_N=None,
        quality=1.0,
        reason="",
        beads_found=140,
        beads_expected=140,
        pose=tuple(LabelEstimate(*one) for one in estimates),
    )


def sent(outputs: SensorOutputs, published: Contact) -> list[CanFrame]:
    """Return the TPDOs of a contact, in the order of the bus."""
    node = FingertipNode(0x10, MethodCode.POSE, "0123", outputs=outputs)
    node.process(0, [CanFrame(0x000, b"\x01\x00")])
    node.publish(published, 5_000)
    return list(node.slave.due_tpdos(1))


def read_by_canopen(frames: list[CanFrame]) -> dict[str, int]:
    """Return raw values by name, decoded with the mappings of the EDS by the other library."""
    remote = canopen.RemoteNode(0x10, str(FINGERTIP_EDS))
    canopen.Network().add_node(remote)
    found: dict[str, int] = {}
    for number, tpdo in remote.tpdo.items():
        tpdo.read(from_od=True)
        for frame in frames:
            if tpdo.cob_id is not None and frame.can_id == tpdo.cob_id & 0x7FF:
                tpdo.data = bytearray(frame.data)
                for variable in tpdo.map:
                    assert found.setdefault(variable.name, variable.raw) == variable.raw, number
    return found


def test_every_label_and_half_width_is_read_by_another_library() -> None:
    frames = sent(POSES, contact())
    assert [frame.can_id for frame in frames] == [0x190, 0x1B0, 0x230, 0x290, 0x2B0, 0x310, 0x330, 0x390]
    found = read_by_canopen(frames)
    kinds = ("depth", "tilt x", "tilt y", "shear x", "shear y", "torsion")
    names = [f"AI input PV.Value of object {kind}" for kind in kinds]
    assert tuple(found[name] for name in names) == RAW
    assert tuple(found[f"{name} error"] for name in names) == RAW_HALF_WIDTHS
    assert found["Frame sequence"] == 70_007 - 65_536
    assert found["Contact flags"] == 0x01 | 0x08 | 0x10


@pytest.mark.parametrize("touching", [True, False])
def test_what_a_pose_sensor_never_gives_is_unknown_and_not_zero(touching: bool) -> None:
    found = read_by_canopen(sent(POSES, contact(touching=touching)))
    never = (
        "contact x",
        "contact y",
        "contact z",
        "normal force",
        "shear force x",
        "shear force y",
        "torsion",
    )
    assert {found[f"AI input PV.Value of {name}"] for name in never} == {UNKNOWN}
    assert found["Contact flags"] & 0x04 == 0


@pytest.mark.parametrize("touching", [True, False])
def test_a_place_without_newtons_is_on_the_bus(touching: bool) -> None:
    frames = sent(PLACES, contact(touching=touching, place=(3.0, -4.0, 12.5) if touching else None, labels=0))
    assert [frame.can_id for frame in frames] == [0x190, 0x290, 0x310, 0x390]
    found = read_by_canopen(frames)
    places = [found[f"AI input PV.Value of contact {axis}"] for axis in "xyz"]
    assert places == ([300, -400, 1250] if touching else [0, 0, 0])
    forces = ("normal force", "shear force x", "shear force y")
    assert {found[f"AI input PV.Value of {name}"] for name in forces} == {UNKNOWN}
    assert found["Contact flags"] == (0x11 if touching else 0x10)


def test_a_label_that_was_not_learned_is_unknown() -> None:
    found = read_by_canopen(sent(POSES, contact(labels=3)))
    assert found["AI input PV.Value of object tilt y"] == 325
    for name in ("object shear x", "object torsion", "object torsion error"):
        assert found[f"AI input PV.Value of {name}"] == UNKNOWN


def test_a_rejected_frame_has_no_flag_and_no_pose() -> None:
    found = read_by_canopen(sent(POSES, refused_contact(1, 2, "torn", 0, 140)))
    assert found["Contact flags"] == 0
    assert found["AI input PV.Value of object depth"] == UNKNOWN
    assert found["AI input PV.Value of normal force"] == UNKNOWN


def test_a_place_that_is_missing_once_is_doubt() -> None:
    """A sensor that gives places has none in this contact: nothing is valid."""
    found = read_by_canopen(sent(PLACES, contact(place=None, labels=0)))
    assert found["Contact flags"] == 0


def test_a_pose_sensor_says_so_and_has_no_tare() -> None:
    node = FingertipNode(0x10, MethodCode.POSE, "0123", outputs=POSES)
    assert (node.slave.read(0x2000), node.slave.read(0x2004)) == (2, 0x18)
    tare = bytes.fromhex("23 25 61 01") + b"zero"
    node.process(0, [])
    (answer,) = [f for f in node.process(1, [CanFrame(0x610, tare)]).frames_out if f.can_id == 0x590]
    assert answer.data == bytes.fromhex("80 25 61 01 22 00 00 08")  # CiA 301: 0800 0022h, device state


def test_a_reset_keeps_the_poses_enabled() -> None:
    node = FingertipNode(0x10, MethodCode.POSE, "0123", outputs=POSES)
    node.process(0, [CanFrame(0x000, b"\x01\x00")])
    node.process(1, [CanFrame(0x000, b"\x81\x00"), CanFrame(0x000, b"\x01\x00")])
    node.publish(contact(), 5_000)
    assert len(node.slave.due_tpdos(2)) == 8
