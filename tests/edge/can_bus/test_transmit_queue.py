"""The queue of frames for a full controller is bounded; the oldest frame is dropped first, an EMCY last."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.can_bus.transmit_queue import MAX_OTHERS, MAX_PDO_AGE_US, MAX_PDOS, TransmitQueue

EMCY, SDO, HEARTBEAT = CanFrame(0x090), CanFrame(0x590), CanFrame(0x710)


def tpdo(number):
    return CanFrame(0x190, number.to_bytes(2, "little"))


def all_of(queue, now_us=0):
    frames = queue.fresh(now_us)
    queue.sent(len(frames))
    assert queue.fresh(now_us) == []
    return frames


def test_in_order():
    queue = TransmitQueue()
    queue.put(0, [tpdo(1), EMCY, tpdo(2), SDO])
    assert all_of(queue) == [tpdo(1), EMCY, tpdo(2), SDO]


def test_the_oldest_contacts_give_way():
    queue = TransmitQueue()
    queue.put(0, [EMCY, SDO, HEARTBEAT])
    for number in range(MAX_PDOS + 5):
        queue.put(0, [tpdo(number)])
    assert queue.dropped == 5
    assert all_of(queue) == [EMCY, SDO, HEARTBEAT, *(tpdo(n) for n in range(5, MAX_PDOS + 5))]


def test_contacts_that_waited_too_long_are_not_sent():
    queue = TransmitQueue()
    queue.put(0, [tpdo(1), EMCY])
    queue.put(MAX_PDO_AGE_US, [tpdo(2)])
    assert all_of(queue, MAX_PDO_AGE_US + 1) == [EMCY, tpdo(2)]
    assert queue.dropped == 1


def test_answers_that_nobody_takes_give_way_oldest_first_and_emergencies_last():
    queue = TransmitQueue()
    answers = [CanFrame(0x590, number.to_bytes(2, "little")) for number in range(2 * MAX_OTHERS)]
    queue.put(0, [EMCY, tpdo(1), *answers])
    assert all_of(queue) == [EMCY, tpdo(1), *answers[-MAX_OTHERS + 1 :]]
    assert (queue.dropped, queue.others_dropped) == (0, MAX_OTHERS + 1)


def test_emergencies_that_nobody_takes_are_bounded_too():
    queue = TransmitQueue()
    queue.put(0, [CanFrame(0x090, number.to_bytes(2, "little")) for number in range(MAX_OTHERS + 7)])
    assert len(queue) == MAX_OTHERS
    assert all_of(queue)[0].data == b"\x07\x00"


def test_when_the_bus_is_gone_emergencies_stay():
    queue = TransmitQueue()
    queue.put(0, [tpdo(1), EMCY, SDO, HEARTBEAT, CanFrame(0x081)])
    queue.keep_emergencies()
    assert all_of(queue) == [EMCY, CanFrame(0x081)]
    assert queue.dropped == 1


@given(st.lists(st.lists(st.sampled_from([EMCY, SDO, tpdo(1)]), max_size=20), max_size=30), st.integers(0, 9))
def test_every_frame_is_sent_once_or_counted_as_dropped(batches, taken_each_time):
    queue, put, taken = TransmitQueue(), [], []
    for batch in batches:
        put += batch
        queue.put(0, batch)
        some = queue.fresh(0)[:taken_each_time]
        taken += some
        queue.sent(len(some))
        assert sum(frame == tpdo(1) for frame in put) - queue.dropped - taken.count(tpdo(1)) <= MAX_PDOS
    taken += all_of(queue)
    others = [frame for frame in put if frame in (EMCY, SDO)]
    assert taken.count(EMCY) + taken.count(SDO) + queue.others_dropped == len(others)
    if len(others) <= MAX_OTHERS:
        assert queue.others_dropped == 0
    assert taken.count(tpdo(1)) + queue.dropped == put.count(tpdo(1))
