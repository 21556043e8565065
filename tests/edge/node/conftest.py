"""A slave on python-can's in-process bus, and the pieces that the node tests share."""

from __future__ import annotations

import threading
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import can
import canopen
import pytest

from kernel_guest.kernels import IN_A_KERNEL
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.node.eds import load_eds
from palpate_edge.node.fingertip import FingertipNode
from palpate_edge.node.fingertip_objects import MethodCode
from palpate_edge.node.object_dictionary import ObjectDictionary
from palpate_edge.node.parsed_eds import FINGERTIP_EDS
from palpate_edge.node.slave import Slave, SlaveOutput

PROJECT = Path(__file__).resolve().parents[3]
DRIVE_EDS = PROJECT / "host" / "palpate_bus" / "eds" / "cia402.eds"
NODE_ID = 0x10

Process = Callable[[int, tuple[CanFrame, ...]], SlaveOutput]


@pytest.fixture
def fingertip_od() -> ObjectDictionary:
    return load_eds(FINGERTIP_EDS, NODE_ID)


@pytest.fixture
def drive_od() -> ObjectDictionary:
    return load_eds(DRIVE_EDS, NODE_ID)


@pytest.fixture
def fingertip() -> FingertipNode:
    return FingertipNode(NODE_ID, MethodCode.CORRECTED, "0123456789abcdef0123")


@pytest.fixture
def operational() -> Callable[[Slave], Slave]:
    """Bring a slave to OPERATIONAL at time 0."""

    def bring(slave: Slave) -> Slave:
        slave.process(0, [CanFrame(0x000, bytes([0x01, 0x00]))])
        return slave

    return bring


@pytest.fixture
def sdo() -> Callable[[Slave, str], str | None]:
    """One SDO request of node 0x10, as hexadecimal text, and its answer."""

    def ask(slave: Slave, request: str) -> str | None:
        output = slave.process(1, [CanFrame(0x610, bytes.fromhex(request))])
        answers = [frame.data.hex(" ") for frame in output.frames_out if frame.can_id == 0x590]
        assert len(answers) <= 1
        return answers[0] if answers else None

    return ask


@contextmanager
def master_of(*nodes: Process, interface: str, channel: str) -> Iterator[canopen.Network]:
    """A master of the `canopen` package on a bus of its own, with a thread that serves `nodes`.

    What several nodes say at once and alike (as LSS asks of them) is one frame, as it is on a wire.
    """
    with can.Bus(channel, interface=interface) as slave_bus:
        stop = threading.Event()

        def serve() -> None:
            frames: tuple[CanFrame, ...] = ()
            while not stop.is_set():
                now_us = time.monotonic_ns() // 1000
                answers = [frame for node in nodes for frame in node(now_us, frames).frames_out]
                for frame in dict.fromkeys(answers) if len(nodes) > 1 else answers:
                    slave_bus.send(
                        can.Message(arbitration_id=frame.can_id, data=frame.data, is_extended_id=False)
                    )
                message = slave_bus.recv(0.005)
                frames = ()
                if message is not None:
                    frames = (CanFrame(message.arbitration_id, bytes(message.data), message.is_remote_frame),)

        network = canopen.Network()
        network.NOTIFIER_CYCLE = 0.05  # its reader waits this long before it ends
        network.connect(channel=channel, interface=interface)
        thread = threading.Thread(target=serve)
        thread.start()
        try:
            yield network
        finally:
            stop.set()
            thread.join()
            network.disconnect()


@pytest.fixture(params=["virtual", *IN_A_KERNEL])
def canopen_master(request: pytest.FixtureRequest) -> Callable[..., object]:
    """`master_of` on python-can's in-process bus, and on vcan0 in a kernel that has SocketCAN."""
    if request.param == "virtual":
        return partial(master_of, interface="virtual", channel=uuid.uuid4().hex)
    return partial(master_of, interface="socketcan", channel=request.getfixturevalue("vcan").name)


@pytest.fixture
def boots_after() -> Callable[[canopen.Network, int, int], bool]:
    """Send an NMT command to all nodes; whether one of the id boots up then.

    `wait_for_bootup` of the package misses a boot-up that comes before it waits.
    """

    def boots(network: canopen.Network, command: int, node_id: int) -> bool:
        seen = threading.Event()

        def listen(_can_id: int, data: bytearray, _stamp: float) -> None:
            if data == b"\x00":
                seen.set()

        network.subscribe(0x700 + node_id, listen)
        network.nmt.send_command(command)
        came = seen.wait(10.0)
        network.unsubscribe(0x700 + node_id, listen)
        return came

    return boots
