"""From a contact to the objects of the fingertip: units, frame F, doubt and saturation."""

from __future__ import annotations

import math
import struct
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate_bus.decode.device import Device
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.can_bus.clock_sync import ClockState
from palpate_edge.common.contact import Contact
from palpate_edge.node.eds import load_eds
from palpate_edge.node.fingertip import FingertipNode
from palpate_edge.node.fingertip_objects import (
    ChannelStatus,
    ContactFlag,
    Counter,
    Health,
    encode_contact,
    encode_health,
)
from palpate_edge.node.parsed_eds import FINGERTIP_EDS

OD = load_eds(FINGERTIP_EDS, 0x10)
ANY_FLOAT = st.floats() | st.none()
VECTORS = st.none() | st.tuples(st.floats(), st.floats(), st.floats())

# At (0, 9, 12) mm the outward normal is (0, 0.6, 0.8); 2 N inwards along it and 0.5 N along +x.
TOUCH = Contact(
    sequence=70_000,
    exposed_at_us=2**32 + 5,
    valid=True,
    in_contact=True,
    position_mm=(0.0, 9.0, 12.0),
    normal_force_N=2.0,
    force_N=(0.5, -1.2, -1.6),
    torsion_Nmm=-3.25,
    radius95_mm=0.42,
    quality=0.5,
    reason="",
    beads_found=28,
    beads_expected=31,
)


def inputs(contact: Contact) -> list[int]:
    objects = encode_contact(contact, 0)
    return [objects[0x7130, channel] for channel in range(1, 9)]


def status(contact: Contact) -> list[int]:
    objects = encode_contact(contact, 0)
    return [objects[0x6150, channel] for channel in range(1, 9)]


def flags(contact: Contact) -> int:
    return encode_contact(contact, 0)[0x2010, 0]


def test_a_touch_in_its_units() -> None:
    assert inputs(TOUCH) == [0, 900, 1200, 2000, 500, 0, -325, 42]
    assert status(TOUCH) == [0] * 8
    assert flags(TOUCH) == ContactFlag.VALID | ContactFlag.CONTACT
    objects = encode_contact(TOUCH, 12_345)
    assert objects[0x2011, 0] == 128
    assert objects[0x2012, 0] == 5
    assert objects[0x2013, 0] == 70_000 - 65_536
    assert objects[0x2014, 0] == 12_345
    assert objects[0x2021, 0] == 3


def test_shear_is_the_part_across_the_normal() -> None:
    """(0, 1, 0) N on the normal (0, 0.6, 0.8): 0.6 N along it, (0, 0.64, -0.48) N across it."""
    assert inputs(replace(TOUCH, force_N=(0.0, 1.0, 0.0)))[4:6] == [0, 640]


def test_nothing_touches() -> None:
    free = replace(
        TOUCH, in_contact=False, position_mm=None, force_N=None, torsion_Nmm=None, radius95_mm=None
    )
    assert inputs(free) == [0] * 6 + [-0x8000] * 2  # torsion and radius: not given, which is no zero
    assert status(free) == [0] * 6 + [ChannelStatus.NOT_VALID] * 2
    assert flags(free) == ContactFlag.VALID


def test_slip_goes_only_with_a_contact() -> None:
    assert flags(replace(TOUCH, slip=True)) == ContactFlag.VALID | ContactFlag.CONTACT | ContactFlag.SLIP
    assert flags(replace(TOUCH, slip=True, in_contact=False)) == ContactFlag.VALID
    assert flags(replace(TOUCH, slip=True, valid=False)) == 0


def test_the_onset_of_slip_has_a_flag_of_its_own() -> None:
    begins = replace(TOUCH, slip_begins=True)
    both = ContactFlag.VALID | ContactFlag.CONTACT
    assert flags(begins) == both | ContactFlag.SLIP_BEGINS
    assert flags(replace(begins, slip=True)) == both | ContactFlag.SLIP | ContactFlag.SLIP_BEGINS
    assert flags(replace(begins, in_contact=False)) == ContactFlag.VALID
    assert flags(replace(begins, valid=False)) == 0


def test_a_refused_frame_is_not_valid_and_touches_nothing() -> None:
    refused = replace(TOUCH, valid=False, reason="too few beads")
    assert inputs(refused) == [0] * 6 + [-0x8000] * 2  # torsion and radius: not given, which is no zero
    assert status(refused) == [ChannelStatus.NOT_VALID] * 8
    assert flags(refused) == 0
    assert encode_contact(refused, 0)[0x2011, 0] == 0


def test_what_a_method_does_not_give_is_not_in_doubt() -> None:
    plain = replace(TOUCH, force_N=None, torsion_Nmm=None, radius95_mm=None)
    assert status(plain) == [0, 0, 0, 0] + [ChannelStatus.NOT_VALID] * 4
    assert flags(plain) == ContactFlag.VALID | ContactFlag.CONTACT


@pytest.mark.parametrize(
    "doubtful",
    [
        replace(TOUCH, position_mm=None),
        replace(TOUCH, normal_force_N=None),
        replace(TOUCH, position_mm=(0.0, math.nan, 1.0)),
        replace(TOUCH, torsion_Nmm=math.inf),
        replace(TOUCH, quality=math.nan),
        replace(TOUCH, position_mm=(0.0, 0.0, 0.0)),
    ],
    ids=["no position", "no force", "position NaN", "torsion infinite", "quality NaN", "centre"],
)
def test_doubt_clears_the_flags(doubtful: Contact) -> None:
    assert flags(doubtful) == 0


