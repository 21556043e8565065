"""palpate_edge.can_bus.bus on the kernel's CAN sockets, with can-utils at the other end."""

from __future__ import annotations

import gc
import subprocess
import threading
import time
from pathlib import Path

import pytest

from kernel_guest.links import PATIENCE_S, receive
from palpate_bus.logs.candump import LogRecord, LogWriter, read_log
from palpate_edge.can_bus.bus import BusConfig, open_bus
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.errors import BusError

pytestmark = pytest.mark.usefixtures("kernel")

TRAFFIC = [CanFrame(0x000, b"\x01\x10"), CanFrame(0x190, bytes(range(8))), CanFrame(0x701, remote=True)]


def opened(link, accept_ids=None):
    return open_bus(BusConfig(interface="socketcan", channel=link.name), "finger-1", accept_ids)


def wait_until(condition):
    end_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end_s
        time.sleep(0.02)


def test_candump_writes_what_our_log_reads(vcan, tmp_path):
    path = tmp_path / "candump.log"
    with path.open("wb") as out:
        candump = subprocess.Popen(["candump", "-L", "-n", str(len(TRAFFIC)), vcan.name], stdout=out)
    wait_until(lambda: vcan.name in Path("/proc/net/can/rcvlist_all").read_text().split())
    with opened(vcan) as bus:
        bus.send(TRAFFIC)
    assert candump.wait(PATIENCE_S) == 0
    assert [record.frame for record in read_log(path).records] == TRAFFIC


def test_canplayer_plays_what_our_log_wrote(vcan, tmp_path):
    path = tmp_path / "ours.log"
    with LogWriter(path) as log:
        for number, frame in enumerate(TRAFFIC):
            log.write(LogRecord(1_700_000_000_000_000 + 1000 * number, frame))
    with opened(vcan) as bus:
        subprocess.run(["canplayer", "-I", path, f"{vcan.name}=can0"], check=True)
        assert receive(bus, len(TRAFFIC)) == TRAFFIC


def test_frames_that_the_sockets_buffer_does_not_hold_are_an_overrun(vcan):
    """The kernel drops them, and marks the next frame that it can store."""
    with opened(vcan) as bus, opened(vcan) as stranger:
        flood = [CanFrame(0x181, number.to_bytes(8, "big")) for number in range(12_000)]
        stranger.send(flood)
        kept = [frame for _, frame in bus.receive(PATIENCE_S)]
        while batch := bus.receive(0):
            kept += [frame for _, frame in batch]
        assert 1_000 < len(kept) < len(flood)  # the kernel's default buffer holds 477
        assert kept == flood[: len(kept)]
        assert bus.counters.receive_overruns == 0
        stranger.send([CanFrame(0x080)])
        assert receive(bus, 1) == [CanFrame(0x080)]
        assert bus.counters.receive_overruns == 1


def test_the_kernel_filters(vcan):
    with opened(vcan, accept_ids=[0x190, 0x000]) as bus:
        for frame in ("191#", "00000190#", "190#01", "390#", "000#0110"):  # eight digits: 29 bits
            subprocess.run(["cansend", vcan.name, frame], check=True)
        assert receive(bus, 2) == [CanFrame(0x190, b"\x01"), CanFrame(0, b"\x01\x10")]
        assert bus.counters.foreign_frames == 0


def test_frames_of_29_bits_are_counted_where_nothing_is_filtered(vcan):
    with opened(vcan) as bus:
        for frame in ("00000190#", "190#"):
            subprocess.run(["cansend", vcan.name, frame], check=True)
        assert receive(bus, 1) == [CanFrame(0x190)]
        assert bus.counters.foreign_frames == 1


def test_the_stamp_is_the_kernels(vcan):
    with opened(vcan) as bus, opened(vcan) as stranger:
        before_us = time.time_ns() // 1000
        stranger.send([CanFrame(0x80)])
        after_us = time.time_ns() // 1000
        time.sleep(0.2)
        ((stamp_us, _),) = bus.receive(PATIENCE_S)
    assert before_us <= stamp_us <= after_us


