"""What our code and strangers' code expect of a bus: of the hub, and of the kernel's SocketCAN."""

from __future__ import annotations

import select
import subprocess
import sys

import can
import canopen
import msgspec

from palpate_edge.can_bus.bus import BusConfig
from palpate_edge.can_bus.can_frame import CanFrame

PATIENCE_S = 20.0

ECHO = """
import sys
import msgspec
from palpate_edge.can_bus.bus import BusConfig, open_bus
from palpate_edge.can_bus.can_frame import CanFrame
config, number = msgspec.json.decode(sys.argv[1], type=BusConfig), int(sys.argv[2])
with open_bus(config, f"echo-{number}", [0x80, 0x600 + number]) as bus:
    bus.send([CanFrame(0x700 + number, b"\\0")])
    while True:
        for stamp_us, frame in bus.receive(20):
            if frame.can_id != 0x80:
                sys.exit(0)
            bus.send([CanFrame(0x180 + number, frame.data)])
"""


def message(can_id, data=b"", **options):
    return can.Message(arbitration_id=can_id, data=data, is_extended_id=False, **options)


def receive(bus, count):
    frames = []
    while len(frames) < count:
        batch = bus.receive(PATIENCE_S)
        assert batch, f"{len(frames)} of {count} frames arrived"
        frames += batch
    return frames


def test_several_processes_talk(any_bus: BusConfig, open_edge):
    master = open_edge("master")
    config = msgspec.json.encode(any_bus).decode()
    echoes = [subprocess.Popen([sys.executable, "-c", ECHO, config, str(n)]) for n in (1, 2, 3)]
    receive(master, 3)
    for round_number in range(10):
        master.send([CanFrame(0x80, bytes([round_number]))])
        assert {(frame.can_id, frame.data) for _, frame in receive(master, 3)} == {
            (0x180 + n, bytes([round_number])) for n in (1, 2, 3)
        }
    master.send([CanFrame(0x600 + n) for n in (1, 2, 3)])
    assert [echo.wait(timeout=30) for echo in echoes] == [0, 0, 0]


def test_remote_frames_and_own_frames(any_bus, open_port):
    a, b = open_port("a", receive_own_messages=True), open_port("b")
    a.send(message(0x701, is_remote_frame=True, dlc=3))
    own, other = a.recv(PATIENCE_S), b.recv(PATIENCE_S)
    assert (own.is_remote_frame, own.dlc, own.is_rx) == (True, 3, False)
    assert (other.is_remote_frame, other.dlc) == (True, 3)
    # The kernel calls every frame of its own machine sent; the hub stands for a cable between machines.
    assert other.is_rx == (any_bus.interface == "palpate")
    assert own.timestamp == other.timestamp


def test_nobody_hears_himself_unless_asked(any_bus, open_port):
    a, b = open_port("a"), open_port("b")
    a.send(message(0x100))
    b.send(message(0x101))
    assert (a.recv(PATIENCE_S).arbitration_id, b.recv(PATIENCE_S).arbitration_id) == (0x101, 0x100)


def test_the_descriptor_stays_readable_while_something_is_pending(any_bus, open_port):
    a, b = open_port("a"), open_port("b")
    for number in range(5):
        a.send(message(number))
    taken = []
    while len(taken) < 5:
        readable, _, _ = select.select([b.fileno()], [], [], PATIENCE_S)
        assert readable
        if (one := b.recv(0)) is not None:
            taken.append(one.arbitration_id)
    assert taken == [0, 1, 2, 3, 4]
    assert select.select([b.fileno()], [], [], 0) == ([], [], [])


def test_only_what_passes_the_filter_arrives(any_bus, open_port):
    a, b = open_port("a"), open_port("b", can_filters=[{"can_id": 0x180, "can_mask": 0x780}])
    for can_id in (0x200, 0x18F, 0x080, 0x180):
        a.send(message(can_id))
    assert [b.recv(PATIENCE_S).arbitration_id for _ in range(2)] == [0x18F, 0x180]


def test_can_notifier(any_bus, open_port):
    a, b = open_port("a"), open_port("b")
    reader = can.BufferedReader()
    with can.Notifier(b, [reader], timeout=0.1):
        for number in range(20):
            a.send(message(number), timeout=PATIENCE_S)
        assert [reader.get_message(PATIENCE_S).arbitration_id for _ in range(20)] == list(range(20))


def test_canopen_master_and_slave_of_the_canopen_package(any_bus):
    """A foreign master and a foreign slave: SDO upload and download, NMT, heartbeat across the bus."""
    dictionary = canopen.ObjectDictionary()
    variable = canopen.objectdictionary.ODVariable("producer heartbeat time", 0x1017, 0)
    variable.data_type = canopen.objectdictionary.datatypes.UNSIGNED16
    variable.access_type = "rw"
    variable.default = 0
    dictionary.add_object(variable)
    with canopen.Network() as master_net, canopen.Network() as slave_net:
        for network in (master_net, slave_net):
            network.connect(interface=any_bus.interface, channel=any_bus.channel)
        slave = slave_net.create_node(5, dictionary)
        remote = master_net.add_node(5, dictionary)
        remote.sdo.RESPONSE_TIMEOUT = PATIENCE_S
        remote.sdo[0x1017].raw = 50
        assert remote.sdo[0x1017].raw == 50
        slave.nmt.state = "OPERATIONAL"
        remote.nmt.wait_for_heartbeat(PATIENCE_S)
        slave.nmt.stop_heartbeat()
