"""CANopenNode's ``canopend`` as master of our fingertips, by its commands of CiA 309-3; on vcan0 and hub."""

from __future__ import annotations

import pytest

from palpate_edge.can_bus.can_frame import CanFrame

pytestmark = [pytest.mark.uml, pytest.mark.canopennode]

MASTER, TIP = 1, 0x10
BOOT_UP = CanFrame(0x700 + TIP, b"\0")
STATES = {"preop": b"\x7f", "start": b"\x05", "stop": b"\x04"}
LONG_TEXT = "sixty-four characters: the longest location of a fingertip 2003h"
CONTACT, SYNC = CanFrame(0x180 + TIP, b""), CanFrame(0x080, b"")
HEARTBEAT_LOST = bytes((0x30, 0x81))  # of an EMCY
WHOLE_ADDRESS, SERIAL_NUMBER = "0 0 0 0 0 0 0 0", "2 0 2 0x404 2 0x10000 0 0"
SCANS = ((100, WHOLE_ADDRESS), (400, WHOLE_ADDRESS), (2000, SERIAL_NUMBER), (2000, SERIAL_NUMBER))
"""Fastscans, one after the other: ms for each response, and what is searched; a busy machine is late."""


@pytest.fixture
def fingertip(own_bus, listener, run_fingertip):
    """A fingertip in PRE-OPERATIONAL."""
    fingertip = run_fingertip(own_bus.channel, driver=own_bus.interface)
    listener.wait_for(CanFrame(0x700 + TIP, b"\x7f"))
    return fingertip


@pytest.fixture
def master(gateway, fingertip):
    """canopend, with patience, on the bus of a fingertip whose socket and process stay."""
    assert gateway.ask("set sdo_timeout 20000") == "OK"
    yield gateway
    assert gateway.process.poll() is None
    health = fingertip.health().bus
    assert (health.state, health.restarts, health.id_conflicts) == ("up", 0, 0)
    assert fingertip.stop() == 0


def test_it_reads_and_writes_objects(master):
    assert master.ask(f"{TIP} read 0x1000 0 x32") == "0x00020194"
    assert master.ask(f"{TIP} read 0x1018 2 u32") == str(0x404)
    assert master.ask(f"{TIP} write 0x1017 0 u16 250") == "OK"
    assert master.ask(f"{TIP} read 0x1017 0 u16") == "250"
    assert master.ask(f"{TIP} read 0x1008 0 vs") == '"palpate fingertip"'


def test_it_is_given_the_standards_abort_codes(master):
    for command, code in (
        ("read 0x5555 0 u8", "0x06020000"),
        ("read 0x1018 9 u8", "0x06090011"),
        ("write 0x1018 1 u32 1", "0x06010002"),
        ("read 0x6125 1 u32", "0x06010001"),
        ("write 0x1017 0 u32 5", "0x06070012"),
        ("write 0x6125 1 u32 5", "0x08000020"),
    ):
        assert master.ask(f"{TIP} {command}").startswith(f"ERROR:{code}"), command


@pytest.mark.parametrize("block", [0, 1])
def test_it_transfers_a_long_text_both_ways(master, block):
    assert master.ask(f"set sdo_block {block}") == "OK"
    assert master.ask(f'{TIP} write 0x2003 0 vs "{LONG_TEXT}"') == "OK"
    assert master.ask(f"{TIP} read 0x2003 0 vs") == f'"{LONG_TEXT}"'


def test_it_commands_every_state(master, listener):
    start = len(listener.frames)
    for command, state in STATES.items():
        assert master.ask(f"{TIP} {command}") == "OK"
        start = listener.wait_for(CanFrame(0x700 + TIP, state), start)
    for command in ("reset node", "reset communication"):
        assert master.ask(f"{TIP} {command}") == "OK"
        start = listener.wait_for(BOOT_UP, start)


def test_its_sync_sends_the_synchronous_tpdo(master, listener):
    """Transmission type 2: there are two SYNCs, of 200 ms each, to a TPDO."""
    assert master.ask(f"{TIP} write 0x1800 2 u8 2") == "OK"
    assert master.ask(f"{TIP} start") == "OK"
    assert master.ask(f"{MASTER} write 0x1006 0 u32 200000") == "OK"
    assert master.ask(f"{MASTER} write 0x1005 0 u32 0x40000080") == "OK"
    start = 0
    for _ in range(20):
        start = listener.wait_for(CONTACT, start)
    sync, contact = SYNC.can_id, CONTACT.can_id
    order = [frame.can_id for frame in listener.frames[:start] if frame.can_id in (sync, contact)]
    order = order[order.index(contact) + 1 :]
    # A fingertip on a busy machine is late now and then, behind the next SYNC.
    assert order.count(sync) / order.count(contact) == pytest.approx(2.0, rel=0.1)


