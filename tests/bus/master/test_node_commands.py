"""`bus scan`, `bus sdo`, `bus lss` across the hub: our nodes as processes, and durand as a foreign one."""

from __future__ import annotations

import dataclasses
import json
import re
import subprocess
import sys
import threading
import time

import can
import durand
import msgspec
import pytest
from click.testing import CliRunner
from durand.network import CANBusNetwork

from palpate_bus.cli.main import bus
from palpate_bus.decode.device import Device, usual_device
from palpate_bus.eds.cia402 import CIA402_EDS
from palpate_bus.master.lss import parse_address
from palpate_bus.master.sdo_access import encode, find_object
from palpate_bus.master.session import master
from palpate_edge.can_bus.bus import BusConfig, open_bus
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.contact import Contact
from palpate_edge.common.errors import BusError, ConfigError
from palpate_edge.node.eds import load_eds
from palpate_edge.node.events import StoreRequested
from palpate_edge.node.fingertip import FingertipNode
from palpate_edge.node.fingertip_objects import MethodCode
from palpate_edge.node.parsed_eds import FINGERTIP_EDS
from palpate_edge.node.stored_parameters import StoredParameters


class Nodes(threading.Thread):
    """Fingertip nodes of our own on the hub, served in real time until they are stopped."""

    def __init__(self, path, node_ids):
        super().__init__()
        self.nodes = [FingertipNode(node_id, MethodCode.PAPER, "0123456789abcdef") for node_id in node_ids]
        self.bus = open_bus(BusConfig(interface="palpate", channel=str(path)), "nodes")
        self.stopped = threading.Event()
        self.stores = True

    def run(self):
        with self.bus:
            while not self.stopped.is_set():
                frames = [frame for _, frame in self.bus.receive(0.01)]
                now_us = time.monotonic_ns() // 1000
                for node in self.nodes:
                    output = node.process(now_us, frames)
                    self.bus.send(output.frames_out)
                    if any(isinstance(event, StoreRequested) for event in output.events):
                        node.slave.store_finished(self.stores)


def swapped_and_saved(node_id):
    """A fingertip that has stored TPDO 1 with y before x, and a location."""
    checksum = load_eds(FINGERTIP_EDS, node_id).checksum
    swapped = {(0x1A00, 1): 0x7130_0210, (0x1A00, 2): 0x7130_0110, (0x2003, 0): "left hand"}
    kept = StoredParameters(eds_checksum=checksum, objects=swapped)
    return FingertipNode(node_id, MethodCode.PAPER, "0123456789abcdef", kept=kept)


@pytest.fixture
def hub(start_hub):
    """With room for a whole block: durand does not wait when its queue is full."""
    return start_hub("--txqueuelen", "512")


@pytest.fixture
def fingertips(hub):
    """Nodes 0x10 and 0x11."""
    nodes = Nodes(hub.path, (0x10, 0x11))
    nodes.start()
    yield nodes
    nodes.stopped.set()
    nodes.join()


@pytest.fixture
def foreign_node(hub):
    """A durand node on the hub: `make(node_id)`; 0xFF has no id yet (CiA 305)."""
    made = []

    def make(node_id, serial=0x2A):
        port = can.Bus(interface="palpate", channel=str(hub.path), name=f"foreign-{node_id}")
        network = CANBusNetwork(port)
        made.append((network, port))
        node = durand.MinimalNode(network, node_id)
        for sub, value in enumerate((0x1234, 0x404, 0x10000, serial), start=1):
            node.object_dictionary.write(0x1018, sub, value)
        node.object_dictionary.write(0x1008, 0, b"a foreign device")
        node.object_dictionary.write(0x1000, 0, 0x0002_0194)
        return node

    yield make
    for network, port in made:
        network.stop()
        port.shutdown()


def run(hub, *arguments):
    where = ("--channel", str(hub.path))
    return CliRunner().invoke(bus, [*map(str, arguments), *where], catch_exceptions=False)