def test_an_interface_that_goes_down_is_an_error_and_serves_again_when_up(vcan):
    with opened(vcan) as bus:
        vcan.down()
        with pytest.raises(BusError, match=r"socketcan bus vcan0 of finger-1: cannot receive: .*down"):
            bus.receive(PATIENCE_S)
        with pytest.raises(BusError, match=r"socketcan bus vcan0 of finger-1: cannot send: .*down"):
            bus.send([CanFrame(0x701, b"\x05")])
    vcan.up()
    with opened(vcan) as bus, opened(vcan) as stranger:
        stranger.send([CanFrame(0x80)])
        assert receive(bus, 1) == [CanFrame(0x80)]


@pytest.mark.filterwarnings(
    "ignore:unclosed <socket:ResourceWarning"
)  # python-can leaves it to the collector
def test_an_interface_that_is_not_there_is_refused():
    with pytest.raises(BusError, match=r"socketcan bus vcan9 of finger-1 cannot be opened: .*No such device"):
        open_bus(BusConfig(channel="vcan9"), "finger-1")
    gc.collect()  # python-can leaves the socket to the collector: here, where the warning is known


def test_an_interface_that_vanishes_is_an_error(vcan):
    with opened(vcan) as bus:
        vcan.delete()
        with pytest.raises(BusError, match="cannot receive"):
            bus.receive(PATIENCE_S)
        with pytest.raises(BusError, match="cannot send"):
            bus.send([CanFrame(0x80)])


def test_a_full_transmit_queue_is_refused_with_a_bound_and_drains(serial_link):
    """Nobody reads the cable: the interface's queue of 10 fills up behind the driver."""
    numbers = iter(range(1000))
    with opened(serial_link) as bus:
        with pytest.raises(BusError, match="transmit queue full, frame 190 refused 9 times: check the cabl"):
            while True:
                bus.send([CanFrame(0x190, next(numbers).to_bytes(2, "big"))])
        accepted = bus.counters.sent
        assert 10 < accepted < 1000
        assert bus.counters.send_retries >= 8
        texts = [f"t1902{number:04x}".upper().replace("T", "t") for number in range(accepted)]
        assert serial_link.read_lines(accepted) == texts
        bus.send([CanFrame(0x191)])
        assert serial_link.read_lines(1) == ["t1910"]


def test_a_flood_beyond_the_queue_loses_and_repeats_nothing(serial_link):
    """The cable is slower than the sender, which waits after ENOBUFS and repeats the frame."""
    frames = [CanFrame(0x190, number.to_bytes(8, "big")) for number in range(300)]
    arrived = []

    def drain():
        while len(arrived) < len(frames):
            arrived.extend(serial_link.read_lines(1))
            time.sleep(0.001)

    cable = threading.Thread(target=drain)
    cable.start()
    with opened(serial_link) as bus:
        bus.send(frames)
        cable.join(PATIENCE_S)
        assert bus.counters.send_retries > 0
    assert arrived == [f"t1908{number:016X}" for number in range(len(frames))]


def test_bus_off_of_the_controller_is_an_error_after_what_came_before(serial_link):
    with opened(serial_link) as bus:
        serial_link.write(b"t0810\rsb000256\r")
        assert receive(bus, 1) == [CanFrame(0x81)]
        with pytest.raises(BusError, match="went bus-off: check wiring"):
            bus.receive(PATIENCE_S)


def test_a_receive_overrun_of_the_controller_is_counted(serial_link):
    with opened(serial_link) as bus:
        serial_link.write(b"e1o\rt0810\r")
        assert receive(bus, 1) == [CanFrame(0x81)]
        assert (bus.counters.error_frames, bus.counters.receive_overruns) == (1, 1)


def test_more_identifiers_than_the_kernel_filters_are_filtered_too(vcan):
    """The kernel takes 512 filters a socket (CAN_RAW_FILTER_MAX)."""
    with opened(vcan, accept_ids=range(0x100, 0x400)) as bus:
        for frame in ("080#", "00000190#", "400#", "3FF#01", "100#R3"):
            subprocess.run(["cansend", vcan.name, frame], check=True)
        assert receive(bus, 2) == [CanFrame(0x3FF, b"\x01"), CanFrame(0x100, bytes(3), remote=True)]
        assert bus.counters.foreign_frames == 0
        bus.accept([0x080])
        for frame in ("3FF#", "080#"):
            subprocess.run(["cansend", vcan.name, frame], check=True)
        assert receive(bus, 1) == [CanFrame(0x080)]
