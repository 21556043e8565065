"""Our host against a slave that is not ours: durand with the objects of firmware/fingertip.eds as finger-1.

In virtual time inside the host's bench, hence without threads; the mapping check by SDO on python-can's
virtual bus. durand's own faults are met as they are: it maps nothing by itself and never sends a type 254.
"""

from __future__ import annotations

import importlib.util
import sys
from dataclasses import dataclass
from pathlib import Path

import durand
import durand.network
import mujoco  # noqa: F401 - here, since its first import starts a process, which no test may
import pytest
from durand.scheduler import VirtualScheduler, get_scheduler, set_scheduler

from palpate_bus.decode.device import Device
from palpate_bus.master.node_check import differences
from palpate_bus.master.sdo_access import read_number
from palpate_bus.master.session import sdo_client
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.node.fingertip_objects import encode_contact
from palpate_edge.node.parsed_eds import FINGERTIP_EDS
from palpate_host.common.mode import Mode

BENCH = Path(__file__).parents[2] / "host" / "virtual_bench.py"
NODE = 0x10


def load_bench():
    name = "palpate_virtual_bench"
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, BENCH)
        sys.modules[name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules[name])
    return sys.modules[name]


class Frames(durand.network.NetworkABC):
    """A bus without a bus: what the node sends is kept, what it hears is handed in."""

    def __init__(self):
        self.sent, self.heard = [], {}

    def add_subscription(self, cob_id, callback):
        self.heard[cob_id] = callback

    def remove_subscription(self, cob_id):
        self.heard.pop(cob_id)

    def send(self, cob_id, msg):
        self.sent.append(CanFrame(cob_id, bytes(msg)))


@dataclass
class Sent:
    """What `FingertipNode.process` gives. next_due_us: it tells nobody, so it is asked all the time."""

    frames_out: tuple[CanFrame, ...]
    next_due_us: int = 0


class ForeignTip:
    """durand in the place of a FingertipNode of the bench."""

    def __init__(self, foreign, scheduler):
        self.network, self.scheduler, self.now_us = Frames(), scheduler, None
        self.node = foreign.durand_of_eds(self.network, NODE, FINGERTIP_EDS)
        self.node.object_dictionary.write(0x1017, 0, 100)
        self.slave = self
        self.node_id = NODE

    def process(self, now_us, frames):
        self.scheduler.run((now_us - (self.now_us or now_us)) / 1e6)
        self.now_us = now_us
        for frame in frames:
            if frame.can_id in self.network.heard:
                self.network.heard[frame.can_id](frame.can_id, frame.data)
        sent, self.network.sent = self.network.sent, []
        return Sent(tuple(sent))

    def publish(self, contact, latency_us):
        od = self.node.object_dictionary
        for (index, subindex), value in encode_contact(contact, latency_us).items():
            od.write(index, subindex, int(value))
        for number in (0, 1, 4, 2):  # durand counts from 0; TPDO 3 is the last of a contact
            if self.node.nmt.state == 5:
                self.node.tpdo[number].transmit()


@pytest.fixture
def rig(foreign):
    """The bench with durand as finger-1."""
    bench = load_bench()
    former, scheduler = get_scheduler(), VirtualScheduler()
    set_scheduler(scheduler)
    config, hand = bench.load_table_4()
    rig = bench.VirtualBench(config, hand, feel=lambda *_: (1.5, -4.0, 29.7))
    rig.tips[0] = ForeignTip(foreign, scheduler)
    yield rig
    set_scheduler(former)


def test_the_host_starts_it_and_takes_its_contacts(rig):
    status = rig.run(2.0)
    assert status.mode is Mode.MANIPULATE
    finger = status.fingers[0]
    assert finger.position_mm == pytest.approx((1.5, -4.0, 29.7), abs=0.01)
    assert finger.normal_force_N == pytest.approx(1.0, abs=0.001)
    assert finger.frames_per_s == pytest.approx(30, abs=2)
    assert finger.incomplete == finger.out_of_order == finger.late == finger.extra_missing == 0
    assert finger.radius95_mm == 0.35
    starts = [frame for _, frame in rig.log if frame == CanFrame(0x000, bytes((1, NODE)))]
    assert len(starts) == 1


def test_its_emergency_is_heard_and_stops_nothing(rig):
    rig.run(1.5)
    rig.tips[0].node.emcy.set(0x4210, 0x09)
    status = rig.run(0.2)
    assert status.last_emergency == "fingertip of finger-1 (node 0x10): EMCY 4210h"
    assert status.mode is Mode.MANIPULATE


def test_its_lost_heartbeat_leaves_only_the_grasp(rig):
    config, _ = load_bench().load_table_4()
    rig.run(1.5)
    beats = [at for at, frame in rig.log if frame == CanFrame(0x700 + NODE, b"\x05")]
    rig.tips[0].node.object_dictionary.write(0x1017, 0, 0)
    rig.run(1.0)
    hold = next(status for status in rig.statuses if status.reason == "finger-1: heartbeat lost")
    assert hold.mode is Mode.HOLD
    silent_us = hold.time_us - beats[-1]
    assert 0 < silent_us - config.network.heartbeat_timeout_ms * 1000 <= 10_000


def test_its_restart_is_seen_and_it_is_started_again(rig):
    rig.run(1.5)
    rig.tips[0].node.nmt.reset()
    status = rig.run(1.5)
    starts = [at for at, frame in rig.log if frame == CanFrame(0x000, bytes((1, NODE)))]
    assert len(starts) == 2
    assert status.mode is Mode.MANIPULATE


@pytest.mark.long
def test_its_mapping_is_checked_by_sdo(foreign):
    """The mapping is that of the EDS; one changed object is named."""
    device = Device(NODE, "finger-1", FINGERTIP_EDS)
    with foreign.virtual_network("mapping", 1) as (master, (network,), _):
        node = foreign.durand_of_eds(network, NODE, FINGERTIP_EDS)
        client = sdo_client(master, NODE, 30.0)

        def found():
            lines = differences(device, lambda key: read_number(client, NODE, device, key))
            return [line for line in lines if line.startswith(("18", "1A"))]  # durand's RPDOs are its own

        assert found() == []
        node.tpdo[0].mapping = [(0x7130, 2), (0x7130, 1), (0x7130, 3), (0x7130, 4)]
        mapping = "TPDO 1 mapping parameter"
        assert found() == [
            f"1A00h:01 {mapping} / Mapped object 1: 0x71300210 in the node, 0x71300110 in the EDS",
            f"1A00h:02 {mapping} / Mapped object 2: 0x71300110 in the node, 0x71300210 in the EDS",
        ]
