"""A contact as one CAN FD frame: the host decodes the same contact, and checks the node as before."""

from __future__ import annotations

import re
from functools import cache

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.contact import Contact, LabelEstimate
from palpate_edge.common.contact_quantities import POSE_LABELS, SensorOutputs
from palpate_edge.common.errors import BusError
from palpate_edge.node.eds import load_eds
from palpate_edge.node.fingertip import FingertipNode
from palpate_edge.node.fingertip_objects import MethodCode
from palpate_edge.node.parsed_eds import FINGERTIP_EDS
from palpate_edge.node.stored_parameters import StoredParameters
from palpate_host.common.mode import Mode
from palpate_host.common.tip_contact import TipContact
from palpate_host.network.fingertips import Fingertip

NODE = 0x10
MBIT_5 = 5_000_000
NOW_US = 1_700_000_000_000_000
LATENCY_US = 20_000
START = CanFrame(0x000, b"\x01\x00")
TPDO_10 = 0x410


@cache
def node_and_host(outputs: SensorOutputs, data_bitrate: int | None) -> tuple[FingertipNode, Fingertip]:
    node = FingertipNode(NODE, MethodCode.POSE, "0123", outputs=outputs, data_bitrate=data_bitrate)
    node.process(0, [START])
    return node, Fingertip(NODE, "finger-1", fd=data_bitrate is not None)


def decoded(contact: Contact, outputs: SensorOutputs, data_bitrate: int | None) -> TipContact | None:
    """Return what the host has of a contact that the fingertip publishes."""
    node, host = node_and_host(outputs, data_bitrate)
    host.forget()
    node.publish(contact, LATENCY_US)
    received = [host.receive(NOW_US, frame) for frame in node.slave.due_tpdos(1)]
    assert received[:-1] == [None] * (len(received) - 1)
    return received[-1]


NUMBERS = st.none() | st.floats(-400, 400) | st.sampled_from([float("nan"), float("inf")])
VECTORS = st.none() | st.tuples(*(st.floats(-40, 40),) * 3)
POSES = st.lists(st.sampled_from(POSE_LABELS), unique=True).flatmap(
    lambda labels: st.tuples(
        *(st.builds(LabelEstimate, st.just(one), st.floats(-40, 40), st.floats(0, 9)) for one in labels)
    )
)
CONTACTS = st.builds(
    Contact,
    sequence=st.integers(0, 1 << 20),
    exposed_at_us=st.integers(NOW_US - 2 * LATENCY_US, NOW_US - LATENCY_US),
    valid=st.booleans(),
    in_contact=st.booleans(),
    slip=st.booleans(),
    position_mm=VECTORS,
    normal_force_N=NUMBERS,
    force_N=VECTORS,
    quality=st.floats(0, 1),
    reason=st.just(""),
    beads_found=st.just(80),
    beads_expected=st.just(85),
    radius95_mm=NUMBERS,
    torsion_Nmm=NUMBERS,
    torsion95_Nmm=NUMBERS,
    force95_N=NUMBERS,
    pose=POSES,
)
OUTPUTS = st.builds(SensorOutputs, st.booleans(), st.booleans(), st.booleans())


@settings(max_examples=60)
@given(CONTACTS, OUTPUTS)
def test_both_ways_give_the_same_contact(contact: Contact, outputs: SensorOutputs) -> None:
    classic, fd = (decoded(contact, outputs, rate) for rate in (None, MBIT_5))
    assert classic is not None
    assert fd == classic


def touch(sequence: int) -> Contact:
    return Contact(
        sequence=sequence,
        exposed_at_us=NOW_US + 10_000 * sequence - LATENCY_US,
        valid=True,
        in_contact=True,
        position_mm=(1.0, -2.0, 29.0),
        normal_force_N=1.0,
        force_N=None,
        quality=1.0,
        reason="",
        beads_found=85,
        beads_expected=85,
    )


def stream(count: int) -> list[tuple[int, CanFrame]]:
    """Return the frames of `count` contacts, 10 ms apart, with their arrival."""
    node, _ = node_and_host(SensorOutputs(), MBIT_5)
    arriving = []
    for number in range(count):
        node.publish(touch(number), LATENCY_US)
        (frame,) = node.slave.due_tpdos(1 + number)
        arriving.append((NOW_US + 10_000 * number, frame))
    return arriving


