"""The fingertip's process on real CAN interfaces: in service, disconnected, flooded, and connected again."""

from __future__ import annotations

import threading
from contextlib import contextmanager
from itertools import pairwise

import canopen
import pytest

from kernel_guest.links import PATIENCE_S, Link, ip, receive
from palpate_edge.can_bus.bus import BusConfig, open_bus
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.node.parsed_eds import FINGERTIP_EDS

pytestmark = pytest.mark.usefixtures("kernel")

START = CanFrame(0x000, b"\x01\x10")
PRE_OPERATIONAL, OPERATIONAL = CanFrame(0x710, b"\x7f"), CanFrame(0x710, b"\x05")


@contextmanager
def stranger(link):
    with open_bus(BusConfig(interface="socketcan", channel=link.name), "stranger") as bus:
        yield bus


def wait_for(bus, *wanted):
    """Receive frames until each of these (frames or identifiers) was received."""
    missing, seen = list(wanted), []
    while len(seen) < 5000:
        new = receive(bus, 1)
        seen += new
        arrived = {*new, *(frame.can_id for frame in new)}
        missing = [one for one in missing if one not in arrived]
        if not missing:
            return
    raise AssertionError(f"{missing} did not come among {len(seen)} frames")


def test_a_foreign_master_finds_starts_and_reads_it(vcan, run_fingertip, wait_until):
    booted = threading.Event()
    with canopen.Network() as network:
        network.connect(interface="socketcan", channel=vcan.name)
        node = network.add_node(canopen.RemoteNode(0x10, str(FINGERTIP_EDS)))
        node.sdo.RESPONSE_TIMEOUT = PATIENCE_S
        network.subscribe(0x710, lambda _id, data, _stamp: data == b"\0" and booted.set())
        fingertip = run_fingertip(vcan.name)
        assert booted.wait(PATIENCE_S)
        assert node.sdo[0x1000].raw == 0x00020194
        node.tpdo.read()
        arrived = threading.Event()
        node.tpdo[3].add_callback(lambda _: arrived.set())
        node.nmt.state = "OPERATIONAL"
        assert arrived.wait(PATIENCE_S)
        # A machine that gets no processor for 200 ms withdraws its contact until the next frame.
        wait_until(lambda: int(node.sdo[0x2010].raw) & 0x04)
        network.disconnect()
    assert fingertip.stop() == 0
    assert "frames, " in fingertip.said()


def test_down_and_up_again(vcan, run_fingertip, wait_until):
    fingertip = run_fingertip(vcan.name)
    with stranger(vcan) as bus:
        wait_for(bus, PRE_OPERATIONAL)
        bus.send([START])
        wait_for(bus, OPERATIONAL, 0x190, 0x290, 0x390)
    vcan.down()
    wait_until(lambda: "bus is down" in fingertip.said())
    frames_then = fingertip.health().frames
    wait_until(lambda: fingertip.health().frames > frames_then + 60)  # it continues to estimate meanwhile
    assert fingertip.health().bus.state == "down"
    vcan.up()
    with stranger(vcan) as bus:
        wait_for(bus, OPERATIONAL, 0x190, 0x290, 0x390)
    wait_until(lambda: fingertip.health().bus.state == "up")
    assert fingertip.health().bus.restarts == 1
    assert fingertip.said().count("bus is down") == 1
    assert fingertip.stop() == 0


def test_an_interface_that_is_removed_and_made_again(vcan, run_fingertip, wait_until):
    fingertip = run_fingertip(vcan.name)
    with stranger(vcan) as bus:
        wait_for(bus, PRE_OPERATIONAL)
    vcan.delete()
    wait_until(lambda: "bus is down" in fingertip.said())
    ip("link", "add", vcan.name, "type", "vcan")
    Link(vcan.name).up()
    with stranger(vcan) as bus:
        wait_for(bus, PRE_OPERATIONAL)
        bus.send([START])
        wait_for(bus, OPERATIONAL, 0x190)
    assert fingertip.stop() == 0


