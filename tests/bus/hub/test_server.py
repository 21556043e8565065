"""A hub as a process and clients on it, in this and in other processes."""

from __future__ import annotations

import errno
import random
import select
import signal
import socket
import stat
import threading
import time
from itertools import pairwise

import can
import pytest

from palpate_bus.hub import protocol
from palpate_bus.hub.connection import ask
from palpate_bus.hub.control import AskStatistics, ClearFaults, Inject, Statistics
from palpate_bus.hub.faults import FaultKind, FaultRule
from palpate_bus.load.bit_count import frame_bits
from palpate_bus.logs.candump import read_log
from palpate_edge.can_bus.bus import BusConfig, open_bus
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.errors import BusError

PATIENCE_S = 20.0


def message(can_id, data=b"", **options):
    return can.Message(arbitration_id=can_id, data=data, is_extended_id=False, **options)


def statistics(hub) -> Statistics:
    reply = ask(hub.path, AskStatistics())
    assert isinstance(reply, Statistics)
    return reply


def inject(hub, kind, **fields):
    ask(hub.path, Inject(FaultRule(kind=kind, **fields)))


def receive_count(bus, count):
    frames = []
    while len(frames) < count:
        batch = bus.receive(PATIENCE_S)
        assert batch, f"{len(frames)} of {count} frames arrived"
        frames += batch
    return frames


def test_stamps_are_of_the_wire(hub, open_edge):
    listener, senders = open_edge("listener"), [open_edge(f"finger-{number}") for number in (1, 2, 3)]
    before_us = time.time_ns() // 1000
    for number, sender in enumerate(senders):
        sender.send([CanFrame(0x180 + number, bytes([number]))])
    heard = receive_count(listener, 3)
    after_us = time.time_ns() // 1000
    stamps = [stamp_us for stamp_us, _ in heard]
    assert before_us <= stamps[0]
    assert stamps[-1] <= after_us
    gaps_us = [later - earlier for earlier, later in pairwise(stamps)]
    assert all(gap >= frame_bits(frame) for gap, (_, frame) in zip(gaps_us, heard, strict=False))


def test_filters_act_in_the_hub(hub, open_port):
    a, b = open_port("a"), open_port("b", can_filters=[{"can_id": 0x180, "can_mask": 0x780}])
    for can_id in (0x200, 0x18F, 0x080, 0x180):
        a.send(message(can_id))
    assert [b.recv(PATIENCE_S).arbitration_id for _ in range(2)] == [0x18F, 0x180]
    b.set_filters([{"can_id": 0x700, "can_mask": 0x7FF, "extended": False}])
    statistics(hub)  # the hub has taken the filters
    for can_id in (0x180, 0x700):
        a.send(message(can_id))
    assert b.recv(PATIENCE_S).arbitration_id == 0x700
    assert {port.name: port.delivered for port in statistics(hub).ports}["b"] == 3


@pytest.mark.parametrize(
    "odd",
    [
        can.Message(arbitration_id=0x12345, is_extended_id=True),
        can.Message(arbitration_id=0x123, is_extended_id=False, is_fd=True, data=bytes(12)),
        can.Message(arbitration_id=0x800, is_extended_id=False),
        can.Message(arbitration_id=0x1, is_extended_id=False, data=bytes(9)),
        can.Message(is_error_frame=True),
    ],
    ids=["29 bit", "FD", "12 bit", "9 bytes", "error frame"],
)
def test_what_classic_canopen_has_not_is_refused(hub, open_port, odd):
    with pytest.raises(can.CanOperationError) as refusal:
        open_port("a").send(odd)
    assert refusal.value.error_code == errno.EINVAL


def test_a_full_transmit_queue_is_enobufs_and_drains(start_hub, open_port):
    start_hub("--txqueuelen", "4", "--bitrate", "10000")  # a frame takes 5 ms and more
    port = open_port("a")
    for _ in range(5):  # four wait, one may be on the wire with its credit still owed
        try:
            port.send(message(0x100, bytes(8)))
        except can.CanOperationError as error:
            refusal = error
            break
    assert refusal.error_code == errno.ENOBUFS
    port.send(message(0x100), timeout=PATIENCE_S)


