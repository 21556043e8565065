"""Arbitration, bit time, filters and queues of the pure wire."""

from __future__ import annotations

import itertools

from hypothesis import given
from hypothesis import strategies as st

from palpate_bus.hub.wire import Submitted, Wire
from palpate_bus.load.bit_count import frame_bits
from palpate_edge.can_bus.can_frame import CanFrame


def arbitrate_bit_by_bit(frames: list[CanFrame]) -> int:
    """The standard's own words: every sender puts its bits on the wire, a dominant 0 beats a recessive 1, and
    who reads another level than it sent falls silent. Returns the index of the sender left over (the first,
    if several send the same bits)."""
    contenders = list(range(len(frames)))
    streams = [f"{frame.can_id:011b}{int(frame.remote)}" for frame in frames]
    for place in range(12):
        level = min(streams[sender][place] for sender in contenders)
        contenders = [sender for sender in contenders if streams[sender][place] == level]
    return contenders[0]


QUEUES = st.lists(
    st.lists(st.builds(CanFrame, can_id=st.integers(0, 0x7FF), remote=st.booleans()), max_size=5),
    min_size=1,
    max_size=6,
)


@given(QUEUES, st.sampled_from([0, 125_000, 1_000_000]))
def test_pending_frames_leave_in_the_order_of_bitwise_arbitration(queues, bitrate):
    wire = Wire(bitrate, txqueuelen=5)
    ports = [wire.attach(receive_own=False) for _ in queues]
    for port, queue in zip(ports, queues, strict=True):
        for frame in queue:
            assert wire.submit(port, frame, now_us=0) is Submitted.QUEUED
    expected = []
    waiting = {port: list(queue) for port, queue in zip(ports, queues, strict=True) if queue}
    while waiting:
        senders = list(waiting)
        winner = senders[arbitrate_bit_by_bit([waiting[sender][0] for sender in senders])]
        expected.append((winner, waiting[winner].pop(0)))
        if not waiting[winner]:
            del waiting[winner]
    done = wire.advance(now_us=10**9)
    assert [(delivery.sender, delivery.frame) for delivery in done] == expected
    assert wire.next_due_us is None


@given(
    st.lists(st.tuples(st.integers(0, 3), st.integers(0, 0x7FF), st.integers(0, 2000)), max_size=30),
    st.sampled_from([800_000, 1_000_000]),
)
def test_no_two_frames_overlap_and_none_starts_before_it_was_sent(submissions, bitrate):
    wire = Wire(bitrate, txqueuelen=30)
    ports = [wire.attach(receive_own=False) for _ in range(4)]
    now_us = 0
    sent_at: list[tuple[int, int]] = []
    done = []
    for port, can_id, pause_us in submissions:
        now_us += pause_us
        done += wire.advance(now_us)
        wire.submit(ports[port], CanFrame(can_id), now_us)
        sent_at.append((now_us, can_id))
    done += wire.advance(now_us + 10**6)
    assert sorted(delivery.frame.can_id for delivery in done) == sorted(can_id for _, can_id in sent_at)
    for earlier, later in itertools.pairwise(done):
        assert (later.won_at_us - earlier.won_at_us) * bitrate >= frame_bits(earlier.frame) * 1_000_000
    for delivery in done:
        assert delivery.won_at_us >= min(
            time_us for time_us, can_id in sent_at if can_id == delivery.frame.can_id
        )


def test_a_frame_takes_its_bits_at_the_bit_rate():
    wire = Wire(500_000, txqueuelen=1)
    port = wire.attach(receive_own=False)
    frame = CanFrame(0x555, b"\x55" * 8)  # alternating bits: only the CRC can be stuffed
    wire.submit(port, frame, now_us=1000)
    assert wire.advance(1000) == []
    due_us = wire.next_due_us
    assert due_us is not None
    assert due_us == 1000 + 2 * frame_bits(frame)
    assert wire.advance(due_us - 1) == []
    assert [delivery.won_at_us for delivery in wire.advance(due_us)] == [1000]


def test_a_late_frame_of_high_priority_waits_for_the_end_of_the_one_on_the_wire():
    wire = Wire(1_000_000, txqueuelen=4)
    low, high = wire.attach(receive_own=False), wire.attach(receive_own=False)
    for can_id in (0x700, 0x701):
        wire.submit(low, CanFrame(can_id), now_us=0)
    wire.advance(0)
    wire.submit(high, CanFrame(0x001), now_us=20)
    assert [delivery.frame.can_id for delivery in wire.advance(10_000)] == [0x700, 0x001, 0x701]


def test_a_full_queue_refuses_and_a_copy_takes_no_place():
    wire = Wire(1_000_000, txqueuelen=2)
    port = wire.attach(receive_own=False)
    assert wire.submit(port, CanFrame(1), 0, copy=True) is Submitted.QUEUED
    assert [wire.submit(port, CanFrame(1), 0) for _ in range(3)] == [
        Submitted.QUEUED,
        Submitted.QUEUED,
        Submitted.QUEUE_FULL,
    ]
    assert len(wire.advance(10_000)) == 3


@given(st.integers(0, 0x7FF), st.lists(st.tuples(st.integers(0, 0x7FF), st.integers(0, 0x7FF)), max_size=4))
def test_filters_pass_what_equals_under_the_mask(can_id, filters):
    wire = Wire(0, txqueuelen=1)
    sender, listener, deaf, everything = (wire.attach(receive_own=False) for _ in range(4))
    wire.set_filters(listener, filters)
    wire.set_filters(everything, None)
    wire.submit(sender, CanFrame(can_id), 0)
    (delivery,) = wire.advance(0)
    assert (listener in delivery.receivers) == any(can_id & mask == want & mask for want, mask in filters)
    assert everything in delivery.receivers
    assert deaf not in delivery.receivers  # no filters set yet
    assert sender not in delivery.receivers


def test_own_frames_come_back_only_when_asked_for():
    wire = Wire(0, txqueuelen=1)
    port = wire.attach(receive_own=True)
    wire.set_filters(port, None)
    wire.submit(port, CanFrame(5), 0)
    assert wire.advance(0)[0].receivers == (port,)


def test_bus_off_empties_the_queue_refuses_and_hears_nothing_until_it_is_back():
    wire = Wire(0, txqueuelen=4)
    cut, other = wire.attach(receive_own=False), wire.attach(receive_own=False)
    wire.set_filters(cut, None)
    wire.submit(cut, CanFrame(5), 0)
    assert wire.set_bus_off(cut, True) == 1
    assert wire.submit(cut, CanFrame(5), 0) is Submitted.BUS_OFF
    wire.submit(other, CanFrame(6), 0)
    assert [delivery.receivers for delivery in wire.advance(0)] == [()]
    wire.set_bus_off(cut, False)
    wire.submit(other, CanFrame(6), 1)
    assert [delivery.receivers for delivery in wire.advance(1)] == [(cut,)]


def test_what_a_port_has_queued_goes_out_after_it_left():
    wire = Wire(1_000_000, txqueuelen=4)
    gone, stays = wire.attach(receive_own=False), wire.attach(receive_own=False)
    for can_id in (1, 2):
        wire.submit(gone, CanFrame(can_id), 0)
    wire.submit(stays, CanFrame(3), 0)
    wire.advance(0)  # 1 is on the wire
    wire.detach(gone)
    assert [delivery.frame.can_id for delivery in wire.advance(10_000)] == [1, 2, 3]
    wire.submit(stays, CanFrame(4), 20_000)
    assert [delivery.receivers for delivery in wire.advance(30_000)] == [()]
