"""palpate_edge.can_bus.bus over python-can's own interfaces: what the hub's tests do not reach."""

from __future__ import annotations

import errno
import re

import can
import msgspec
import pytest

from palpate_edge.can_bus.bus import Bus, BusConfig, open_bus
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.can_bus.python_can_link import PythonCanLink
from palpate_edge.common.errors import BusError


@pytest.fixture
def pair(request):
    """(Bus of ours, python-can bus of a stranger) on one virtual channel."""
    channel = request.node.name
    with (
        open_bus(BusConfig(interface="virtual", channel=channel), "ours", accept_ids=None) as ours,
        can.Bus(interface="virtual", channel=channel) as stranger,
    ):
        yield ours, stranger


def test_frames_cross_both_ways_with_integer_stamps(pair):
    ours, stranger = pair
    ours.send([CanFrame(0x190, b"\x01"), CanFrame(0x701, remote=True)])
    first, second = stranger.recv(5), stranger.recv(5)
    assert (first.arbitration_id, bytes(first.data), first.is_extended_id) == (0x190, b"\x01", False)
    assert (second.arbitration_id, second.is_remote_frame) == (0x701, True)
    stranger.send(can.Message(arbitration_id=0x80, is_extended_id=False, timestamp=1_700_000_000.123457))
    ((stamp_us, frame),) = ours.receive(5)
    assert frame == CanFrame(0x80)
    assert isinstance(stamp_us, int)


def test_everything_pending_is_drained_in_one_call(pair):
    ours, stranger = pair
    for can_id in range(10):
        stranger.send(can.Message(arbitration_id=can_id, is_extended_id=False))
    assert [frame.can_id for _, frame in ours.receive(5)] == list(range(10))
    assert ours.receive(0) == []


def test_strangers_frames_and_error_frames_are_counted_and_not_handed_on(pair):
    ours, stranger = pair
    stranger.send(can.Message(arbitration_id=0x12345, is_extended_id=True))
    stranger.send(can.Message(arbitration_id=0x04, is_error_frame=True, data=b"\0\x01" + bytes(6)))
    stranger.send(can.Message(arbitration_id=0x81, is_extended_id=False))
    frames = [frame for _ in range(3) for _, frame in ours.receive(0.1)]
    assert frames == [CanFrame(0x81)]
    counters = ours.counters
    assert (counters.foreign_frames, counters.error_frames, counters.receive_overruns) == (1, 1, 1)


def test_frames_before_a_bus_off_are_given_first(pair):
    ours, stranger = pair
    stranger.send(can.Message(arbitration_id=0x81, is_extended_id=False))
    stranger.send(can.Message(arbitration_id=0x40, is_error_frame=True))
    assert [frame for _, frame in ours.receive(5)] == [CanFrame(0x81)]
    with pytest.raises(BusError, match="bus-off"):
        ours.receive(5)


class Grudging(can.BusABC):
    """A driver that refuses frames, with ENOBUFS unless told; it takes `first` before that."""

    def __init__(self, refusals: int, code: int = errno.ENOBUFS, first: int = 0) -> None:
        self.refusals = refusals
        self.code = code
        self.first = first
        self.sent: list[int] = []
        super().__init__(channel="grudging")

    def send(self, msg: can.Message, timeout: float | None = None) -> None:  # noqa: ARG002
        if self.refusals and len(self.sent) >= self.first:
            self.refusals -= 1
            raise can.CanOperationError("Failed to transmit: No buffer space available", self.code)
        self.sent.append(msg.arbitration_id)


@pytest.mark.parametrize("refusals", [0, 1, 8])
def test_enobufs_is_retried(refusals):
    driver = Grudging(refusals)
    with Bus(PythonCanLink(driver), BusConfig(), "finger-1") as bus:
        bus.send([CanFrame(1), CanFrame(2)])
        assert driver.sent == [1, 2]
        assert bus.counters.send_retries == refusals


def test_enobufs_is_not_retried_for_ever():
    with (
        Bus(PythonCanLink(Grudging(9)), BusConfig(), "finger-1") as bus,
        pytest.raises(BusError, match="transmit queue full, frame 190 refused 9 times"),
    ):
        bus.send([CanFrame(0x190)])


def test_what_a_full_queue_does_not_take_is_told_at_once():
    driver = Grudging(1, first=2)
    with Bus(PythonCanLink(driver), BusConfig(), "finger-1") as bus:
        assert bus.try_send([CanFrame(1), CanFrame(2), CanFrame(3)]) == 2
        assert bus.try_send([CanFrame(3)]) == 1
        assert driver.sent == [1, 2, 3]
        assert (bus.counters.sent, bus.counters.send_retries) == (3, 0)


def test_a_bus_that_goes_amid_some_frames_is_told_with_the_next():
    driver = Grudging(2, errno.ENETDOWN, first=1)
    with Bus(PythonCanLink(driver), BusConfig(), "finger-1") as bus:
        assert bus.try_send([CanFrame(1), CanFrame(2)]) == 1
        with pytest.raises(BusError, match="cannot send"):
            bus.try_send([CanFrame(2)])
        assert driver.sent == [1]


def test_any_other_error_is_not_retried():
    driver = Grudging(1, errno.ENETDOWN)
    with (
        Bus(PythonCanLink(driver), BusConfig(), "finger-1") as bus,
        pytest.raises(BusError, match=r"socketcan bus .* of finger-1"),
    ):
        bus.send([CanFrame(1)])
    assert driver.refusals == 0


@pytest.mark.parametrize(
    ("interface", "channel", "text"),
    [
        (
            "socketcan",
            "can-not-there",
            "no SocketCAN: load can_raw|bus can-not-there of finger-1 ",
        ),
        ("no-such-interface", "x", "no-such-interface"),
        ("palpate", "/nowhere/s", "no CAN bus at /nowhere/s .*palpate-host bus hub --socket /nowhere/s"),
    ],
)
def test_a_bus_that_cannot_be_opened_is_one_line(interface, channel, text):
    with pytest.raises(BusError) as refusal:
        open_bus(BusConfig(interface=interface, channel=channel), "finger-1")
    said = str(refusal.value)
    assert "\n" not in said
    assert re.search(text, said)


def test_an_empty_filter_is_refused_since_python_can_takes_it_for_all():
    with pytest.raises(BusError, match="accept_ids is empty"):
        open_bus(BusConfig(interface="virtual", channel="x"), "finger-1", [])


def test_an_interface_without_descriptor_says_so(pair):
    with pytest.raises(BusError, match="no file descriptor"):
        pair[0].fileno()


@pytest.mark.parametrize(
    "text", [b'{"bitrate": 5}', b'{"baud": 1}', b'{"interface": ""}', b'{"bitrate": "fast"}']
)
def test_the_configuration_is_strict(text):
    with pytest.raises(msgspec.ValidationError):
        msgspec.json.decode(text, type=BusConfig)