@pytest.mark.parametrize(
    ("force_N", "increments", "state"),
    [
        (32.767, 32767, 0),
        (32.768, 32767, ChannelStatus.POSITIVE_OVERLOAD),
        (1e300, 32767, ChannelStatus.POSITIVE_OVERLOAD),
        (-32.767, -32767, 0),
        (-32.768, -32767, ChannelStatus.NEGATIVE_OVERLOAD),  # -32768 is no measured value
    ],
)
def test_saturation_clears_the_valid_flag(force_N: float, increments: int, state: int) -> None:
    contact = replace(TOUCH, normal_force_N=force_N)
    assert inputs(contact)[3] == increments
    assert status(contact)[3] == state
    assert bool(flags(contact) & ContactFlag.VALID) is (state == 0)


@given(
    st.builds(
        Contact,
        sequence=st.integers(),
        exposed_at_us=st.integers(),
        valid=st.booleans(),
        in_contact=st.booleans(),
        position_mm=VECTORS,
        normal_force_N=ANY_FLOAT,
        force_N=VECTORS,
        torsion_Nmm=ANY_FLOAT,
        radius95_mm=ANY_FLOAT,
        quality=st.floats(),
        reason=st.just(""),
        beads_found=st.integers(),
        beads_expected=st.integers(),
    ),
    st.integers(),
)
def test_any_contact_fits_the_objects(contact: Contact, latency_us: int) -> None:
    objects = encode_contact(contact, latency_us)
    for (index, subindex), value in objects.items():
        OD.entry(index, subindex).encode(value)
    if not contact.valid:
        assert objects[0x2010, 0] == 0


@given(st.builds(Health, st.none() | st.floats(), st.integers(), st.integers(), st.floats(0, None)))
def test_any_health_fits_the_objects(health: Health) -> None:
    for (index, subindex), value in encode_health(health).items():
        OD.entry(index, subindex).encode(value)


def test_health_in_its_units() -> None:
    counters = {Counter.TRANSMIT_RETRIES: 4, Counter.RECEIVE_OVERRUNS: 2**32 + 5}
    health = Health(36.64, 70_000, 200, 1.234, 4_900, counters)
    assert encode_health(health) == {
        (0x2020, 0): 366,
        (0x2022, 0): 65535,
        (0x2023, 0): 200,
        (0x2024, 0): 123,
        (0x2031, 0): 4_900,
        (0x2041, 3): 70_000,
        (0x2041, 5): 4,
        (0x2041, 8): 5,
    }
    assert encode_health(Health(None, 0, 0))[0x2020, 0] == 0x7FFF
    assert encode_health(Health(1e9, 0, 0))[0x2020, 0] == 0x7FFE


def test_a_contact_goes_out_in_order_of_identifiers_and_health_every_second(fingertip: FingertipNode) -> None:
    fingertip.process(0, (CanFrame(0x000, b"\x01\x00"),))
    fingertip.publish(TOUCH, 0x0102)
    fingertip.report_health(Health(25.0, 1, 2))
    assert fingertip.process(1, ()).frames_out == (
        CanFrame(0x190, bytes.fromhex("00 00 84 03 b0 04 d0 07")),
        CanFrame(0x290, bytes.fromhex("f4 01 00 00 bb fe 05 80")),
        CanFrame(0x310, bytes.fromhex("70 11 2a 00 00 80 00 80")),
        CanFrame(0x390, bytes.fromhex("05 00 00 00 70 11 02 01")),
    )
    after_a_second = fingertip.process(1_000_000, ()).frames_out
    assert CanFrame(0x490, bytes.fromhex("fa 00 03 00 01 00 02")) in after_a_second


def test_each_counter_has_its_sub_index_of_2041h() -> None:
    names = {entry.subindex: entry.name for entry in OD.entries.values() if entry.index == 0x2041}
    assert names.pop(0) == "Highest sub-index supported"
    assert OD.entry(0x2041).default == len(names)
    plain = {sub: name.upper().replace(" ", "_").replace("-", "_") for sub, name in names.items()}
    assert plain == {int(counter): counter.name for counter in Counter}


@pytest.mark.parametrize(
    ("state", "raw"), [(ClockState.FREE, 0), (ClockState.SYNCHRONISED, 1), (ClockState.LOST, 2)]
)
def test_the_clock_state_has_one_name_on_both_sides_of_the_bus(
    fingertip: FingertipNode, state: ClockState, raw: int
) -> None:
    fingertip.report_bus_clock(state, 1234.0, 5.0)
    assert fingertip.slave.read(0x2042, 1) == raw
    device = Device(0x10, "finger-1", FINGERTIP_EDS)
    assert device.reading((0x2042, 1), bytes([raw])).text == f"{raw} ({state.value})"
    assert device.reading((0x2042, 2), struct.pack("<i", 1234)).text == "1.234 ppm"


def test_the_eds_describes_every_contact_flag() -> None:
    before, _, _ = FINGERTIP_EDS.read_text().partition("[2010]")
    comment = before.rsplit("\n\n", 1)[1]
    for flag in ContactFlag:
        assert f"bit {int(flag).bit_length() - 1} " in comment.lower()
