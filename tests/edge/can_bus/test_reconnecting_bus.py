"""A bus that goes and comes back, in virtual time, over a driver that does as it is told; the hub's and the
kernel's are in test_daemon.py and tests/kernel."""

from __future__ import annotations

import errno

import can
import pytest

from palpate_edge.can_bus.bus import Bus, BusConfig
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.can_bus.link import CAN_ERR_BUSOFF, CAN_ERR_CRTL, CAN_ERR_RESTARTED, Marks
from palpate_edge.can_bus.python_can_link import PythonCanLink
from palpate_edge.can_bus.reconnecting_bus import BusState, ReconnectingBus
from palpate_edge.common.errors import BusError

TPDO, EMCY, SDO = CanFrame(0x190, b"\x01"), CanFrame(0x090, bytes(8)), CanFrame(0x590, bytes(8))


class Driver(can.BusABC):
    """What the wire did, to be received; what was sent; a code that send raises with."""

    def __init__(self):
        self.arriving = []
        self.sent = []
        self.refuses = None
        super().__init__(channel="driver")

    def send(self, msg, timeout=None):  # noqa: ARG002
        if self.refuses is not None:
            raise can.CanOperationError("refused", self.refuses)
        self.sent.append(msg.arbitration_id)

    def _recv_internal(self, timeout):  # noqa: ARG002
        if not self.arriving:
            return None, False
        one = self.arriving.pop(0)
        if isinstance(one, Exception):
            raise one
        return one, False

    def fileno(self):
        return 0


def error_frame(kind, status=0):
    return can.Message(arbitration_id=kind, is_error_frame=True, data=bytes([0, status]) + bytes(6))


def message(can_id, data=b"", **marks):
    return can.Message(arbitration_id=can_id, data=data, is_extended_id=False, **marks)


class Rig:
    """A link and the drivers it has opened; None in `to_open` refuses to open."""

    marks = Marks.MACHINE

    def __init__(self, *to_open):
        self.opened_at = []
        self.now_us = 0
        self.drivers = [Driver()]
        self.to_open = [self.drivers[0], *to_open]
        self.link = ReconnectingBus(self.open_one)

    def open_one(self):
        self.opened_at.append(self.now_us)
        driver = self.to_open.pop(0) if self.to_open else Driver()
        if driver is None:
            raise BusError("no such device")
        self.drivers.append(driver)
        return Bus(PythonCanLink(driver, self.marks), BusConfig(), "finger-1")

    def turn(self, at_us, *frames):
        self.now_us = at_us
        self.link.poll(at_us)
        received = self.link.receive(at_us)
        self.link.send(at_us, frames)
        return [frame.can_id for _, frame in received]


@pytest.fixture
def rig():
    return Rig()


def gone():
    return can.CanOperationError("Network is down", errno.ENETDOWN)


def test_a_bus_that_goes_is_opened_again_with_growing_pauses():
    rig = Rig(None, None, None, None, None, None, None)
    rig.drivers[0].arriving = [message(0x80), gone()]
    assert rig.turn(1_000) == [0x80]
    rig.turn(2_000)
    assert rig.link.state is BusState.DOWN
    assert rig.link.descriptor() is None
    for at_us in range(3_000, 20_000_000, 1_000):
        rig.turn(at_us, TPDO, SDO)
    pauses = [round((b - a) / 1000) for a, b in zip(rig.opened_at[1:], rig.opened_at[2:], strict=False)]
    assert pauses == [200, 400, 500, 500, 500, 500, 500]
    assert rig.opened_at[1] == 102_000  # the first attempt is a tenth of a second after it went
    assert rig.link.state is BusState.UP
    changes = rig.link.changes()
    assert [(change.state, change.after_bus_off) for change in changes] == [
        (BusState.DOWN, False),
        (BusState.UP, False),
    ]
    assert "Network is down" in changes[0].reason
    assert rig.link.changes() == []
    assert rig.link.restarts == 1


@pytest.mark.parametrize("back_us", range(60_000_000, 62_000_000, 400_000))
def test_after_a_minute_without_a_link_the_bus_is_up_within_half_a_second(back_us):
    """The contacts of 30 frames a second are then on the bus again within a second."""
    rig = Rig(*[None] * 1000)
    rig.drivers[0].arriving = [gone()]
    for at_us in range(0, 64_000_000, 10_000):
        if at_us >= back_us:
            rig.to_open.clear()  # the link is there: an attempt succeeds
        rig.turn(at_us)
        if at_us > back_us and rig.link.state is BusState.UP:
            break
    assert rig.link.state is BusState.UP
    assert at_us - back_us <= 510_000


