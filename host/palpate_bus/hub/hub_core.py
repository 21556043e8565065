"""The hub without its sockets. Pure: bytes from the clients in, bytes for them out; time is an argument."""

from __future__ import annotations

import heapq

import msgspec

from palpate_bus.hub import protocol
from palpate_bus.hub.control import (
    AskStatistics,
    Done,
    FaultStatistics,
    IdCount,
    Inject,
    Refused,
    Reply,
    Request,
    Statistics,
    request_decoder,
)
from palpate_bus.hub.faults import UNHARMED, FaultPlan
from palpate_bus.hub.hub_client import NO_MODE, Client
from palpate_bus.hub.protocol import FrameFlag, GarbledStreamError, Kind, PortMode
from palpate_bus.hub.wire import Delivery, Submitted, Wire
from palpate_bus.load.measured_load import WINDOW_US, BusLoad
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.config_file import json_fault
from palpate_edge.common.errors import ConfigError

MAX_QUEUED_BYTES = 256 * 1024  # for one slow client, about 9,000 frames: seconds of a busy bus
MAX_UNREAD_BYTES = 4 * MAX_QUEUED_BYTES  # including replies and credits, which are never dropped

MAX_LEFT = 64  # ports of disconnected programs that are remembered

_VERDICT_WANTED = int(FrameFlag.VERDICT_WANTED)
_OWN = int(FrameFlag.OWN)