def test_scan_tells_who_is_there(hub, fingertips, foreign_node):
    foreign_node(0x21)
    foreign_node(0xFF, serial=0x80000001)
    found = [json.loads(line) for line in run(hub, "scan", "--json").output.splitlines()]
    assert [(node["node"], node.get("name"), node.get("profile"), node.get("state")) for node in found] == [
        (0x10, "palpate fingertip", "CiA 404 measuring", "pre-operational"),
        (0x11, "palpate fingertip", "CiA 404 measuring", "pre-operational"),
        (0x21, "a foreign device", "CiA 404 measuring", ""),  # durand beats only when told to
        (None, None, None, None),
    ]
    assert found[2]["vendor"] == 0x1234 and found[2]["serial"] == 0x2A
    assert found[3]["lss_address"] == "1234:404:10000:80000001"


def test_scan_shows_a_node_id_that_is_used_twice(hub, foreign_node):
    foreign_node(0x22)
    foreign_node(0x22)
    table = run(hub, "scan", "--no-lss", "--listen", 0).output.splitlines()
    assert len(table) == 2
    assert table[1].split() == ["0x22", "-", "-", "-", "-", "-", "-", "-", "2", "nodes", "have", "this", "id"]


def test_nodes_are_started_stopped_and_reset(hub, fingertips):
    assert run(hub, "nmt", "start", "0x10").output == "0x10: operational\n"
    states = [node.slave.state for node in fingertips.nodes]
    assert [state.name for state in states] == ["OPERATIONAL", "PRE_OPERATIONAL"]
    assert run(hub, "nmt", "stop", "all").output == "0x10: stopped\n0x11: stopped\n"
    assert run(hub, "nmt", "preop", "0x11").output == "0x11: pre-operational\n"
    assert run(hub, "nmt", "reset", "0x10").exit_code == 0
    assert fingertips.nodes[0].slave.state.name == "PRE_OPERATIONAL"
    with pytest.raises(BusError, match="node 0x30: no heartbeat within"):
        run(hub, "nmt", "start", "0x30", "--wait", "0.3")


def test_scan_of_an_empty_bus_says_what_to_check(hub):
    assert run(hub, "scan", "--no-lss", "--listen", 0).output.startswith(
        "no node responds: check the bit rate"
    )


def test_objects_are_read_by_index_and_by_name_with_their_unit(hub, fingertips):
    assert run(hub, "sdo", "read", "0x10", "1008").output == (
        "1008h:00 Manufacturer device name = 'palpate fingertip'\n"
    )
    assert run(hub, "sdo", "read", 16, "value of contact x").output == (
        "7130h:01 AI input PV / Value of contact x = 0.00 mm\n"
    )
    assert run(hub, "sdo", "read", 16, "2000h:0").output.endswith("= 0 (paper)\n")


def test_objects_are_written_in_their_unit_and_read_back(hub, fingertips):
    said = run(hub, "sdo", "write", "0x10", "producer heartbeat time", "250ms").output
    assert said == "1017h:00 Producer heartbeat time = 250 ms: written\n"
    assert run(hub, "sdo", "read", "0x10", "1017").output.endswith("= 250 ms\n")
    assert fingertips.nodes[0].slave.read(0x1017) == 250
    assert run(hub, "sdo", "write", "0x10", "6125:1", "zero").exit_code == 0


@pytest.mark.parametrize(
    ("command", "error", "text"),
    [
        # The node's refusals: CiA 301, 7.2.4.3.17.
        (("read", "0x10", "5555"), BusError, "06020000h, Object does not exist"),
        (("read", "0x10", "6125:1"), BusError, "06010001h, Attempt to read a write only object"),
        (
            ("write", "0x10", "1018:1", "hex:01000000"),
            BusError,
            "06010002h, Attempt to write a read only object",
        ),
        (("write", "0x10", "6125:1", "5"), BusError, "08000020h"),
        (
            ("read", "0x33", "1000", "--timeout", "0.05"),
            BusError,
            "it may be off, STOPPED or have another id",
        ),
        # Ours, before a frame is sent.
        (
            ("write", "0x10", "1018:1", "1"),
            ConfigError,
            "cannot be written: its access type in fingertip.eds is ro",
        ),
        (("write", "0x10", "1017", "65536"), ConfigError, "out of range: give 0 ms to 65535 ms"),
        (
            ("write", "0x10", "1017", "soon"),
            ConfigError,
            "'soon' is not a number: give a number, or one with the unit ms",
        ),
        (("write", "0x10", "1A00:0", "9"), ConfigError, "out of range: give 0 to 8"),
        (("read", "0x10", "no such name"), ConfigError, "has no object named 'no such name'"),
        (("read", "0x33", "no such name"), ConfigError, "no EDS is known for this node"),
        (("write", "0x33", "1017", "5"), ConfigError, "the type of 1017h:00 is unknown"),
        (("write", "0x10", "1017", "hex:0"), ConfigError, "'hex:0' is not a list of hexadecimal bytes"),
    ],
)
def test_refusals_say_why(hub, fingertips, command, error, text):
    with pytest.raises(error, match=re.escape(text)) as caught:
        run(hub, "sdo", *command)
    assert len(str(caught.value).splitlines()) == 1