def test_the_edge_bus_retries_enobufs_with_a_bound_and_counts(start_hub, open_edge):
    hub = start_hub()
    bus = open_edge("a")
    inject(hub, FaultKind.TX_FULL, port="a", count=3)
    bus.send([CanFrame(0x100)])
    assert (bus.counters.send_retries, bus.counters.sent) == (3, 1)
    inject(hub, FaultKind.TX_FULL, port="a")
    with pytest.raises(BusError, match="transmit queue full, frame 101"):
        bus.send([CanFrame(0x101)])
    ask(hub.path, ClearFaults())
    bus.send([CanFrame(0x102)])
    assert {port.name: port.refused for port in statistics(hub).ports}["a"] > 3


def test_frames_wait_for_a_hub_that_the_machine_does_not_run_for_a_moment(hub, open_edge):
    """Ten times as many frames as the queue holds, into a hub that stands for 0.2 s, as on a busy PC."""
    listener, sender = open_edge("listener"), open_edge("a")
    sent = [CanFrame(0x180, bytes([number])) for number in range(160)]
    hub.process.send_signal(signal.SIGSTOP)
    go_on = threading.Timer(0.2, hub.process.send_signal, [signal.SIGCONT])
    go_on.start()
    sender.send(sent)
    go_on.join()
    assert [frame for _, frame in receive_count(listener, len(sent))] == sent
    assert sender.counters.send_retries >= 8


def test_bus_off_is_an_error_frame_a_state_and_a_refusal(hub, open_port):
    port = open_port("a")
    inject(hub, FaultKind.BUS_OFF, port="a")
    error_frame = port.recv(PATIENCE_S)
    assert error_frame.is_error_frame
    assert error_frame.arbitration_id == 0x40  # CAN_ERR_BUSOFF of linux/can/error.h
    assert port.state is can.BusState.ERROR
    with pytest.raises(can.CanOperationError) as refusal:
        port.send(message(1))
    assert refusal.value.error_code == errno.ENETDOWN
    ask(hub.path, ClearFaults())
    assert port.recv(PATIENCE_S).arbitration_id == 0x100  # CAN_ERR_RESTARTED
    assert port.state is can.BusState.ACTIVE
    port.send(message(1))


def test_bus_off_raises_from_the_edge_bus(hub, open_edge):
    bus = open_edge("a")
    inject(hub, FaultKind.BUS_OFF, port="a")
    with pytest.raises(BusError, match="went bus-off: check wiring"):
        bus.receive(PATIENCE_S)
    with pytest.raises(BusError, match="bus-off"):
        bus.send([CanFrame(1)])


BURST = [CanFrame(0x100 + number, bytes([number])) for number in range(10)]


@pytest.mark.parametrize("odd", [None, CanFrame(0x300, remote=True)])
def test_a_burst_arrives_in_order(hub, open_edge, odd):
    """A remote frame in its midst is no part of the one message in which the others travel."""
    burst = [*BURST[:5], *([odd] if odd else []), *BURST[5:]]
    sender, receiver = open_edge("a"), open_edge("b")
    sender.send(iter(burst))
    assert [frame for _, frame in receive_count(receiver, len(burst))] == burst
    assert sender.counters.sent == len(burst)
    assert statistics(hub).frames == len(burst)


def test_a_burst_fills_the_queue_and_no_more(start_hub, open_port):
    hub = start_hub("--txqueuelen", "4", "--bitrate", "10000")  # a frame takes 5 ms and more
    receiver = open_port("b")
    with open_bus(BusConfig(interface="palpate", channel=str(hub.path), bitrate=10_000), "a") as sender:
        assert sender.try_send(BURST) == 4
    assert [receiver.recv(PATIENCE_S).arbitration_id for _ in range(4)] == [0x100, 0x101, 0x102, 0x103]
    assert receiver.recv(0.1) is None


def test_a_burst_longer_than_the_queue_waits_for_room(start_hub, open_edge):
    start_hub("--txqueuelen", "64")
    sender, receiver = open_edge("a"), open_edge("b")
    burst = [CanFrame(number) for number in range(200)]
    sender.send(burst)
    assert [frame for _, frame in receive_count(receiver, len(burst))] == burst
    assert sender.counters.sent == len(burst)


def test_a_fault_asks_after_each_frame_of_a_burst(hub, open_edge):
    sender, receiver = open_edge("a"), open_edge("b")
    inject(hub, FaultKind.TX_FULL, port="a", count=3, can_id=0x104, mask=0x7FF)
    sender.send(BURST)
    assert [frame for _, frame in receive_count(receiver, len(BURST))] == BURST
    assert (sender.counters.send_retries, sender.counters.sent) == (3, len(BURST))