class HubCore:
    """Bus, faults, statistics and clients; see protocol.py for the messages.

    bitrate: bit/s, 0 for a bus whose frames take no time. txqueuelen: length of each client's transmit queue.
    data_bitrate: bit/s of the data phase of CAN FD frames, None for a classic bus.
    """

    def __init__(self, bitrate: int, txqueuelen: int, now_us: int, data_bitrate: int | None = None) -> None:
        self.wire = Wire(bitrate, txqueuelen, data_bitrate)
        self.load = BusLoad()
        self.faults = FaultPlan()
        self.garbled_clients = 0
        self._started_us = now_us
        self._by_port: dict[int, Client] = {}
        self._left: dict[int, tuple[int, str]] = {}  # port -> process and name of a program that disconnected
        self._held: list[tuple[int, int, int, CanFrame, bool]] = []  # release us, order, port, frame, copy
        self._held_count = 0

    def disconnect(self, client: Client) -> None:
        """Remove a client; its queued frames are still transmitted, frames held by a fault are not."""
        if client.port is not None:
            self.wire.detach(client.port)
            del self._by_port[client.port]
            self._remember(client.port, client)
            self._held = [held for held in self._held if held[2] != client.port]
            heapq.heapify(self._held)
            client.port = None

    def receive(self, client: Client, data: bytes, now_us: int) -> None:
        """Process bytes from a client. Raises GarbledStreamError; the caller then has to `disconnect` it."""
        try:
            for kind, payload in client.splitter.feed(data):
                self._handle(client, kind, payload, now_us)
                if len(client.output) > MAX_UNREAD_BYTES:
                    raise GarbledStreamError(
                        f"{client.name} does not read: {len(client.output)} bytes wait, the limit is"
                        f" {MAX_UNREAD_BYTES}"
                    )
        except GarbledStreamError:
            self.garbled_clients += 1
            raise

    def advance(self, now_us: int) -> list[Delivery]:
        """Run bus and faults up to `now_us` and fill the clients' `output`; return the transmitted frames."""
        if self.faults.next_edge_us(now_us) is not None or self._held:
            self._apply_fault_windows(now_us)
            self._release_held(now_us)
        deliveries = self.wire.advance(now_us)
        for delivery in deliveries:
            self._deliver(delivery)
        return deliveries

    def next_due_us(self, now_us: int) -> int | None:
        """Return the time at which `advance` is due next, None when it is not due before a client sends."""
        held = self._held[0][0] if self._held else None
        due = (self.wire.next_due_us, held, self.faults.next_edge_us(now_us))
        return min((time_us for time_us in due if time_us is not None), default=None)

    def statistics(self, now_us: int) -> Statistics:
        """Return all counters."""
        return Statistics(
            uptime_us=now_us - self._started_us,
            bitrate=self.wire.bitrate,
            txqueuelen=self.wire.txqueuelen,
            frames=self.load.frames,
            bits=round(self.load.bits),
            window_us=WINDOW_US,
            window_bits=round(self.load.window_bits(now_us)),
            garbled_clients=self.garbled_clients,
            ids=[
                IdCount(can_id, frames, round(bits))
                for can_id, (frames, bits) in sorted(self.load.by_id.items())
            ],
            ports=[client.statistics() for client in self._by_port.values()],
            faults=[FaultStatistics(rule, hits) for rule, hits in self.faults.rules()],
            data_bitrate=self.wire.data_bitrate,
        )

    def _handle(self, client: Client, kind: Kind, payload: bytes, now_us: int) -> None:
        may_send = kind is Kind.SEND or (kind is Kind.SEND_FD and client.has_fd)
        if may_send and client.port is not None:
            for flags, frame in protocol.parse_frames(kind, payload):
                self._submit(client, client.port, frame, bool(flags & _VERDICT_WANTED), now_us)
        elif kind is Kind.HELLO and not client.name:
            self._welcome(client, protocol.parse_hello(payload), now_us)
        elif kind is Kind.FILTERS and client.port is not None:
            self.wire.set_filters(client.port, protocol.parse_filters(payload))
        elif kind is Kind.REQUEST and client.name:
            reply = self._answer(_parse_request(payload), now_us)
            client.output += protocol.message(Kind.REPLY, msgspec.json.encode(reply))
        else:
            raise GarbledStreamError(f"unexpected message {kind.name} in this state of the connection")

    def _welcome(self, client: Client, hello: protocol.Hello, now_us: int) -> None:
        if reason := self._mismatch(hello):
            client.output += protocol.message(Kind.REJECT, reason.encode())
            return
        client.name = hello.name
        client.has_fd = hello.data_bitrate is not None and self.wire.data_bitrate is not None
        client.output += protocol.welcome_message(self.wire.txqueuelen, self.wire.bitrate)
        if not hello.control_only:
            client.port = self.wire.attach(hello.receive_own, client.has_fd)
            self._by_port[client.port] = client
            self._apply_fault_windows(now_us)

    def _mismatch(self, hello: protocol.Hello) -> str:
        """Return why the client's bit rates do not fit the bus; empty when they do."""
        rate, data_rate = self.wire.bitrate, self.wire.data_bitrate
        if rate and hello.bitrate not in (0, rate):
            return f"the hub has bit rate {rate}, {hello.name} has {hello.bitrate}: make them equal"
        if not hello.data_bitrate:
            return ""
        if data_rate is None:
            return (
                f"the hub carries classic CAN frames only, {hello.name} has data bit rate "
                f"{hello.data_bitrate}: start it with --data-bitrate {hello.data_bitrate}, or remove "
                "bus.data_bitrate"
            )
        if rate and hello.data_bitrate != data_rate:
            return (
                f"the hub has data bit rate {data_rate}, {hello.name} has {hello.data_bitrate}: "
                "make them equal"
            )
        return ""

    def _answer(self, request: Request, now_us: int) -> Reply:
        if isinstance(request, AskStatistics):
            return self.statistics(now_us)
        if isinstance(request, Inject):
            try:
                self.faults.inject(request.rule, now_us)
            except ConfigError as error:
                return Refused(str(error))
        else:
            self.faults.clear()
        self._apply_fault_windows(now_us)
        return Done()

    def _submit(self, client: Client, port: int, frame: CanFrame, verdict_wanted: bool, now_us: int) -> None:
        fate = self.faults.fate(client.name, frame, verdict_wanted, now_us)
        if verdict_wanted:
            client.output += protocol.message(Kind.VERDICT, bytes([not fate.refused]))
        if fate.refused:
            client.refused += 1
        if fate is not UNHARMED:
            self._apply_fault_windows(now_us)  # the hit may have ended a rule by its count
        if not fate.delays_us:
            self._give_credit(client, 1)
        for number, delay_us in enumerate(fate.delays_us):
            if delay_us:
                self._held_count += 1
                held = (now_us + delay_us, self._held_count, port, frame, number > 0)
                heapq.heappush(self._held, held)
            else:
                self._queue(client, port, frame, now_us, copy=number > 0)

    def _queue(self, client: Client, port: int, frame: CanFrame, now_us: int, copy: bool) -> None:
        outcome = self.wire.submit(port, frame, now_us, copy)
        if outcome is Submitted.BUS_OFF and not copy:  # in transit when the port went bus-off
            client.lost_to_bus_off += 1
            self._give_credit(client, 1)
        elif outcome is Submitted.QUEUE_FULL:
            raise GarbledStreamError(
                f"{client.name} sent more frames than its {self.wire.txqueuelen} credits allow"
            )

    def _release_held(self, now_us: int) -> None:
        while self._held and self._held[0][0] <= now_us:
            release_us, _, port, frame, copy = heapq.heappop(self._held)
            self._queue(self._by_port[port], port, frame, release_us, copy)

    def _deliver(self, delivery: Delivery) -> None:
        frame = delivery.frame
        self.load.count(delivery.won_at_us, frame.can_id, delivery.bits)
        sender = self._by_port.get(delivery.sender)
        if sender is not None:
            sender.sent += 1
            if not delivery.copy:
                self._give_credit(sender, 1)
        record = protocol.deliver_message(delivery.won_at_us, 0, frame)
        for port in delivery.receivers:
            client = self._by_port.get(port)
            if client is not None:  # it may have disconnected while the frame was on the wire
                own = port == delivery.sender or self._is_former_port(client, delivery.sender)
                own_record = protocol.deliver_message(delivery.won_at_us, _OWN, frame) if own else record
                self._output_frame(client, own_record)
        for port in delivery.classic_ports:
            client = self._by_port.get(port)
            if client is not None:
                client.fd_withheld += 1

    def _remember(self, port: int, client: Client) -> None:
        """Remember who had a port: its queued frames are its own to the same program's next port."""
        if client.process:
            self._left[port] = (client.process, client.name)
        while len(self._left) > MAX_LEFT:
            del self._left[next(iter(self._left))]

    def _is_former_port(self, client: Client, port: int) -> bool:
        """Return whether the client's program had this port before it reconnected."""
        return bool(self._left) and self._left.get(port) == (client.process, client.name)

    def _output_frame(self, client: Client, record: bytes) -> None:
        if len(client.output) > MAX_QUEUED_BYTES:
            client.overruns += 1
            client.overruns_untold += 1
            return
        if client.overruns_untold:
            client.output += protocol.count_message(Kind.OVERRUN, client.overruns_untold)
            client.overruns_untold = 0
        client.output += record
        client.delivered += 1

    def _give_credit(self, client: Client, count: int) -> None:
        """Return credits in portions of half a queue: one message per frame would double the hub's work."""
        client.credits_owed += count
        if client.credits_owed * 2 >= self.wire.txqueuelen:
            client.output += protocol.count_message(Kind.CREDIT, client.credits_owed)
            client.credits_owed = 0

    def _apply_fault_windows(self, now_us: int) -> None:
        self.faults.expire(now_us)
        for port, client in self._by_port.items():
            mode = NO_MODE
            if self.faults.wants_verdicts(client.name):
                mode |= PortMode.ASK_VERDICT
            if self.faults.is_bus_off(client.name, now_us):
                mode |= PortMode.BUS_OFF
            if mode == client.mode:
                continue
            if (mode ^ client.mode) & PortMode.BUS_OFF:
                lost = self.wire.set_bus_off(port, bool(mode & PortMode.BUS_OFF))
                client.lost_to_bus_off += lost
                self._give_credit(client, lost)
            client.mode = mode
            client.output += protocol.message(Kind.MODE, bytes([mode]))


def _parse_request(payload: bytes) -> Request:
    try:
        return request_decoder.decode(payload)
    except msgspec.MsgspecError:
        raise GarbledStreamError(f"invalid REQUEST: {json_fault(payload, Request)}") from None
