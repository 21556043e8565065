"""A contact in a CAN FD frame, decoded by the EDS for monitor and logs."""

from __future__ import annotations

import pytest

from palpate_bus.decode.decoder import Decoder, Service
from palpate_bus.logs.candump import LogRecord
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.contact import Contact, LabelEstimate
from palpate_edge.common.contact_quantities import SensorOutputs
from palpate_edge.node.fingertip import FingertipNode
from palpate_edge.node.fingertip_objects import MethodCode

TOUCH = Contact(
    sequence=7,
    exposed_at_us=1_000_000,
    valid=True,
    in_contact=True,
    position_mm=(1.5, -2.0, 29.0),
    normal_force_N=1.25,
    force_N=None,
    quality=1.0,
    reason="",
    beads_found=85,
    beads_expected=85,
    pose=(LabelEstimate("depth_mm", 1.5, 0.2),),
)


def sent(outputs: SensorOutputs) -> CanFrame:
    node = FingertipNode(0x10, MethodCode.CORRECTED, "0123", outputs=outputs, data_bitrate=5_000_000)
    node.process(0, [CanFrame(0x000, b"\x01\x10")])
    node.publish(TOUCH, 5_000)
    (frame,) = node.slave.due_tpdos(1)
    return frame


@pytest.mark.parametrize(("poses", "length"), [(False, 32), (True, 64)])
def test_every_quantity_is_named(poses: bool, length: int) -> None:
    frame = sent(SensorOutputs(pose=poses))
    assert len(frame.data) == length
    decoded = Decoder().decode(LogRecord(0, frame))
    assert (decoded.service, decoded.node_id, decoded.text) == (Service.TPDO, 0x10, "TPDO 10")
    values = {reading.name: reading.value for reading in decoded.readings}
    assert values["Value of contact y"] == pytest.approx(-2.0)
    assert values["Value of normal force"] == pytest.approx(1.25)
    assert values["Frame sequence"] == 7
    assert values.get("Value of object depth") == (pytest.approx(1.5) if poses else None)


def test_another_length_is_malformed() -> None:
    decoded = Decoder().decode(LogRecord(0, CanFrame(0x410, bytes(48), fd=True)))
    assert decoded.text == "TPDO 10: malformed: 48 bytes, its mapping has 30"
    classic = Decoder().decode(LogRecord(0, CanFrame(0x410, bytes(8))))
    assert "malformed: 8 bytes" in classic.text