def test_a_tare_while_touched_is_refused_and_the_command_says_why(hub, fingertips):
    touch = Contact(0, 0, True, True, (0.0, 0.0, 30.0), 2.8, None, 1.0, "", 85, 85)
    fingertips.nodes[0].publish(touch, 4000)
    with pytest.raises(BusError, match=r"08000022h.*something touches the fingertip.*release it"):
        run(hub, "sdo", "write", "0x10", "6125:1", "zero")
    assert run(hub, "sdo", "write", "0x10", "6125:1", "ZERO").exit_code == 0
    fingertips.nodes[0].publish(dataclasses.replace(touch, in_contact=False), 4000)
    assert run(hub, "sdo", "write", "0x10", "6125:1", "zero").exit_code == 0


def test_a_running_node_refuses_changes_and_the_command_says_what_to_do(hub, fingertips):
    run(hub, "nmt", "start", "0x10")
    with pytest.raises(
        BusError, match=r"08000022h.*the node is OPERATIONAL.*palpate-host bus nmt preop NODE"
    ):
        run(hub, "sdo", "write", "0x10", "1804:1", "0xC0000310")
    with pytest.raises(BusError, match=r"LSS Error: 255 .*255: not in this NMT state.*nmt preop NODE"):
        run(hub, "lss", "set", "0x21", "--address", "0:404:10000:0")
    run(hub, "nmt", "preop", "0x10")
    assert run(hub, "sdo", "write", "0x10", "1804:1", "0xC0000310").exit_code == 0


def test_the_pdos_of_a_node_are_those_of_its_eds(hub, fingertips, tmp_path):
    assert run(hub, "sdo", "check", "0x10").output == "node 0x10: 11 PDOs, 0 differences from fingertip.eds\n"
    eds = tmp_path / "older.eds"
    eds.write_text(FINGERTIP_EDS.read_text().replace("0x20140010", "0x20110008"))
    said = run(hub, "sdo", "check", "0x10", "--eds", eds)
    assert said.exit_code == 1
    assert "Mapped object 3: 0x20140010 in the node, 0x20110008 in the EDS" in said.output


def test_a_stored_remap_is_restored_by_one_command(hub, fingertips):
    """x and y of TPDO 1 swapped and saved; the application's own parameters are kept."""
    node = fingertips.nodes[0] = swapped_and_saved(0x10)
    differing = run(hub, "sdo", "check", "0x10")
    assert differing.exit_code == 1 and "1A00h:01" in differing.output and "2 differences" in differing.output
    said = run(hub, "sdo", "restore", "0x10")
    assert (said.exit_code, said.output) == (0, "node 0x10: 11 PDOs, 0 differences from fingertip.eds\n")
    assert run(hub, "sdo", "read", "0x10", "Location").output.endswith("= 'left hand'\n")
    assert node.slave.read(0x1A00, 1) == 0x7130_0110


def test_a_node_that_stores_nothing_is_restored_by_its_reset(hub, fingertips):
    fingertips.stores = False
    assert run(hub, "sdo", "write", "0x10", "1804:1", "0xC0000310").exit_code == 0
    said = run(hub, "sdo", "restore", "0x10")
    assert (said.exit_code, said.output) == (0, "node 0x10: 11 PDOs, 0 differences from fingertip.eds\n")


def test_restoring_a_node_that_is_not_there_says_so(hub, fingertips):
    with pytest.raises(BusError, match=r"node 0x13, reading 1000h:00 .* within 0.1 s: it may be off"):
        run(hub, "sdo", "restore", "0x13", "--timeout", 0.1)


