"""TPDO 5, the further quantities: part of the set of a node that sends it, unknown to one that does not."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.errors import BusError
from palpate_host.common.tip_contact import TipContact
from palpate_host.network.fingertips import Fingertip

NODE = 0x10
START_US = 1_700_000_000_000_000
PERIOD_US = 33_333
NOT_GIVEN = -0x8000
Arriving = list[tuple[int, CanFrame]]


def parts(sequence: int, exposed_us: int, mark: int, radius: int | None) -> list[CanFrame]:
    """Return the payloads of a frame in the order of the bus, packed by hand; radius None: no TPDO 5.

    `mark` goes into TPDO 1 and TPDO 2.
    """
    clock = exposed_us & 0xFFFF_FFFF
    frames = [
        CanFrame(0x180 + NODE, struct.pack("<hhhh", mark, -250, 2990, 1234)),
        CanFrame(0x280 + NODE, struct.pack("<hhhBB", mark, -20, 345, 5, 200)),
        CanFrame(0x380 + NODE, struct.pack("<IHH", clock, sequence & 0xFFFF, 40_000)),
    ]
    if radius is not None:
        frames.insert(
            2, CanFrame(0x300 + NODE, struct.pack("<Hhhh", sequence & 0xFFFF, radius, 25, NOT_GIVEN))
        )
    return frames


def frame(number: int, radius: int | None = 42, sequence: int | None = None) -> Arriving:
    """Return frame `number` of a stream as it arrives."""
    exposed_us = START_US + number * PERIOD_US
    sent = parts(number if sequence is None else sequence, exposed_us, number, radius)
    return [(exposed_us + 40_000 + 100 * place, part) for place, part in enumerate(sent)]


def feed(tip: Fingertip, arriving: Arriving) -> list[TipContact]:
    return [contact for stamp, part in arriving if (contact := tip.receive(stamp, part)) is not None]


def stream(*frames: Arriving) -> Arriving:
    return [item for one in frames for item in one]


def test_the_radius_comes_with_its_contact() -> None:
    tip = Fingertip(NODE, "finger-1")
    contacts = feed(tip, stream(frame(0, 42), frame(1, 1234), frame(2, NOT_GIVEN)))
    assert [contact.radius95_mm for contact in contacts] == [0.42, 12.34, None]
    assert [contact.torsion_Nmm for contact in contacts] == [3.45] * 3
    assert [(contact.torsion95_Nmm, contact.force95_N) for contact in contacts] == [(0.25, None)] * 3
    assert tip.counters.extra_tpdos == tip.counters.complete == 3


def test_a_node_without_tpdo_5_gives_whole_contacts() -> None:
    tip = Fingertip(NODE, "finger-1")
    contacts = feed(tip, stream(*(frame(number, None) for number in range(20))))
    assert len(contacts) == 20
    assert {contact.radius95_mm for contact in contacts} == {None}
    assert (tip.counters.extra_tpdos, tip.counters.extra_missing, tip.counters.lost_frames) == (0, 0, 0)


def test_a_lost_tpdo_5_costs_its_contact_and_no_other() -> None:
    tip = Fingertip(NODE, "finger-1")
    contacts = feed(tip, stream(frame(0), frame(1), frame(2, None), frame(3)))
    assert [contact.sequence for contact in contacts] == [0, 1, 3]
    assert {contact.radius95_mm for contact in contacts} == {0.42}
    assert (tip.counters.extra_missing, tip.counters.lost_frames) == (1, 1)


def test_a_tpdo_5_that_was_disabled_is_missed_four_times() -> None:
    """1804h:01 bit 31: the host does without it from the fifth contact on, and takes it up again."""
    tip = Fingertip(NODE, "finger-1")
    without = [frame(number, None) for number in range(2, 12)]
    contacts = feed(tip, stream(frame(0), frame(1), *without, frame(12), frame(13)))
    assert [contact.sequence for contact in contacts] == [0, 1, *range(6, 14)]
    assert [contact.radius95_mm for contact in contacts] == [0.42, 0.42, *[None] * 6, 0.42, 0.42]
    assert tip.counters.extra_missing == 4


def test_a_boot_makes_it_unknown_whether_the_node_sends_it() -> None:
    tip = Fingertip(NODE, "finger-1")
    feed(tip, stream(frame(0), frame(1)))
    tip.forget()
    assert len(feed(tip, stream(frame(2, None, sequence=0), frame(3, None, sequence=1)))) == 2
    assert tip.counters.extra_missing == 0


def test_a_tpdo_5_of_the_frame_before_is_never_taken() -> None:
    """TPDO 5 of frame 1 comes a frame late, where that of frame 2 was lost."""
    tip = Fingertip(NODE, "finger-1")
    first, second, third = frame(1, 11), frame(2, 22), frame(3, 33)
    late = (second[2][0], first.pop(2)[1])
    second[2] = late
    contacts = feed(tip, stream(frame(0), first, second, third))
    assert [(contact.sequence, contact.radius95_mm) for contact in contacts] == [(0, 0.42), (3, 0.33)]
    assert (tip.counters.extra_missing, tip.counters.extra_mixed) == (1, 1)


def test_two_tpdo_5_in_one_set_spoil_it() -> None:
    tip = Fingertip(NODE, "finger-1")
    spoiled = frame(1)
    stamp_us, part = spoiled[2]
    spoiled.insert(3, (stamp_us + 1, CanFrame(part.can_id, struct.pack("<Hhhh", 9, 9, 9, 9))))
    contacts = feed(tip, stream(frame(0), spoiled, frame(2)))
    assert [contact.sequence for contact in contacts] == [0, 2]
    assert tip.counters.out_of_order == 2  # the second TPDO 5, and then TPDO 3 without a set


def test_a_node_that_sends_it_last_gives_contacts_without_radius() -> None:
    """Another maker's node may send its TPDOs in the order of their numbers."""
    tip = Fingertip(NODE, "finger-1")
    arriving = []
    for number in range(8):
        one = frame(number)
        arriving += [*one[:2], one[3], (one[3][0] + 100, one[2][1])]
    contacts = feed(tip, arriving)
    assert [contact.sequence for contact in contacts] == list(range(8))
    assert {contact.radius95_mm for contact in contacts} == {None}
    assert tip.counters.out_of_order == 8