def test_a_burst_ends_at_what_classic_canopen_has_not(hub, open_edge):
    sender, receiver = open_edge("a"), open_edge("b")
    with pytest.raises(BusError, match="no CAN frame: identifier 0x800"):
        sender.send([*BURST[:3], CanFrame(0x800), *BURST[3:]])
    sender.send(BURST[:1])
    assert [frame for _, frame in receive_count(receiver, 4)] == [*BURST[:3], BURST[0]]


def test_a_burst_at_bus_off_is_refused(hub, open_edge):
    sender = open_edge("a")
    inject(hub, FaultKind.BUS_OFF, port="a")
    with pytest.raises(BusError, match="cannot send: a is bus-off"):
        sender.send(BURST)
    assert sender.counters.sent == 0


def test_without_a_hub_the_error_says_how_to_start_one(tmp_path, open_port, open_edge):
    with pytest.raises(
        can.CanInitializationError, match=r"start the local hub .palpate-host bus hub --socket .*hub\.sock"
    ):
        open_port("a")
    with pytest.raises(BusError, match="palpate-host bus hub"):
        open_edge("a")


def test_a_killed_hub_is_a_clear_error_after_what_it_delivered(hub, open_port, open_edge):
    a, b, edge = open_port("a"), open_port("b"), open_edge("edge")
    a.send(message(0x123))
    for listener in (b, edge):
        assert select.select([listener.fileno()], [], [], PATIENCE_S)[0]
    hub.kill()
    assert b.recv(PATIENCE_S).arbitration_id == 0x123
    with pytest.raises(can.CanOperationError, match="has stopped: start it with"):
        b.recv(PATIENCE_S)
    with pytest.raises(can.CanOperationError, match="has stopped"):
        a.send(message(1))
    receive_count(edge, 1)
    with pytest.raises(BusError, match="has stopped"):
        edge.receive(PATIENCE_S)


def test_a_stale_socket_is_replaced_and_removed_at_exit(start_hub, open_port):
    first = start_hub()
    first.kill()
    assert first.path.exists()
    second = start_hub()
    assert stat.S_IMODE(second.path.stat().st_mode) == 0o600
    open_port("a").send(message(1))
    assert "frames" in second.stop()
    assert not second.path.exists()


def test_a_second_hub_is_refused_and_the_first_lives(hub, start_hub, open_port):
    second = start_hub()
    assert second.process.wait(timeout=30) != 0
    said = second.first_line + second.process.communicate()[1]
    assert "a hub already listens there" in said
    a, b = open_port("a"), open_port("b")
    a.send(message(1))
    assert b.recv(PATIENCE_S) is not None


def test_a_file_that_is_no_socket_is_left_alone(start_hub, tmp_path):
    (tmp_path / "hub.sock").write_text("precious")
    hub = start_hub()
    assert hub.process.wait(timeout=30) != 0
    assert "is not a socket" in hub.first_line + hub.process.communicate()[1]
    assert (tmp_path / "hub.sock").read_text() == "precious"


def test_noise_on_the_socket_costs_only_the_noisy_client(hub, open_port):
    a, b = open_port("a"), open_port("b")
    noise = random.Random(11)
    for _ in range(50):
        with socket.socket(socket.AF_UNIX) as stranger:
            stranger.connect(str(hub.path))
            stranger.sendall(noise.randbytes(noise.randint(8, 400)))
            stranger.settimeout(PATIENCE_S)
            reply = stranger.recv(4096)
            assert reply == b"" or next(protocol.Splitter().feed(reply))[0] is protocol.Kind.REJECT
    a.send(message(5))
    assert b.recv(PATIENCE_S).arbitration_id == 5
    assert statistics(hub).garbled_clients == 50


def test_a_client_that_does_not_read_blocks_nobody_and_hears_of_its_loss(start_hub, open_port):
    hub = start_hub("--bitrate", "0")
    sender, sleeper, reader = open_port("sender"), open_port("sleeper"), open_port("reader")
    rounds, chunk = 200, 100
    for _ in range(rounds):
        for _ in range(chunk):
            sender.send(message(0x100, bytes(8)), timeout=PATIENCE_S)
        for _ in range(chunk):
            assert reader.recv(PATIENCE_S) is not None
    overruns = {port.name: port.overruns for port in statistics(hub).ports}
    assert overruns["sleeper"] > 0
    assert overruns["reader"] == 0
    delivered = 0
    while sleeper.recv(0.2) is not None:
        delivered += 1
    sender.send(message(0x101))
    told, last = sleeper.recv(PATIENCE_S), sleeper.recv(PATIENCE_S)
    assert told.is_error_frame
    assert (told.arbitration_id, told.data[1]) == (0x04, 0x01)  # CAN_ERR_CRTL, RX_OVERFLOW
    assert last.arbitration_id == 0x101
    assert delivered + overruns["sleeper"] == rounds * chunk


