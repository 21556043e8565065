"""A foreign slave and a foreign master on python-can's virtual bus, and everything they say.

durand 0.5.0 is the slave (MIT; faults of its own: transmission type n, mapping is empty at the start), the
canopen package the master.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import can
import canopen
import durand
from durand.datatypes import DatatypeEnum
from durand.network import CANBusNetwork
from durand.object_dictionary import Record, Variable
from durand.scheduler import SyncScheduler, get_scheduler, set_scheduler

from palpate_bus.logs.candump import LogRecord
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.node.eds import load_eds

WAIT_S = 60.0  # for threads on a busy machine


@dataclass
class Recorder(can.Listener):
    """Every frame, in the order of the bus."""

    records: list[LogRecord] = field(default_factory=list)

    def on_message_received(self, msg: can.Message) -> None:
        frame = CanFrame(msg.arbitration_id, bytes(msg.data), msg.is_remote_frame)
        self.records.append(LogRecord(round(msg.timestamp * 1e6), frame))

    def wait_for(self, can_id: int, start: int = 0) -> CanFrame:
        """The first frame with this identifier from `start` on."""
        end_s = time.monotonic() + WAIT_S
        while time.monotonic() < end_s:
            for record in self.records[start:]:
                if record.frame.can_id == can_id:
                    return record.frame
            time.sleep(0.005)
        raise AssertionError(f"no frame {can_id:03X} came")


class CountedRecord(Record):
    """A record whose sub-index 0 is the number of mapped objects; durand's own is the number of entries."""

    def __init__(self, count):
        super().__init__()
        self._count = Variable(DatatypeEnum.UNSIGNED8, "const", value=count)

    def __getitem__(self, subindex):
        return super().__getitem__(subindex) if subindex else self._count


def durand_of_eds(network, node_id, eds):
    """A durand node with every object of an EDS that it does not bring itself, and its mapped PDOs."""
    node = durand.Node(
        network, node_id, capabilities=durand.node.NodeCapabilities(sdo_servers=1, rpdos=4, tpdos=9)
    )
    od = load_eds(eds, node_id)
    records: dict[int, Record] = {}
    for (index, subindex), entry in od.entries.items():
        if index in node.object_dictionary and index not in (0x1000, 0x1008, 0x100A, 0x1018):
            continue
        if subindex == 0 and (index, 1) in od.entries:
            continue
        default = entry.default.encode() if isinstance(entry.default, str) else entry.default
        access = "rw" if entry.access.value.startswith("rw") else entry.access.value
        variable = Variable(DatatypeEnum(int(entry.data_type)), access, default, name=entry.name)
        if (index, 0) in od.entries and (index, 1) in od.entries:
            records.setdefault(index, CountedRecord(od.default_number(index, 0)))[subindex] = variable
        else:
            node.object_dictionary[index] = variable
    for index, record in records.items():
        node.object_dictionary[index] = record
    for number in range(4):
        if 0x1400 + number in od.indices:
            cob_id = od.default_number(0x1400 + number, 1)
            node.object_dictionary.write(0x1400 + number, 1, cob_id, downloaded=True)
            count = od.default_number(0x1600 + number, 0)
            words = [od.default_number(0x1600 + number, 1 + slot) for slot in range(count)]
            node.rpdo[number].mapping = [(word >> 16, word >> 8 & 0xFF) for word in words]
    for number in range(9):
        if 0x1A00 + number in od.indices:
            count = od.default_number(0x1A00 + number, 0)
            words = [od.default_number(0x1A00 + number, 1 + slot) for slot in range(count)]
            node.tpdo[number].mapping = [(word >> 16, word >> 8 & 0xFF) for word in words]
            node.tpdo[number].transmission_type = 254
            if number >= 4:  # durand knows the identifiers of four TPDOs
                cob_id = od.default_number(0x1800 + number, 1)
                node.object_dictionary.write(0x1800 + number, 1, cob_id, downloaded=True)
    return node


@contextmanager
def virtual_network(channel: str, node_count: int = 0) -> Iterator[tuple[canopen.Network, list, Recorder]]:
    """A canopen master, so many networks for slaves, and a recorder, on one channel."""
    buses = [can.Bus(interface="virtual", channel=channel) for _ in range(2 + node_count)]
    former, scheduler = get_scheduler(), SyncScheduler()
    set_scheduler(scheduler)
    timers = threading.Thread(target=scheduler.run, daemon=True)
    timers.start()
    recorder = Recorder()
    recording = can.Notifier(buses[1], [recorder], timeout=0.01)
    slaves = [CANBusNetwork(bus) for bus in buses[2:]]
    master = canopen.Network(buses[0])
    master.connect()
    try:
        yield master, slaves, recorder
    finally:
        scheduler.stop()
        recording.stop()
        while (message := buses[1].recv(0)) is not None:  # what a busy machine has left
            recorder.on_message_received(message)
        for slave in slaves:
            slave.stop()
        master.disconnect()
        for bus in buses[1:]:
            bus.shutdown()
        timers.join(WAIT_S)
        set_scheduler(former)
