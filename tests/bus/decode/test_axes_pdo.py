"""Frames of a drive node with several axes, decoded for monitor and logs."""

from __future__ import annotations

import struct

import pytest

from palpate_bus.decode.decoder import Decoder
from palpate_bus.decode.device import devices_of_header
from palpate_bus.decode.hand_nodes import read_hand_nodes
from palpate_bus.logs.candump import LogRecord
from palpate_edge.can_bus.can_frame import CanFrame

HEADER = {"node.0x05": "axes:0=flexion,3=curl", "node.0x06": "axes:none"}


@pytest.fixture
def decoder():
    return Decoder(devices_of_header(HEADER))


def test_the_state_of_each_axis_is_named_with_its_units(decoder):
    """24 bytes, a length of CAN FD."""
    data = struct.pack("<HiihHiih", 0x1637, 90_000, 0, 100, 0x0218, -45_000, 1500, -50)
    decoded = decoder.decode(LogRecord(0, CanFrame(0x185, data, fd=True)))
    assert (decoded.node_id, decoded.text) == (5, "TPDO 1")
    texts = {reading.name: reading.text for reading in decoded.readings}
    assert texts["Axis 0 statusword"] == "0x1637 (operation enabled)"
    assert texts["Axis 3 statusword"] == "0x218 (fault)"
    assert texts["Axis 0 position actual value"] == "90.000 deg"
    assert texts["Axis 3 velocity actual value"] == "1.500 deg/s"
    assert texts["Axis 3 torque actual value"] == "-5.0 %"


def test_the_command_of_each_axis_is_named(decoder):
    data = struct.pack("<HhHh", 0x0F, 250, 0x80, 0)
    decoded = decoder.decode(LogRecord(0, CanFrame(0x205, data, fd=True)))
    texts = {reading.name: reading.text for reading in decoded.readings}
    assert texts["Axis 0 controlword"] == "0xF (enable)" and texts["Axis 0 target torque"] == "25.0 %"
    assert texts["Axis 3 controlword"] == "0x80 (fault reset)"


def test_the_nodes_of_a_hand_with_axes(tmp_path):
    path = tmp_path / "hand.toml"
    joints = "{name = 'a', drive_node = 4, axis = 1}, {name = 'b', drive_node = 4, axis = 0}"
    joints += ", {name = 'c', drive_node = 5}"
    path.write_text(f"[[fingers]]\nname = 'f'\nfingertip_node = 0x10\njoints = [{joints}]\n")
    devices = read_hand_nodes(path)
    assert {node_id: device.name for node_id, device in devices.items()} == {0x10: "f", 4: "b+a", 5: "c"}
    assert devices[4].pdos[0x184].bits == 2 * 96