def test_a_client_that_vanishes_is_dropped(hub, open_port):
    vanishing = open_port("vanishing")
    assert len(statistics(hub).ports) == 1
    vanishing.shutdown()
    assert statistics(hub).ports == []


def test_the_last_words_of_a_client_go_out(start_hub, open_port):
    start_hub("--bitrate", "50000")
    listener, leaver = open_port("listener"), open_port("leaver")
    listener.send(message(0x7FF))  # leaves something unread with the leaver
    for number in range(30):
        leaver.send(message(number))
    leaver.shutdown()
    assert [listener.recv(PATIENCE_S).arbitration_id for _ in range(30)] == list(range(30))


def test_a_client_that_only_sends_keeps_a_bounded_number_of_frames(start_hub, open_port, monkeypatch):
    monkeypatch.setattr("palpate_bus.hub.port.MAX_PENDING", 10)
    start_hub("--bitrate", "0")
    deaf, other = open_port("deaf"), open_port("other")
    for number in range(30):
        other.send(message(number))
        for can_id in (0x700, 0x701):  # the second is sent when the hub has delivered before it
            deaf.send(message(can_id))
            assert other.recv(PATIENCE_S).arbitration_id == can_id
    kept = [deaf.recv(PATIENCE_S) for _ in range(11)]
    assert [one.arbitration_id for one in kept] == [*range(10), 0x04]
    assert kept[-1].is_error_frame


def test_another_bit_rate_is_refused(hub, open_port):
    with pytest.raises(
        can.CanInitializationError, match="hub has bit rate 1000000, slow has 125000: make them equal"
    ):
        open_port("slow", bitrate=125_000)


def test_statistics_count_identifiers_and_bits(hub, open_edge):
    a, b = open_edge("a"), open_edge("b")
    frames = [CanFrame(0x190, bytes([n])) for n in range(4)] + [CanFrame(0x080)]
    a.send(frames)
    receive_count(b, 5)
    counters = statistics(hub)
    assert {entry.can_id: (entry.frames, entry.bits) for entry in counters.ids} == {
        0x080: (1, frame_bits(frames[4])),
        0x190: (4, sum(frame_bits(frame) for frame in frames[:4])),
    }
    assert counters.load == counters.window_bits / 1e6


def test_the_hub_logs_all_traffic(start_hub, tmp_path, open_edge):
    hub = start_hub("--log", str(tmp_path / "bus.log"), "--header", "origin=test")
    a, b = open_edge("a"), open_edge("b")
    a.send([CanFrame(0x190, b"\x01\x02"), CanFrame(0x701, b"", remote=True)])
    heard = receive_count(b, 2)
    hub.stop()
    log = read_log(tmp_path / "bus.log")
    assert log.header.entries == {"origin": "test"}
    assert [(record.stamp_us, record.frame) for record in log.records] == heard


def test_stopping_the_hub_prints_its_counters(hub, open_port):
    open_port("a").send(message(1))
    assert statistics(hub).ports[0].name == "a"
    said = hub.stop()
    assert "frames 1 " in said
    assert hub.process.returncode == 0


def test_thirty_two_ports_at_once(hub, open_port):
    ports = [open_port(f"p{number}") for number in range(32)]
    ports[0].send(message(0x42))
    assert [port.recv(PATIENCE_S).arbitration_id for port in ports[1:]] == [0x42] * 31


def test_frames_queued_before_a_reopening_are_own_frames_to_the_same_program_only(start_hub):
    """At 10 kbit/s they wait for 0.1 s: the new connections are there before the frames are sent."""
    hub = start_hub("--bitrate", "10000", "--txqueuelen", "16")
    config = BusConfig(interface="palpate", channel=str(hub.path), bitrate=10_000)
    frames = [CanFrame(0x190, bytes([number])) for number in range(8)]
    before = open_bus(config, "finger-1")
    before.send(frames)
    before.close()
    with open_bus(config, "finger-1") as after, open_bus(config, "finger-2") as other:
        heard = [frame for _, frame in receive_count(other, 6)]
        assert set(heard) <= set(frames)
        other.send([frames[-1]])
        arrived = []
        while not arrived:
            arrived = after.receive(PATIENCE_S)
        assert [frame for _, frame in arrived] == [frames[-1]]
        assert after.counters.own_echoes >= len(heard)