def test_two_devices_that_mix_their_tpdo_5_are_found() -> None:
    tip = Fingertip(NODE, "finger-1")
    with pytest.raises(BusError, match="two devices send as node 0x10"):
        for number in range(20):
            mixed = frame(number)
            mixed[2] = (mixed[2][0], CanFrame(0x300 + NODE, struct.pack("<Hhhh", 500 + number, 7, 7, 7)))
            feed(tip, mixed)


def test_a_wrong_length_names_node_pdo_and_lengths() -> None:
    tip = Fingertip(NODE, "finger-1")
    with pytest.raises(BusError, match=r"node 16 TPDO 5: 4 bytes, expected 8: .*EDS"):
        tip.receive(START_US, CanFrame(0x300 + NODE, bytes(4)))


FATES = st.lists(
    st.tuples(st.sampled_from(["keep", "keep", "keep", "drop", "double"]), st.integers(0, 60_000)),
    min_size=48,
    max_size=48,
)


@pytest.mark.long
@settings(max_examples=300, deadline=None)
@given(FATES, st.booleans())
def test_no_fault_of_the_bus_gives_a_contact_another_frames_radius(
    plan: list[tuple[str, int]], delays: bool
) -> None:
    """Dropped, doubled and (with `delays`) late parts; the radius carries the frame's number."""
    tip = Fingertip(NODE, "finger-1")
    arriving: Arriving = []
    sent = stream(*(frame(number, radius=number) for number in range(12)))
    for (stamp, part), (fate, delay_us) in zip(sent, plan, strict=True):
        if fate != "drop":
            arriving.append((stamp + (delay_us if delays and delay_us > 50_000 else 0), part))
        if fate == "double":
            arriving.append((stamp + 50, part))
    learnt = False
    for contact in feed(tip, sorted(arriving, key=lambda item: item[0])):
        mark = round(contact.position_mm[0] * 100)
        assert mark == round(contact.shear_N[0] * 1000) == contact.sequence
        assert contact.radius95_mm in (None, contact.sequence / 100)
        if contact.radius95_mm is None and learnt:
            assert tip.counters.extra_missing >= 4
        learnt = learnt or contact.radius95_mm is not None