def test_large_objects_go_in_blocks_and_come_back(hub, foreign_node, tmp_path):
    node = foreign_node(0x21)
    node.object_dictionary[0x2345] = durand.Variable(durand.DatatypeEnum.DOMAIN, "rw", name="Big")
    (tmp_path / "in").write_bytes(bytes(range(256)) * 8)
    assert run(hub, "sdo", "write", "0x21", "2345", "--file", tmp_path / "in", "--timeout", 5).exit_code == 0
    for block in ((), ("--block",)):
        out = tmp_path / "out"
        said = run(hub, "sdo", "read", "0x21", "2345", *block, "-o", out, "--timeout", 5).output
        assert said == f"2345 = 2048 bytes in {out}\n"
        assert out.read_bytes() == (tmp_path / "in").read_bytes()


def test_the_master_waits_for_room_in_a_short_queue(start_hub, open_edge):
    hub, heard = start_hub("--txqueuelen", "4"), []
    listener = open_edge("listener")
    with master(BusConfig(interface="palpate", channel=str(hub.path)), "sdo") as network:
        for number in range(100):
            network.send_message(0x601, bytes([number]))
        while len(heard) < 100:
            heard += listener.receive(20)
    assert [frame.data[0] for _, frame in heard] == list(range(100))


def test_what_has_no_block_transfer_is_written_in_segments(hub, fingertips):
    """Our server may refuse blocks (0504 0001h); the value then goes the other way."""
    assert run(hub, "sdo", "read", "0x10", "1008", "--block").output.endswith("= 'palpate fingertip'\n")


def test_an_unconfigured_device_gets_an_id_and_keeps_it(hub, foreign_node):
    node, stored = foreign_node(0xFF), []
    node.lss.set_store_configuration_callback(lambda _baudrate, node_id: stored.append(node_id))
    assert run(hub, "lss", "list").stdout == "1234:404:10000:2A\n"
    said = run(hub, "lss", "set", "0x35", "--store").output
    assert said == "1234:404:10000:2A has node id 0x35, stored\n"
    assert stored == [0x35]
    assert run(hub, "sdo", "read", "0x35", "1018:1", "--timeout", 5).output == "1018:1 = 34 12 00 00\n"


def test_two_fingertips_without_an_id_are_found_and_named(hub):
    """Our own slaves: the same type, told apart by their serial numbers alone."""
    nodes = Nodes(hub.path, ())
    nodes.nodes = [FingertipNode(255, MethodCode.PAPER, "", serial_number=serial) for serial in (7, 0xC0FFEE)]
    nodes.start()
    try:
        found = run(hub, "lss", "list").stdout.splitlines()
        assert [address.rpartition(":")[2] for address in found] == ["7", "C0FFEE"]
        assert run(hub, "lss", "set", "0x12", "--address", found[1]).exit_code == 0
        assert run(hub, "lss", "list").stdout.splitlines() == found[:1]
        assert run(hub, "sdo", "read", "0x12", "Serial number").output.endswith("= 0xC0FFEE\n")
    finally:
        nodes.stopped.set()
        nodes.join()


class Chatty(FingertipNode):
    """In LSS configuration state it answers every fastscan request, as CANopenNode does (CO_LSSslave.c)."""

    def process(self, now_us, frames_in, arrived_us=None):
        output = super().process(now_us, frames_in, arrived_us)
        asked = any(frame.can_id == 0x7E5 and frame.data[0] == 0x51 for frame in frames_in)
        answered = any(frame.can_id == 0x7E4 for frame in output.frames_out)
        if not self.slave._lss.configuring or not asked or answered:
            return output
        return msgspec.structs.replace(
            output, frames_out=(*output.frames_out, CanFrame(0x7E4, b"\x4f" + bytes(7)))
        )


def test_a_device_that_answers_every_scan_is_found_once_and_no_phantom_with_it(hub):
    nodes = Nodes(hub.path, ())
    nodes.nodes = [Chatty(255, MethodCode.PAPER, "", serial_number=7)]
    nodes.start()
    try:
        assert run(hub, "lss", "list").stdout == "0:404:10000:7\n"
    finally:
        nodes.stopped.set()
        nodes.join()


class Busy(FingertipNode):
    """Misses LSS requests as CANopenNode may: those within 10 ms of another, and the first of a kind."""

    def __init__(self, *arguments, **options):
        super().__init__(*arguments, **options)
        self.busy_until_us, self.missed = 0, set()

    def process(self, now_us, frames_in, arrived_us=None):
        heard = []
        for frame in frames_in:
            kind = frame.data[0] if frame.can_id == 0x7E5 else None
            if kind in (0x04, 0x40) and now_us < self.busy_until_us:
                continue
            if kind in (0x04, 0x11, 0x17, 0x51):
                self.busy_until_us = now_us + 10_000
            if kind in (0x11, 0x17) and kind not in self.missed:
                self.missed.add(kind)
                continue
            heard.append(frame)
        return super().process(now_us, heard, arrived_us)


