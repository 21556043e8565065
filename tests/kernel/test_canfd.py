"""CAN FD on the kernel's CAN sockets, with can-utils at the other end."""

from __future__ import annotations

import subprocess
import threading

import pytest

from kernel_guest.fd_traffic import AXES, DRIVES, FINGERTIPS, FRAMES_HZ, TICK_HZ, large_hand
from kernel_guest.links import ip, receive
from palpate_bus.load.budget import BudgetCase, budget
from palpate_bus.load.fd_bit_count import bit_times
from palpate_bus.logs.candump import parse_record
from palpate_edge.can_bus.bus import BusConfig, open_bus
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.errors import BusError
from palpate_host.network.fingertips import Fingertip

pytestmark = pytest.mark.usefixtures("kernel")

NOMINAL, DATA = 1_000_000, 5_000_000
FD = CanFrame(0x190, bytes(range(64)), fd=True)


def opened(link, name="finger-1", data_bitrate=DATA):
    return open_bus(BusConfig(channel=link.name, data_bitrate=data_bitrate), name)


def test_frames_cross_in_both_directions_with_classic_ones_beside(fd_vcan):
    with opened(fd_vcan) as bus, opened(fd_vcan, "host") as host, opened(fd_vcan, "old", None) as classic:
        for frame in ("191##1000102030405060708090A0B", "080#01"):
            subprocess.run(["cansend", fd_vcan.name, frame], check=True)
        there = [CanFrame(0x191, bytes(range(12)), fd=True), CanFrame(0x080, b"\x01")]
        assert receive(bus, 2) == there
        bus.send([FD, CanFrame(0x701, b"\x05")])
        assert receive(host, 4) == [*there, FD, CanFrame(0x701, b"\x05")]
        assert receive(classic, 2) == [CanFrame(0x080, b"\x01"), CanFrame(0x701, b"\x05")]
        with pytest.raises(BusError, match="cannot send: CAN FD frame 190 on a bus of classic CAN"):
            classic.send([FD])


def test_our_log_reads_what_candump_writes(fd_vcan):
    candump = subprocess.Popen(["candump", "-L", "-n", "1", fd_vcan.name], stdout=subprocess.PIPE, text=True)
    with opened(fd_vcan) as bus:
        while candump.poll() is None:  # until it listens
            bus.send([FD])
            threading.Event().wait(0.1)
    line = candump.communicate()[0].strip()
    assert "190##" in line
    assert parse_record(line).frame == FD


def test_an_interface_of_classic_can_is_refused_with_the_command(vcan):
    vcan.down()
    ip("link", "set", vcan.name, "mtu", 16)
    vcan.up()
    with pytest.raises(BusError, match=r"vcan0 of finger-1 carries classic CAN .*ip link set vcan0 mtu 72"):
        opened(vcan)
    with pytest.raises(BusError, match=r"vcan9 of finger-1 cannot be opened: .*No such device"):
        open_bus(BusConfig(channel="vcan9", data_bitrate=DATA), "finger-1")


def test_the_daemon_sends_a_contact_as_one_frame_and_the_host_decodes_it(fd_vcan, run_fingertip, wait_until):
    """The drawn presses touch the dome now and then; a rejected frame counts as complete too."""
    host = Fingertip(0x10, "finger-1", fd=True)
    contacts = []
    with opened(fd_vcan, "host") as bus:
        fingertip = run_fingertip(fd_vcan.name, bus=f"data_bitrate = {DATA}\n")

        def received():
            bus.send([CanFrame(0x000, b"\x01\x10")])
            for stamp_us, frame in bus.receive(0.5):
                if frame.can_id in host.receive_ids:
                    assert (frame.fd, len(frame.data)) == (True, 32)
                    contacts.append(host.receive(stamp_us, frame))
                assert frame.fd == (frame.can_id in host.receive_ids)
            return any(contact is not None and contact.in_contact for contact in contacts)

        wait_until(received)
    assert fingertip.stop() == 0


@pytest.mark.parametrize("axes", [False, True], ids=["a node each", "5 axes a node"])
def test_a_second_of_a_large_hand_arrives_whole_and_is_the_load_of_the_budget(fd_vcan, axes):
    case = BudgetCase(len(FINGERTIPS), len(DRIVES), FRAMES_HZ, TICK_HZ, NOMINAL, data_bitrate=DATA)
    expected = budget(case.sharing_nodes(AXES) if axes else case)
    (contact,) = [stream.length for stream in expected.streams if stream.name == "fingertip TPDO 10"]
    frames = [frame for _, _, frame in large_hand(contact, axes=axes)]
    arrived = []
    with opened(fd_vcan) as sender, opened(fd_vcan, "host") as host:
        for at in range(0, len(frames), 38):  # about a tick's frames, fewer than a socket's buffer holds
            sender.send(frames[at : at + 38])
            arrived += receive(host, len(frames[at : at + 38]))
    assert arrived == frames
    percent = 100 * sum(bit_times(frame, NOMINAL, DATA) for frame in arrived) / NOMINAL
    print(f"{len(arrived)} frames in a second, {percent:.2f} %, budget {expected.mean_percent:.2f} %")
    assert percent == pytest.approx(expected.mean_percent, rel=0.05)
