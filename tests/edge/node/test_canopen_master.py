"""A foreign master, the `canopen` package, against our slave: SDO, NMT, heartbeat, PDO by the EDS."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable
from pathlib import Path

import canopen
import pytest

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.contact import Contact
from palpate_edge.daemon.parameter_file import ParameterFile
from palpate_edge.daemon.parameter_store import save
from palpate_edge.node.eds import load_eds
from palpate_edge.node.emcy import ErrorRegister
from palpate_edge.node.events import StoreRequested
from palpate_edge.node.fingertip import FingertipNode
from palpate_edge.node.parsed_eds import FINGERTIP_EDS
from palpate_edge.node.slave import SlaveOutput

WAIT_S = 10.0


def contact(sequence: int) -> Contact:
    return Contact(
        sequence=sequence,
        exposed_at_us=123_456,
        valid=True,
        in_contact=True,
        position_mm=(3.0, -4.0, 12.5),
        normal_force_N=1.25,
        force_N=None,
        torsion_Nmm=-0.5,
        radius95_mm=0.42,
        quality=1.0,
        reason="",
        beads_found=30,
        beads_expected=31,
    )


@pytest.fixture
def master(fingertip: FingertipNode, canopen_master: Callable):
    with canopen_master(fingertip.process) as network:
        node = network.add_node(canopen.RemoteNode(0x10, str(FINGERTIP_EDS)))
        node.sdo.RESPONSE_TIMEOUT = WAIT_S
        yield node


def test_expedited_and_segmented_uploads(master: canopen.RemoteNode) -> None:
    assert master.sdo[0x1000].raw == 0x00020194
    assert master.sdo[0x1018][2].raw == 0x404
    assert master.sdo[0x1008].raw == "palpate fingertip"
    assert master.sdo[0x2001].raw == "0123456789abcdef"
    assert master.sdo[0x6131][4].raw == 0x00210000


def test_an_empty_text_is_uploaded(fingertip: FingertipNode, master: canopen.RemoteNode) -> None:
    fingertip.slave.write(0x2001, 0, "")
    assert master.sdo.upload(0x2001, 0) == b""


def test_download_and_abort(master: canopen.RemoteNode) -> None:
    master.sdo[0x1017].raw = 250
    assert master.sdo[0x1017].raw == 250
    with pytest.raises(canopen.SdoAbortedError) as refused:
        master.sdo[0x2000].raw = 1
    assert refused.value.code == 0x06010002
    with pytest.raises(canopen.SdoAbortedError) as refused:
        master.sdo.upload(0x5FFF, 0)
    assert refused.value.code == 0x06020000


def test_segmented_download(master: canopen.RemoteNode) -> None:
    with master.sdo.open(0x1017, 0, "wb", size=2, force_segment=True) as stream:
        stream.write(b"\x2c\x01")
    assert master.sdo[0x1017].raw == 300


def test_block_upload_and_download(fingertip: FingertipNode, master: canopen.RemoteNode) -> None:
    with master.sdo.open(0x1008, 0, "rb", block_transfer=True) as stream:
        assert stream.read() == b"palpate fingertip"
    text = b"left index finger, outer phalanx"
    with master.sdo.open(0x2003, 0, "wb", size=len(text), block_transfer=True) as stream:
        stream.write(text)
    assert fingertip.slave.read(0x2003) == text.decode()
    with master.sdo.open(0x2003, 0, "rb", block_transfer=True) as stream:
        assert stream.read() == text
    with pytest.raises(canopen.SdoAbortedError) as refused:
        master.sdo.open(0x2001, 0, "wb", size=4, block_transfer=True)
    assert refused.value.code == 0x06010002


def test_every_readable_object_of_the_eds(master: canopen.RemoteNode) -> None:
    for entry in load_eds(FINGERTIP_EDS, 0x10).entries.values():
        if entry.access.readable and (entry.index != 0x1003 or not entry.subindex):
            data = master.sdo.upload(entry.index, entry.subindex)
            assert entry.size_bytes in (None, len(data))


def newest_emergency(master: canopen.RemoteNode, code: int) -> canopen.emcy.EmcyError:
    """The package's own `wait` misses one that comes before it begins."""
    until = time.monotonic() + WAIT_S
    while not (master.emcy.log and master.emcy.log[-1].code == code):
        assert time.monotonic() < until, f"no EMCY {code:04X}h"
        time.sleep(0.01)
    return master.emcy.log[-1]


def test_an_emergency_arrives_and_goes(fingertip: FingertipNode, master: canopen.RemoteNode) -> None:
    fingertip.slave.emcy.report(0xFF01, ErrorRegister.MANUFACTURER, b"\x01\x02")
    emergency = newest_emergency(master, 0xFF01)
    assert (emergency.register, emergency.data) == (0x81, b"\x01\x02\x00\x00\x00")
    fingertip.slave.emcy.clear(0xFF01, b"\x01\x02")
    assert newest_emergency(master, 0).register == 0
    assert master.emcy.active == []
    assert master.sdo[0x1003][1].raw == 0x0201FF01