def test_a_busy_device_is_listed_and_gets_its_id(hub, monkeypatch):
    monkeypatch.setattr("palpate_bus.master.lss.COMMAND_TIMEOUT_S", 0.3)
    nodes = Nodes(hub.path, ())
    nodes.nodes = [Busy(255, MethodCode.PAPER, "", serial_number=7)]
    nodes.start()
    try:
        assert run(hub, "lss", "list").stdout == "0:404:10000:7\n"
        said = run(hub, "lss", "set", "0x12", "--address", "0:404:10000:7", "--store").output
        assert said == "0:404:10000:7 has node id 0x12, stored\n"
        assert nodes.nodes[0].missed == {0x11, 0x17}
    finally:
        nodes.stopped.set()
        nodes.join()


def test_a_scan_waits_for_a_slow_node_as_long_as_it_is_allowed(hub, foreign_node):
    """A node whose responses take 0.35 s, longer than a scan waits by itself."""
    node = foreign_node(0x21)
    send = node.network.send

    def send_later(cob_id, data):
        threading.Timer(0.35, send, (cob_id, data)).start()

    node.network.send = send_later
    (found,) = map(json.loads, run(hub, "scan", "--json", "--no-lss", "--timeout", 2).output.splitlines())
    assert (found["name"], found["serial"]) == ("a foreign device", 0x2A)


def test_an_lss_device_that_refuses_or_is_not_there(hub, foreign_node):
    foreign_node(0xFF)  # without a store
    with pytest.raises(BusError, match="LSS Error: 1"):
        run(hub, "lss", "set", "0x35", "--address", "1234:404:10000:2A", "--store")
    with pytest.raises(BusError, match=r"0 unconfigured nodes \(none\), not one"):
        run(hub, "lss", "set", "0x36")
    with pytest.raises(BusError, match=r"does not respond|No LSS response"):
        run(hub, "lss", "set", "0x36", "--address", "1:2:3:4")


@pytest.mark.parametrize("text", ["1:2:3", "1:2:3:g", "", "1:2:3:123456789"])
def test_an_lss_address_has_four_parts(text):
    with pytest.raises(ConfigError, match="vendor:product:revision:serial"):
        parse_address(text)


@pytest.mark.parametrize("node", ["0", "128", "0x80", "ring"])
def test_node_ids_are_1_to_127(hub, node):
    assert run(hub, "sdo", "read", node, "1000").exit_code == 2


def test_names_of_objects():
    device = usual_device(0x10)
    assert find_object(device, "7130h:02") == (0x7130, 2)
    assert find_object(device, "0x1018:4") == (0x1018, 4)
    assert find_object(device, "Serial number") == (0x1018, 4)
    assert find_object(device, "identity object / vendor-id") == (0x1018, 1)
    with pytest.raises(ConfigError, match=r"has \d+ objects named"):
        find_object(device, "transmission type")


@pytest.mark.parametrize(
    ("key", "text", "data"),
    [
        ((0x6071, 0), "-2.5%", "e7ff"),  # -25 per mille
        ((0x6071, 0), "-25", "e7ff"),
        ((0x6076, 0), "1900 mN m", "6c070000"),
        ((0x6060, 0), "-1", "ff"),
        ((0x1800, 5), "0x10ms", None),
        ((0x1017, 0), "hex:0a00", "0a00"),
    ],
)
def test_values_as_a_person_writes_them(key, text, data):
    device = Device(1, "drive", CIA402_EDS)
    writable = device.variable(key).writable
    if data is None or not writable:
        with pytest.raises(ConfigError):
            encode(device, key, text)
    else:
        assert encode(device, key, text).hex() == data


def test_a_lost_hub_is_told_as_such(hub):
    hub.stop()
    done = subprocess.run(
        [sys.executable, "-m", "palpate_host.cli.main", "bus", "scan", "--channel", str(hub.path)],
        check=False,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 6
    assert "start the local hub (palpate-host bus hub" in done.stderr and len(done.stderr.splitlines()) == 1