def test_lost_duplicate_and_late_frames_are_counted_as_classic_ones() -> None:
    host = Fingertip(NODE, "finger-1", fd=True)
    first, second, third, fourth, fifth = stream(5)
    assert host.receive(*first) is not None
    assert host.receive(first[0] + 100, first[1]) is None
    assert host.receive(*fourth) is not None  # two were lost
    assert host.receive(fourth[0] + 5, second[1]) is None  # one of them is late
    assert host.receive(*fifth) is not None
    counters = host.counters
    assert (counters.complete, counters.duplicates, counters.lost_frames, counters.late) == (3, 1, 2, 1)
    assert third not in (first, fourth)


def test_a_frame_of_another_length_is_a_fault_that_names_the_pdo() -> None:
    host = Fingertip(NODE, "finger-1", fd=True)
    with pytest.raises(BusError, match="TPDO 10: 24 bytes, expected 32"):
        host.receive(NOW_US, CanFrame(TPDO_10, bytes(24), fd=True))


def on_fd(table_4):
    config, hand = table_4
    return msgspec.structs.replace(config, bus=msgspec.structs.replace(config.bus, data_bitrate=MBIT_5)), hand


def test_a_hand_on_a_can_fd_bus_turns_the_object(bench, table_4) -> None:
    rig = bench.VirtualBench(*on_fd(table_4))
    status = rig.run(2.5)
    assert (status.mode, status.reason.startswith("FAULT")) == (Mode.MANIPULATE, False)
    assert {finger.incomplete + finger.late + finger.unverified for finger in status.fingers} == {0}
    fd_ids = {frame.can_id for _, frame in rig.log if frame.fd}
    assert fd_ids == {TPDO_10, TPDO_10 + 1, TPDO_10 + 2}
    assert all(len(frame.data) == 32 for _, frame in rig.log if frame.fd)
    classic = {frame.can_id for _, frame in rig.log if not frame.fd}
    assert not classic & {base + NODE for base in (0x180, 0x280, 0x300, 0x380)}


@pytest.mark.slow
def test_a_fingertip_that_falls_silent_is_missed_as_on_a_classic_bus(bench, table_4) -> None:
    """The modes and their times are those of the same hand on a classic bus."""
    histories = []
    for config, hand in (table_4, on_fd(table_4)):
        rig = bench.VirtualBench(config, hand)
        rig.run(1.5)
        rig.silent.add(NODE)
        rig.run(0.6)
        modes = [status.mode for status in rig.statuses]
        changes = [(i, modes[i]) for i in range(1, len(modes)) if modes[i] is not modes[i - 1]]
        histories.append([change for change in changes if change[0] > 140])
    assert histories[0] == histories[1]
    assert [mode for _, mode in histories[0]] == [Mode.BLIND, Mode.HOLD]


@pytest.mark.parametrize(
    ("host_rate", "tip_rate", "reason"),
    [
        (None, MBIT_5, "1800h:01 is 0xC0000190, expected 0x40000190.*give hand.toml the same"),
        (MBIT_5, None, "2005h:00 is 0x0, expected 0x4C4B40: set bus.data_bitrate to 5000000"),
        (MBIT_5, 2_000_000, "2005h:00 is 0x1E8480, expected 0x4C4B40"),
    ],
)
def test_a_mixed_configuration_waits_in_check(bench, table_4, host_rate, tip_rate, reason) -> None:
    config, hand = on_fd(table_4) if host_rate else table_4
    rig = bench.VirtualBench(config, hand)
    rig.tips[0] = bench.make_tip(NODE, tip_rate)
    status = rig.run(1.0)
    assert status.mode is Mode.CHECK
    assert re.search(reason, status.reason), status.reason


def test_exchanged_places_in_the_fd_mapping_are_found(bench, table_4) -> None:
    objects = {(0x1A09, 1): 0x7130_0210, (0x1A09, 2): 0x7130_0110}
    kept = StoredParameters(eds_checksum=load_eds(FINGERTIP_EDS, NODE).checksum, objects=objects)
    rig = bench.VirtualBench(*on_fd(table_4))
    rig.tips[0] = FingertipNode(NODE, MethodCode.CORRECTED, "0" * 16, kept=kept, data_bitrate=MBIT_5)
    status = rig.run(1.0)
    assert status.mode is Mode.CHECK
    assert "1A09h:01 is 0x71300210, expected 0x71300110" in status.reason
