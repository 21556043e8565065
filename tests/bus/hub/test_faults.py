"""Each fault, through the hub's core on a virtual clock."""

from __future__ import annotations

import msgspec
import pytest

from palpate_bus.hub import protocol
from palpate_bus.hub.control import ClearFaults, Done, Inject, Refused, reply_decoder
from palpate_bus.hub.faults import MAX_RULES, FaultKind, FaultPlan, FaultRule
from palpate_bus.hub.hub_client import Client
from palpate_bus.hub.hub_core import HubCore
from palpate_bus.hub.protocol import FrameFlag, Hello, Kind, PortMode
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.errors import ConfigError


class Bench:
    """A hub core without pacing, with clients ``a`` (sender) and ``b`` (hears everything)."""

    def __init__(self) -> None:
        self.core = HubCore(bitrate=0, txqueuelen=4, now_us=0)
        self.a, self.b = self.join("a"), self.join("b")

    def join(self, name: str) -> Client:
        client = Client()
        hello = Hello(name, 0, receive_own=False, control_only=False)
        self.core.receive(client, protocol.hello_message(hello) + protocol.filters_message(None), 0)
        return client

    def ask(self, request: Inject | ClearFaults, now_us: int) -> Done | Refused:
        asker = Client()
        hello = Hello("control", 0, receive_own=False, control_only=True)
        data = protocol.hello_message(hello) + protocol.message(Kind.REQUEST, msgspec.json.encode(request))
        self.core.receive(asker, data, now_us)
        (reply,) = [reply_decoder.decode(payload) for kind, payload in taken(asker) if kind is Kind.REPLY]
        assert isinstance(reply, Done | Refused)
        return reply

    def inject(self, now_us: int = 0, **fields: object) -> None:
        assert self.ask(Inject(msgspec.convert(fields, FaultRule)), now_us) == Done()

    def send(self, can_id: int, now_us: int, flags: int = 0) -> None:
        data = protocol.send_messages([CanFrame(can_id)], flags)
        self.core.receive(self.a, data, now_us)

    def carried(self, now_us: int) -> list[tuple[int, int]]:
        """(time, identifier) of what the wire carried up to now."""
        return [(delivery.won_at_us, delivery.frame.can_id) for delivery in self.core.advance(now_us)]


def taken(client: Client) -> list[tuple[Kind, bytes]]:
    messages = list(protocol.Splitter().feed(bytes(client.output)))
    client.output.clear()
    return messages


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_drop_hits_the_identifier_under_its_mask_and_ends_after_count(bench):
    bench.inject(kind="drop", can_id=0x180, mask=0x780, count=2)
    for now_us, can_id in enumerate((0x190, 0x290, 0x191, 0x192)):
        bench.send(can_id, now_us)
    assert bench.carried(10) == [(1, 0x290), (3, 0x192)]


def test_drop_of_one_port_leaves_the_others_alone(bench):
    bench.inject(kind="drop", port="b")
    bench.send(0x190, 0)
    assert bench.carried(0) == [(0, 0x190)]


def test_probability_is_drawn_from_the_seed(bench):
    def survivors(seed: int) -> list[int]:
        plan = FaultPlan()
        plan.inject(FaultRule(kind=FaultKind.DROP, probability=0.5, seed=seed), 0)
        return [n for n in range(200) if plan.fate("a", CanFrame(1), False, n).delays_us]

    assert survivors(1) == survivors(1)
    assert survivors(1) != survivors(2)
    assert 60 < len(survivors(1)) < 140  # 200 draws at 1/2: 100 +- 7; six deviations allowed


def test_duplicate_sends_twice_and_costs_one_credit(bench):
    bench.inject(kind="duplicate")
    taken(bench.a)
    for now_us in range(4):
        bench.send(0x190, now_us)
        assert bench.carried(now_us) == [(now_us, 0x190)] * 2
    credits_back = [protocol.parse_count(payload) for kind, payload in taken(bench.a) if kind is Kind.CREDIT]
    assert sum(credits_back) == 4


def test_a_fixed_delay_holds_back(bench):
    bench.inject(kind="delay", delay_us=500)
    bench.send(0x190, 100)
    assert bench.carried(599) == []
    assert bench.core.next_due_us(599) == 600
    assert bench.carried(600) == [(600, 0x190)]