def test_a_link_that_opens_and_carries_nothing_is_not_back():
    down = Driver()
    down.arriving = [gone()]
    rig = Rig(down)
    rig.drivers[0].arriving = [gone()]
    rig.turn(0)
    rig.turn(150_000)
    assert rig.link.state is BusState.DOWN
    rig.turn(400_000)
    assert rig.link.state is BusState.UP


def test_emergencies_of_the_outage_are_sent_when_it_is_back_and_nothing_else():
    rig = Rig()
    rig.drivers[0].arriving = [gone()]
    rig.turn(0)
    rig.turn(1_000, TPDO, EMCY, SDO, CanFrame(0x710))
    rig.turn(200_000)
    rig.turn(201_000)
    assert rig.drivers[-1].sent == [0x090]


def test_sending_notices_as_well(rig):
    rig.drivers[0].refuses = errno.ENETDOWN
    rig.turn(0, TPDO)
    assert rig.link.state is BusState.DOWN


@pytest.mark.parametrize("sign", ["restarted", "a frame"])
def test_bus_off_waits_for_the_controller_and_keeps_the_socket(rig, sign):
    driver = rig.drivers[0]
    driver.arriving = [error_frame(CAN_ERR_BUSOFF)]
    rig.turn(0)
    assert rig.link.state is BusState.BUS_OFF
    rig.turn(1_000, TPDO, EMCY)
    rig.turn(5_000_000, TPDO)
    assert driver.sent == []
    driver.arriving = [error_frame(CAN_ERR_RESTARTED) if sign == "restarted" else message(0x80)]
    rig.turn(5_001_000)
    rig.turn(5_002_000, SDO)
    assert driver.sent == [0x090, 0x590]
    assert [(one.state, one.after_bus_off) for one in rig.link.changes()] == [
        (BusState.BUS_OFF, True),
        (BusState.UP, True),
    ]
    assert len(rig.opened_at) == 1


def test_each_bus_off_waits_for_its_own_restart(rig):
    rig.drivers[0].arriving = [error_frame(CAN_ERR_RESTARTED)]  # of one that was missed
    rig.turn(0)
    rig.drivers[0].arriving = [error_frame(CAN_ERR_BUSOFF)]
    rig.turn(1_000)
    rig.turn(2_000)
    assert rig.link.state is BusState.BUS_OFF


def test_a_bus_off_that_ends_with_the_link_taken_down_is_still_a_bus_off(rig):
    rig.drivers[0].arriving = [error_frame(CAN_ERR_BUSOFF)]
    rig.turn(0)
    rig.drivers[0].arriving = [gone()]
    rig.turn(1_000)
    rig.turn(200_000)
    assert rig.link.changes()[-1].state is BusState.UP
    assert rig.link.restarts == 1


def test_a_full_queue_is_tried_again_with_growing_pauses_and_never_waited_for(rig):
    driver = rig.drivers[0]
    driver.refuses = errno.ENOBUFS
    rig.turn(0, TPDO, EMCY)
    dues = []
    at_us = 0
    for _ in range(7):
        dues.append(rig.link.due_us - at_us)
        at_us = rig.link.due_us
        rig.turn(at_us)
    assert dues == [500, 1000, 2000, 4000, 8000, 10_000, 10_000]
    assert rig.link.state is BusState.UP
    driver.refuses = None
    rig.turn(rig.link.due_us)
    assert driver.sent == [0x190, 0x090]
    assert rig.link.due_us is None
    assert rig.link.retries == 8
    assert rig.link.dropped == 0


def test_a_second_of_a_full_queue_costs_the_oldest_contacts_alone(rig):
    driver = rig.drivers[0]
    driver.refuses = errno.ENOBUFS
    for number in range(100):
        rig.turn(10_000 * number, CanFrame(0x190, bytes([number])), *([EMCY] if number == 3 else []))
    driver.refuses = None
    rig.turn(1_000_000)
    assert driver.sent.count(0x090) == 1
    assert 8 <= driver.sent.count(0x190) <= 11  # those of the last 100 ms
    assert rig.link.dropped == 100 - driver.sent.count(0x190)