def test_each_notices_that_the_other_is_lost(master, fingertip, listener, wait_until, run_fingertip, own_bus):
    assert master.ask(f"{MASTER} write 0x1016 1 u32 {TIP << 16 | 3000}") == "OK"
    assert master.ask(f"{MASTER} write 0x1017 0 u16 100") == "OK"
    assert master.ask(f"{TIP} write 0x1029 1 u8 0") == "OK"
    assert master.ask(f"{TIP} write 0x1016 1 u32 {MASTER << 16 | 3000}") == "OK"
    assert master.ask(f"{TIP} start") == "OK"
    wait_until(
        lambda: f'node ID = 0x{TIP:02X} (index = 0): NMT state changed to: "operational"' in master.log()
    )
    start = listener.wait_for(CanFrame(0x700 + TIP, b"\x05"))
    start = listener.wait_for(CanFrame(0x700 + MASTER, b"\x05"), start)  # supervision begins with it
    assert master.ask(f"{MASTER} write 0x1017 0 u16 0") == "OK"
    start = listener.wait_for(CanFrame(0x080 + TIP, HEARTBEAT_LOST), start)
    assert listener.frames[start - 1].data[3] == MASTER
    listener.wait_for(CanFrame(0x700 + TIP, b"\x7f"), start)
    wait_until(lambda: f"Emergency message from node 0x{TIP:02X}: errorCode=0x8130" in master.log())
    assert master.ask(f"{MASTER} write 0x1017 0 u16 100") == "OK"
    wait_until(lambda: f"Emergency message from node 0x{TIP:02X}: errorCode=0x0000" in master.log())
    fingertip.process.kill()
    fingertip.process.wait()
    start = listener.wait_for(CanFrame(0x080 + MASTER, HEARTBEAT_LOST), start)
    again = run_fingertip(own_bus.channel, driver=own_bus.interface, name="again")
    listener.wait_for(BOOT_UP, start)
    wait_until(again.health)
    fingertip.process, fingertip.health = again.process, again.health


def test_it_numbers_two_unconfigured_fingertips(gateway, run_fingertip, own_bus, listener, wait_until):
    serials = (7, 0xC0FFEE)
    section = 'id = 255\nserial_number = {}\nparameters = "kept"'
    tips = [
        run_fingertip(own_bus.channel, driver=own_bus.interface, name=f"tip-{one}", node=section.format(one))
        for one in serials
    ]
    wait_until(lambda: all(tip.health() for tip in tips))
    lines: list[str] = []
    for step_ms, searched in SCANS:
        first = 16 + sum("assigned" in line for line in lines)
        lines += gateway.ask(f"lss_allnodes {step_ms} {first} 1 {searched}").splitlines()
        if sum("assigned" in line for line in lines) == len(tips):
            break
    for node_id, serial in zip((16, 17), serials, strict=True):
        address = f"0x00000000 0x00000404 0x00010000 0x{serial:08X}"
        assert f"# Node-ID {node_id} assigned to: {address}" in lines
        listener.wait_for(CanFrame(0x700 + node_id, b"\0"))
        assert gateway.ask(f"{node_id} read 0x1018 4 u32") == str(serial)
    assert [tip.stop() for tip in tips] == [0, 0]
    kept = run_fingertip(own_bus.channel, driver=own_bus.interface, name="tip-7", node=section.format(7))
    listener.wait_for(CanFrame(0x710, b"\0"), len(listener.frames))
    assert kept.stop() == 0


def test_it_moves_one_fingertip_by_its_address(master, listener):
    serial = master.ask(f"{TIP} read 0x1018 4 u32")
    assert master.ask(f"lss_switch_sel 0 0x404 0x10000 {serial}") == "OK"
    assert master.ask("lss_get_node") == f"0x{TIP:02X}"
    assert int(master.ask("lss_inquire_addr 3"), 0) == int(serial)
    assert master.ask("lss_conf_bitrate 0 4").startswith("ERROR:")  # the link sets the bit rate
    assert master.ask("lss_store").startswith("ERROR:")  # no file for parameters
    assert master.ask("lss_set_node 0x1F") == "OK"
    assert master.ask("lss_switch_glob 0") == "OK"
    assert master.ask(f"{TIP} reset communication") == "OK"
    listener.wait_for(CanFrame(0x71F, b"\0"))