def test_our_heartbeat_consumer_watches_the_master(master: canopen.RemoteNode) -> None:
    master.sdo[0x1016][1].raw = 0x7F << 16 | 300
    master.network.send_message(0x77F, b"\x05")
    assert newest_emergency(master, 0x8130).data[0] == 0x7F
    master.network.send_message(0x77F, b"\x05")
    newest_emergency(master, 0)


def test_sync_with_a_counter(master: canopen.RemoteNode) -> None:
    master.sdo[0x1019].raw = 20
    master.tpdo.read()
    pdo = master.tpdo[1]
    pdo.trans_type, pdo.sync_start_value = 2, 3
    pdo.save()
    assert master.sdo[0x1800][6].raw == 3
    arrived: queue.Queue[int] = queue.Queue()
    pdo.add_callback(lambda _: arrived.put(1))
    master.nmt.state = "OPERATIONAL"
    while master.nmt.wait_for_heartbeat(WAIT_S) != "OPERATIONAL":
        pass
    for number in range(1, 8):  # 3 is the first that counts: 4 and 6 are answered
        master.network.send_message(0x080, bytes([number]))
    for _ in range(2):
        arrived.get(timeout=WAIT_S)
    assert master.sdo[0x1000].raw == 0x00020194  # all before is served
    assert arrived.empty()


def test_store_and_restore(
    tmp_path: Path, fingertip: FingertipNode, canopen_master: Callable, boots_after: Callable
) -> None:
    file = ParameterFile(tmp_path / "parameters")

    def process(now_us: int, frames: tuple[CanFrame, ...]) -> SlaveOutput:
        output = fingertip.process(now_us, frames)
        for event in output.events:
            if isinstance(event, StoreRequested):
                fingertip.slave.store_finished(save(file, event.parameters).stored)
        return output

    with canopen_master(process) as network:
        node = network.add_node(canopen.RemoteNode(0x10, str(FINGERTIP_EDS)))
        node.sdo.RESPONSE_TIMEOUT = WAIT_S
        node.sdo[0x1017].raw = 60
        node.store()
        assert file.load().objects == {(0x1017, 0): 60}
        assert boots_after(network, 0x81, 0x10)
        assert node.sdo[0x1017].raw == 60
        node.restore()
        assert boots_after(network, 0x81, 0x10)
        assert node.sdo[0x1017].raw == 100


def test_nmt_heartbeat_and_pdo(fingertip: FingertipNode, master: canopen.RemoteNode) -> None:
    master.sdo[0x1017].raw = 20
    assert master.nmt.wait_for_heartbeat(WAIT_S) == "PRE-OPERATIONAL"
    master.tpdo.read()
    arrived = {number: threading.Event() for number in (1, 2, 3, 5)}
    for number, event in arrived.items():
        master.tpdo[number].add_callback(lambda _, event=event: event.set())
    master.nmt.state = "OPERATIONAL"
    while master.nmt.wait_for_heartbeat(WAIT_S) != "OPERATIONAL":
        pass
    fingertip.publish(contact(sequence=77), latency_us=9_000)
    for event in arrived.values():
        assert event.wait(WAIT_S)
    first, second, third, fifth = (master.tpdo[number] for number in (1, 2, 3, 5))
    assert [variable.raw for variable in first] == [300, -400, 1250, 1250]
    assert [variable.raw for variable in second] == [0, 0, -50, 5, 255]
    assert [variable.raw for variable in third] == [123_456, 77, 9_000]
    assert [variable.raw for variable in fifth] == [77, 42, -0x8000, -0x8000]


def test_remapping_a_pdo(fingertip: FingertipNode, master: canopen.RemoteNode) -> None:
    master.tpdo.read()
    pdo = master.tpdo[4]
    pdo.clear()
    pdo.add_variable(0x2013)
    pdo.add_variable(0x2011)
    pdo.trans_type = 255
    pdo.event_timer = 10
    pdo.enabled = True
    pdo.save()
    arrived = threading.Event()
    pdo.add_callback(lambda _: arrived.set())
    fingertip.publish(contact(sequence=513), latency_us=0)
    master.nmt.state = "OPERATIONAL"
    assert arrived.wait(WAIT_S)
    assert pdo.data == bytearray([0x01, 0x02, 255])


def test_reset_gives_boot_up_and_defaults(master: canopen.RemoteNode) -> None:
    master.sdo[0x1017].raw = 0
    booted = threading.Event()  # wait_for_bootup() misses one that comes before it waits
    master.network.subscribe(0x710, lambda _id, data, _stamp: data == b"\0" and booted.set())
    master.nmt.send_command(0x82)
    assert booted.wait(WAIT_S)
    assert master.sdo[0x1017].raw == 100