def test_a_cable_that_takes_nothing_costs_old_contacts_and_nothing_else(
    serial_link, run_fingertip, wait_until
):
    """Contacts come 30 times a second, the queue holds 10 frames: what waits stays bounded, what is sent
    afterwards is fresh."""
    fingertip = run_fingertip(serial_link.name)
    wait_until(fingertip.health)
    serial_link.write(b"t00020110\r")
    wait_until(lambda: fingertip.health().bus.dropped > 60)
    stuck = fingertip.health()
    assert stuck.bus.retries > 0
    assert stuck.bus.state == "up"
    wait_until(lambda: "frames wait and the bus accepts none" in fingertip.said())
    wait_until(lambda: fingertip.health().bus.stuck)
    lines = serial_link.read_lines(120)
    assert "t710105" in lines
    sequences = [int(line[15:17] + line[13:15], 16) for line in lines if line.startswith("t3908")]
    assert sequences == sorted(set(sequences)), "no contact twice, none before an older one"
    # The ten frames in the queue are old contacts; a gap follows.
    assert max(later - earlier for earlier, later in pairwise(sequences)) > 10
    wait_until(lambda: "the bus accepts frames again" in fingertip.said())
    assert fingertip.stop() == 0


def test_a_spoofed_frame_on_the_bus_interrupts_the_contacts_and_keeps_the_socket(
    vcan, run_fingertip, wait_until
):
    fingertip = run_fingertip(vcan.name)
    with stranger(vcan) as bus:
        wait_for(bus, PRE_OPERATIONAL)
        bus.send([START])
        wait_for(bus, OPERATIONAL, 0x190)
        bus.send([CanFrame(0x190, bytes(8))])
        wait_for(bus, 0x090, PRE_OPERATIONAL)
        wait_for(bus, OPERATIONAL, 0x190)
    wait_until(lambda: fingertip.health().bus.id_conflicts == 1)
    assert "a frame 0x190 came from another node" in fingertip.said()
    assert fingertip.stop() == 0


def test_reads_without_a_pause_keep_the_socket(vcan, run_fingertip, wait_until, effort):
    fingertip = run_fingertip(vcan.name)
    with stranger(vcan) as bus:
        wait_for(bus, PRE_OPERATIONAL)
        bus.send([START])
        wait_for(bus, OPERATIONAL, 0x190)
        for _ in range(effort(20, 200)):
            bus.send([CanFrame(0x610, bytes.fromhex("4000100000000000"))] * 100)
            bus.receive(0)
        wait_for(bus, OPERATIONAL, 0x190)
    wait_until(lambda: fingertip.health().bus.received > 100)
    assert (fingertip.health().bus.restarts, fingertip.health().bus.id_conflicts) == (0, 0)
    assert fingertip.stop() == 0


def test_an_interface_taken_down_with_echoes_on_the_way_is_no_conflict(vcan, run_fingertip, wait_until):
    """The frames of the closed socket may reach the new one: vcan with echo keeps their owner."""
    fingertip = run_fingertip(vcan.name)
    with stranger(vcan) as bus:
        wait_for(bus, PRE_OPERATIONAL)
        bus.send([START])
        wait_for(bus, OPERATIONAL, 0x190)
    for number in range(3):
        vcan.down()
        wait_until(lambda: fingertip.health().bus.state == "down")
        vcan.up()
        wait_until(lambda count=number + 1: fingertip.health().bus.restarts == count)
    wait_until(lambda: fingertip.health().bus.state == "up")
    assert fingertip.health().bus.id_conflicts == 0
    assert fingertip.stop() == 0


def test_bus_off_and_a_restarted_link(serial_link, run_fingertip, wait_until):
    fingertip = run_fingertip(serial_link.name)
    wait_until(fingertip.health)
    serial_link.read_lines(1)
    serial_link.write(b"sb000256\r")
    wait_until(lambda: "went bus-off" in fingertip.said())
    serial_link.down()
    serial_link.up()
    lines = []
    while not any(line.startswith("t09084081") for line in lines):  # EMCY 8140h, bus-off recovered
        lines += serial_link.read_lines(1)
        assert len(lines) < 1000
    assert fingertip.process.poll() is None
    assert fingertip.stop() == 0
