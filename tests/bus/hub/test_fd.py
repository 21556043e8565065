"""CAN FD on the hub: rates, lengths, time on the wire, and clients of classic CAN beside it."""

from __future__ import annotations

import can
import pytest

from palpate_bus.hub import protocol
from palpate_bus.hub.connection import ask
from palpate_bus.hub.control import AskStatistics
from palpate_bus.hub.hub_client import Client
from palpate_bus.hub.hub_core import HubCore
from palpate_bus.hub.protocol import GarbledStreamError, Hello, Kind
from palpate_bus.logs.candump import read_log
from palpate_edge.can_bus.bus import BusConfig, open_bus
from palpate_edge.can_bus.can_frame import FD_LENGTHS, CanFrame, check_frame
from palpate_edge.common.errors import BusError

PATIENCE_S = 20.0
CLASSIC, FD = CanFrame(0x080, b"\x01"), CanFrame(0x190, bytes(range(64)), fd=True)


def joined(core, name, data_bitrate):
    client = Client()
    hello = Hello(name, 1_000_000, receive_own=False, control_only=False, data_bitrate=data_bitrate)
    core.receive(client, protocol.hello_message(hello), 0)
    if client.port is not None:
        core.receive(client, protocol.filters_message(None), 0)
    return client


def arrived(client):
    frames = []
    for kind, payload in protocol.Splitter().feed(bytes(client.output)):
        if kind in (Kind.DELIVER, Kind.DELIVER_FD):
            frames += [frame for _, _, frame in protocol.parse_stamped(kind, payload)]
    return frames


def rejection(client):
    return [
        text.decode() for kind, text in protocol.Splitter().feed(bytes(client.output)) if kind is Kind.REJECT
    ]


@pytest.fixture
def core():
    return HubCore(1_000_000, 16, 0, data_bitrate=5_000_000)


def test_a_classic_client_gets_classic_frames_and_a_count_of_the_others(core):
    sender, fast, old = joined(core, "a", 5_000_000), joined(core, "b", 0), joined(core, "c", None)
    core.receive(sender, protocol.send_messages([FD, CLASSIC, FD]), 0)
    core.advance(1_000_000)
    assert arrived(fast) == [FD, CLASSIC, FD]
    assert arrived(old) == [CLASSIC]
    assert {port.name: port.fd_withheld for port in core.statistics(1_000_000).ports} == {
        "a": 0,
        "b": 0,
        "c": 2,
    }


def test_the_data_phase_is_faster():
    """64 bytes of 0x55 need no stuff bits: 29 nominal bits and 5 + 512 + 33 of data (ISO 11898-1:2015)."""
    core = HubCore(1_000_000, 16, 0, data_bitrate=5_000_000)
    sender = joined(core, "a", 0)
    frame = CanFrame(0x555, b"\x55" * 64, fd=True)
    core.receive(sender, protocol.send_messages([frame, frame]), 0)
    first, second = core.advance(1_000_000)
    assert first.bits == pytest.approx(29 + (5 + 512 + 33) / 5, abs=1)
    assert second.won_at_us - first.won_at_us == pytest.approx(first.bits, abs=1)
    counted = core.statistics(1_000_000)
    assert counted.bits == pytest.approx(2 * first.bits, abs=1)
    assert counted.data_bitrate == 5_000_000


@pytest.mark.parametrize(
    ("hub_has", "client_has", "text"),
    [
        (5_000_000, 2_000_000, "the hub has data bit rate 5000000, a has 2000000: make them equal"),
        (None, 5_000_000, "carries classic CAN frames only, .* start it with --data-bitrate 5000000"),
    ],
)
def test_another_data_bit_rate_is_refused(hub_has, client_has, text):
    (said,) = rejection(joined(HubCore(1_000_000, 16, 0, hub_has), "a", client_has))
    with pytest.raises(BusError, match=text):
        raise BusError(said)


@pytest.mark.parametrize(("hub_has", "client_has"), [(5_000_000, None), (None, 0)])
def test_a_client_without_fd_cannot_send_it(hub_has, client_has):
    core = HubCore(1_000_000, 16, 0, hub_has)
    client = joined(core, "a", client_has)
    with pytest.raises(GarbledStreamError, match="unexpected message SEND_FD"):
        core.receive(client, protocol.send_messages([FD]), 0)


@pytest.mark.parametrize("length", sorted({*range(65)} - {*FD_LENGTHS}))
def test_a_length_that_no_frame_has_is_refused(length):
    with pytest.raises(BusError, match=f"no CAN FD frame: 190 with {length} data bytes"):
        check_frame(CanFrame(0x190, bytes(length), fd=True), fd=True)
    sent = protocol.message(Kind.SEND_FD, protocol.FD_FRAME.pack(0x190, 0, length, b""))
    ((kind, payload),) = protocol.Splitter().feed(sent)
    with pytest.raises(GarbledStreamError, match=f"{length} data bytes"):
        list(protocol.parse_frames(kind, payload))


def test_fd_is_refused_on_a_classic_bus_and_never_remote():
    with pytest.raises(BusError, match=r"190 on a bus of classic CAN: set bus\.data_bitrate"):
        check_frame(FD, fd=False)
    with pytest.raises(BusError, match="remote"):
        check_frame(CanFrame(0x190, bytes(8), remote=True, fd=True), fd=True)


def test_fd_frames_through_processes_our_link_and_python_can(start_hub, tmp_path, open_port):
    hub = start_hub("--data-bitrate", "5000000", "--log", str(tmp_path / "bus.log"))
    assert "CAN FD at 5000000 bit/s" in hub.first_line
    config = BusConfig(interface="palpate", channel=str(hub.path), data_bitrate=5_000_000)
    foreign = open_port("foreign", fd=True)
    burst = [CLASSIC, FD, CanFrame(0x100), CanFrame(0x191, bytes(12), fd=True)]
    with (
        open_bus(config, "a") as a,
        open_bus(config, "b", [0x190]) as b,
        open_bus(BusConfig(interface="palpate", channel=str(hub.path)), "classic") as classic,
    ):
        a.send(burst)
        got = [foreign.recv(PATIENCE_S) for _ in burst]
        assert [(m.is_fd, m.bitrate_switch, bytes(m.data)) for m in got] == [
            (f.fd, f.fd, f.data) for f in burst
        ]
        ((_, frame),) = b.receive(PATIENCE_S)
        assert frame == FD
        with pytest.raises(BusError, match="cannot send: CAN FD frame 190 on a bus of classic CAN"):
            classic.send([FD])
        foreign.send(
            can.Message(
                arbitration_id=0x190, is_extended_id=False, is_fd=True, bitrate_switch=True, data=bytes(20)
            )
        )
        ((_, answer),) = b.receive(PATIENCE_S)
        assert answer == CanFrame(0x190, bytes(20), fd=True)
        seen = []
        while len(seen) < 2:
            seen += [frame for _, frame in classic.receive(PATIENCE_S)]
        assert seen == [CLASSIC, CanFrame(0x100)]
        withheld = {port.name: port.fd_withheld for port in ask(hub.path, AskStatistics()).ports}
        assert withheld == {"a": 0, "b": 0, "classic": 3, "foreign": 0}
    hub.stop()
    assert [record.frame for record in read_log(tmp_path / "bus.log").records] == [*burst, answer]