def test_error_passive_and_active_again(rig):
    rig.drivers[0].arriving = [error_frame(CAN_ERR_CRTL, 0x20)]
    rig.turn(0)
    assert rig.link.error_passive
    rig.drivers[0].arriving = [error_frame(CAN_ERR_CRTL, 0x40)]
    rig.turn(1)
    assert not rig.link.error_passive


def test_what_cannot_be_opened_at_the_start_is_refused():
    def refuse():
        raise BusError("no hub")

    with pytest.raises(BusError, match="no hub"):
        ReconnectingBus(refuse)


def test_the_descriptor_tells_that_it_is_another_one(rig):
    first = rig.link.descriptor()
    rig.drivers[0].arriving = [gone()]
    rig.turn(0)
    rig.turn(200_000)
    assert rig.link.descriptor() != first


def test_counters_add_up_over_all_openings_of_the_bus(rig):
    rig.drivers[0].arriving = [message(0x80), error_frame(CAN_ERR_CRTL, 0x01), gone()]
    rig.turn(0, TPDO)
    rig.turn(1_000)
    assert rig.link.state is BusState.DOWN
    assert (rig.link.counters.error_frames, rig.link.receive_overruns) == (1, 1)
    rig.turn(200_000)
    rig.drivers[-1].arriving = [message(0x80), error_frame(CAN_ERR_CRTL, 0x01), message(0x81)]
    before = rig.link.activity
    rig.turn(201_000, TPDO)
    counters = rig.link.counters
    assert (counters.received, counters.sent, counters.error_frames) == (3, 2, 2)
    assert rig.link.receive_overruns == counters.receive_overruns == 2
    assert rig.link.activity - before == 3


def test_a_bus_that_accepts_nothing_keeps_its_socket_and_is_told(rig):
    """20,000 answers and no one who takes them: before, the 257th closed the bus and opened it again."""
    driver = rig.drivers[0]
    driver.refuses = errno.ENOBUFS
    for number in range(200):
        rig.turn(10_000 * number, *[SDO] * 100, *([EMCY] if number == 0 else []))
    assert rig.link.state is BusState.UP and rig.link.changes() == []
    assert rig.link.is_stuck(2_000_000)
    assert not Rig().link.is_stuck(2_000_000)
    driver.refuses = None
    rig.turn(2_000_000)
    assert rig.opened_at == [0]
    assert driver.sent.count(0x090) == 1
    assert driver.sent.count(0x590) + rig.link.others_dropped == 20_000
    assert not rig.link.is_stuck(2_000_000)


OWN, OTHER = CanFrame(0x190, b"\x01"), CanFrame(0x190, b"\x02")


def reopened(marks=Marks.MACHINE):
    """A link that sent OWN twice, was lost and is open again at 200 ms; the driver behind it."""
    rig = Rig()
    rig.marks = marks
    rig.turn(0, OWN, OWN)
    rig.drivers[0].arriving = [gone()]
    rig.turn(1_000)
    rig.turn(200_000)
    assert rig.link.state is BusState.UP
    return rig, rig.drivers[-1]


@pytest.mark.parametrize("link_marks", [Marks.MACHINE, Marks.NONE])
def test_frames_of_the_former_socket_are_no_strangers_each_once(link_marks):
    """SocketCAN marks what this machine sent; slcan marks nothing."""
    rig, driver = reopened(link_marks)
    marks = {"is_rx": False} if link_marks is Marks.MACHINE else {}
    driver.arriving = [message(0x190, b"\x01", **marks) for _ in range(3)] + [
        message(0x190, b"\x02", **marks)
    ]
    assert rig.turn(210_000) == [0x190, 0x190]
    assert rig.link.counters.own_echoes == 2


def test_what_came_over_the_wire_is_never_an_own_frame():
    rig, driver = reopened()
    driver.arriving = [message(0x190, b"\x01")]
    assert rig.turn(210_000) == [0x190]


def test_an_own_frame_does_not_come_back_after_seconds():
    rig, driver = reopened()
    driver.arriving = [message(0x190, b"\x01", is_rx=False)]
    assert rig.turn(2_300_000) == [0x190]


def test_without_a_loss_no_frame_is_taken_for_an_own_one(rig):
    """A second node's heartbeat is the same frame as our own."""
    rig.turn(0, CanFrame(0x710, b"\x05"))
    rig.drivers[0].arriving = [message(0x710, b"\x05", is_rx=False)]
    assert rig.turn(1_000) == [0x710]
