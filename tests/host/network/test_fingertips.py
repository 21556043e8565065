"""Triples of TPDO 1-3: units, coherence under every fault of a bus, clocks."""

import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.errors import BusError
from palpate_host.control.object_orientation import contact_normal
from palpate_host.network.fingertips import Fingertip, unwrap_us

NODE = 0x10
START_US = 1_700_000_000_000_000
PERIOD_US = 33_333


def parts(sequence, exposed_us, mark, latency_us=40_000, flags=5):
    """The three payloads, packed by hand after the documented layout; `mark` goes into TPDO 1 and TPDO 2."""
    return [
        CanFrame(0x180 + NODE, struct.pack("<hhhh", mark, -250, 2990, 1234)),
        CanFrame(0x280 + NODE, struct.pack("<hhhBB", mark, -20, 345, flags, 200)),
        CanFrame(0x380 + NODE, struct.pack("<IHH", exposed_us & 0xFFFFFFFF, sequence & 0xFFFF, latency_us)),
    ]


def feed(tip, frames):
    return [contact for stamp, frame in frames if (contact := tip.receive(stamp, frame)) is not None]


def stream(count, first_sequence=0):
    """Frames as a node sends them: (stamp, frame), the mark is the count."""
    frames = []
    for i in range(count):
        exposed_us = START_US + i * PERIOD_US
        for k, frame in enumerate(parts(first_sequence + i, exposed_us, i)):
            frames.append((exposed_us + 40_000 + 120 * k, frame))
    return frames


def test_units_are_those_of_the_document():
    tip = Fingertip(NODE, "finger-1")
    (contact,) = feed(tip, stream(1, first_sequence=7))
    assert contact.position_mm == (0.0, -2.5, 29.9)
    assert contact.normal_force_N == 1.234
    assert contact.shear_N == (0.0, -0.02)
    assert contact.torsion_Nmm == 3.45
    assert (contact.valid, contact.in_contact, contact.slip, contact.quality) == (True, True, False, 200)
    assert (contact.sequence, contact.latency_us, contact.exposed_at_us) == (7, 40_000, START_US)


def test_contact_without_valid_is_no_contact():
    tip = Fingertip(NODE, "finger-1")
    (contact,) = feed(tip, [(START_US + 40_000 + i, f) for i, f in enumerate(parts(0, START_US, 0, flags=1))])
    assert not contact.valid and not contact.in_contact


@pytest.mark.parametrize(
    ("flags", "slip", "begins"), [(5, False, False), (7, True, False), (37, False, True)]
)
def test_slip_and_its_onset_are_two_flags(flags, slip, begins):
    frames = parts(0, START_US, 0, flags=flags)
    (contact,) = feed(Fingertip(NODE, "finger-1"), [(START_US + 40_000 + i, f) for i, f in enumerate(frames)])
    assert (contact.slip, contact.slip_begins) == (slip, begins)


@pytest.mark.parametrize("number", [1, 2, 3])
def test_wrong_length_names_node_pdo_and_lengths(number):
    tip = Fingertip(NODE, "finger-1")
    with pytest.raises(BusError, match=f"node 16 TPDO {number}: 3 bytes, expected 8: .*EDS") as caught:
        tip.receive(START_US, CanFrame(0x180 + NODE + 0x100 * (number - 1), b"abc"))
    assert "\n" not in str(caught.value)


def test_a_delayed_part_3_never_joins_the_next_frame():
    tip = Fingertip(NODE, "finger-1")
    frames = stream(4)
    late_stamp, late = frames.pop(5)  # part 3 of frame 1 arrives between parts 2 and 3 of frame 2
    frames.insert(7, (frames[6][0] + 10, late))
    assert late_stamp < frames[7][0]
    marks = [(c.sequence, round(c.position_mm[0] * 100)) for c in feed(tip, frames)]
    assert marks == [(0, 0), (3, 3)]
    assert tip.counters.late == 1 and tip.counters.incomplete == 1 and tip.counters.out_of_order == 1
    assert tip.counters.lost_frames == 2