def test_a_random_delay_reorders_within_its_range(bench):
    bench.inject(kind="delay", delay_us=100, delay_max_us=5000, seed=3)
    for number in range(4):
        bench.send(0x190 + number, number)
    carried = bench.carried(10_000)
    assert sorted(can_id for _, can_id in carried) == [0x190, 0x191, 0x192, 0x193]
    assert carried != sorted(carried, key=lambda item: item[1])
    assert all(100 <= time_us - (can_id - 0x190) <= 5000 for time_us, can_id in carried)


def test_tx_full_refuses_and_says_so(bench):
    bench.inject(kind="tx-full", port="a", count=1)
    assert (Kind.MODE, bytes([PortMode.ASK_VERDICT])) in taken(bench.a)
    for now_us in range(2):
        bench.send(0x190, now_us, FrameFlag.VERDICT_WANTED)
    assert [payload for kind, payload in taken(bench.a) if kind is Kind.VERDICT] == [b"\0", b"\1"]
    assert bench.carried(5) == [(1, 0x190)]


def test_tx_full_lets_a_frame_through_whose_sender_does_not_wait_for_the_verdict(bench):
    bench.inject(kind="tx-full")
    bench.send(0x190, 0)
    assert bench.carried(0) == [(0, 0x190)]


def test_bus_off_lasts_for_its_window(bench):
    bench.inject(now_us=0, kind="bus-off", port="a", start_us=100, duration_us=1000)
    taken(bench.a)
    bench.send(0x190, 50)
    assert bench.carried(99) == [(50, 0x190)]
    assert bench.core.next_due_us(99) == 100
    bench.core.advance(100)
    bench.send(0x190, 200)
    assert bench.carried(1099) == []
    bench.core.advance(1100)
    bench.send(0x190, 1200)
    assert bench.carried(1200) == [(1200, 0x190)]
    modes = [payload for kind, payload in taken(bench.a) if kind is Kind.MODE]
    assert modes == [bytes([PortMode.BUS_OFF]), b"\0"]
    assert bench.core.statistics(1200).ports[0].lost_to_bus_off == 1


def test_clear_ends_every_fault(bench):
    bench.inject(kind="drop")
    bench.inject(kind="bus-off", port="a")
    bench.ask(ClearFaults(), 10)
    bench.send(0x190, 11)
    assert bench.carried(11) == [(11, 0x190)]


def test_more_frames_than_credits_is_no_client_of_ours(bench):
    for _ in range(4):
        bench.send(0x190, 0)
    with pytest.raises(protocol.GarbledStreamError, match="4 credits"):
        bench.send(0x190, 0)


@pytest.mark.parametrize(
    ("fields", "way_out"),
    [
        ({"kind": "bus-off"}, "--port"),
        ({"kind": "bus-off", "port": "a", "count": 1}, "omit id, count"),
        ({"kind": "drop", "delay_us": 5}, "use kind delay"),
        ({"kind": "delay", "delay_us": 9, "delay_max_us": 5}, "below minimum"),
    ],
)
def test_a_rule_that_contradicts_itself_is_refused(bench, fields, way_out):
    reply = bench.ask(Inject(msgspec.convert(fields, FaultRule)), 0)
    assert isinstance(reply, Refused)
    assert way_out in reply.reason


def test_the_number_of_rules_is_bounded():
    plan = FaultPlan()
    for _ in range(MAX_RULES):
        plan.inject(FaultRule(kind=FaultKind.DROP), 0)
    with pytest.raises(ConfigError, match="clear them first"):
        plan.inject(FaultRule(kind=FaultKind.DROP), 0)


def test_a_client_that_does_not_read_loses_frames_and_is_told_how_many(bench):
    bench.b.output.extend(bytes(300_000))  # more than the hub keeps for one client
    for now_us in range(3):
        bench.send(0x190, now_us)
        bench.core.advance(now_us)
    bench.b.output.clear()
    bench.send(0x191, 10)
    bench.core.advance(10)
    assert [kind for kind, _ in protocol.Splitter().feed(bytes(bench.b.output))] == [
        Kind.OVERRUN,
        Kind.DELIVER,
    ]
    (_, payload), _ = protocol.Splitter().feed(bytes(bench.b.output))
    assert protocol.parse_count(payload) == 3
    assert bench.core.statistics(10).ports[1].overruns == 3