def test_duplicates_are_counted_and_harmless():
    tip = Fingertip(NODE, "finger-1")
    doubled = [item for item in stream(3) for _ in range(2)]
    assert len(feed(tip, doubled)) == 3
    assert tip.counters.duplicates == 9 and tip.counters.lost_frames == 0


def test_sequence_wraps():
    tip = Fingertip(NODE, "finger-1")
    assert [c.sequence for c in feed(tip, stream(4, first_sequence=0xFFFE))] == [0xFFFE, 0xFFFF, 0, 1]
    assert tip.counters.lost_frames == 0


def test_a_node_that_counts_anew_is_taken_up_again():
    tip = Fingertip(NODE, "finger-1")
    feed(tip, stream(3, first_sequence=1000))
    later = [(stamp + 1_000_000, frame) for stamp, frame in stream(8)]
    assert len(feed(tip, later)) == 4
    assert tip.counters.resynchronised == 1
    tip.forget()  # its boot-up was seen
    assert len(feed(tip, [(stamp + 2_000_000, frame) for stamp, frame in stream(3)])) == 3


def test_a_late_first_part_does_not_stand_in_for_a_lost_one():
    """TPDO 1 of frame 8 comes 57 ms late, 10 ms before frame 10 is published, whose own TPDO 1 is lost."""
    tip = Fingertip(NODE, "finger-1")
    frames = stream(12)
    stamp, first_of_8 = frames[8 * 3]
    del frames[10 * 3], frames[8 * 3]
    contacts = feed(tip, sorted([*frames, (stamp + 56_906, first_of_8)], key=lambda item: item[0]))
    assert [contact.sequence for contact in contacts] == [0, 1, 2, 3, 4, 5, 6, 7, 9, 11]


faults = st.lists(
    st.tuples(st.sampled_from(["keep", "keep", "keep", "drop", "double"]), st.integers(0, 60_000)),
    min_size=36,
    max_size=36,
)


@pytest.mark.long
@settings(max_examples=200, deadline=None)
@given(faults, st.booleans())
def test_no_fault_of_the_bus_mixes_two_frames(plan, delays):
    """Dropped, doubled and (with `delays`) late parts: every contact is whole, of one frame, in order."""
    tip = Fingertip(NODE, "finger-1")
    arriving = []
    for (stamp, frame), (fate, delay_us) in zip(stream(12), plan, strict=True):
        if fate != "drop":
            arriving.append((stamp + (delay_us if delays and delay_us > 50_000 else 0), frame))
        if fate == "double":
            arriving.append((stamp + 50, frame))
    contacts = feed(tip, sorted(arriving, key=lambda item: item[0]))
    for contact in contacts:
        mark = round(contact.position_mm[0] * 100)
        assert mark == round(contact.shear_N[0] * 1000) == contact.sequence
    sequences = [contact.sequence for contact in contacts]
    assert sequences == sorted(set(sequences))
    assert tip.counters.complete == len(contacts)


@given(st.integers(0, 2**53), st.integers(-(2**31) + 1, 2**31 - 1))
def test_bus_clock_unwraps_to_the_nearest_time(near_us, ahead_us):
    assert unwrap_us((near_us + ahead_us) % 2**32, near_us) == near_us + ahead_us


def test_normal_points_from_the_contact_to_the_centre(table_4):
    pose = table_4[1].pose(np.tile([0.0, 0.348, 1.221], 3))
    # An apex contact in the start pose: the dome looks inwards, so the normal points outwards.
    normal = contact_normal(pose, 1, (0.0, 0.0, 30.0))
    outwards = pose.tip_centre_m[1] * [1, 1, 0]
    np.testing.assert_allclose(normal, outwards / np.linalg.norm(outwards), atol=2e-3)
    assert contact_normal(pose, 1, (0.0, 0.0, 0.0)) is None
