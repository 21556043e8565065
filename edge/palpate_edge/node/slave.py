"""The CANopen slave: CiA 301 services around one object dictionary, without clock, thread or bus.

Frames and the time go in, frames and events come out; the same input gives the same output. The time may be
any counter of microseconds that does not go back.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from palpate_edge.can_frame import CanFrame
from palpate_edge.node.emcy import EmergencyProducer
from palpate_edge.node.events import Event, NmtStateChanged, NodeIdConflict, ObjectWritten
from palpate_edge.node.heartbeat import HeartbeatProducer
from palpate_edge.node.nmt import (
    ERROR_CONTROL_ID,
    NMT_ID,
    SDO_STATES,
    STATE_AFTER,
    NmtCommand,
    NmtState,
    boot_up,
    command_for,
)
from palpate_edge.node.object_dictionary import Entry, ObjectDictionary, Value
from palpate_edge.node.object_store import ObjectStore
from palpate_edge.node.pdo_parameters import check_pdo_write
from palpate_edge.node.rpdo import RpdoService
from palpate_edge.node.sdo_server import SdoServer
from palpate_edge.node.tpdo import TpdoService

IDLE_US = 1_000_000
"""A slave asks to be called at least this often."""

COMMUNICATION_PROFILE = range(0x1000, 0x2000)
RPDO_PARAMETERS = range(0x1400, 0x1800)
TPDO_PARAMETERS = range(0x1800, 0x1C00)
ALL_OBJECTS = range(0x10000)

WriteCheck = Callable[[Entry, Value], None]
"""The application's say on a master's write: raises SdoAbortError to refuse it."""


def allow_write(_entry: Entry, _value: Value) -> None:
    """An application that refuses nothing."""


@dataclass(frozen=True, slots=True)
class Output:
    """frames_out: to send, in order. next_due_us: when to call again if no frame comes before."""

    frames_out: tuple[CanFrame, ...]
    next_due_us: int
    events: tuple[Event, ...]


class Slave:
    """One node. The first call of :meth:`process` sends the boot-up and enters PRE-OPERATIONAL."""

    def __init__(self, od: ObjectDictionary, check_write: WriteCheck = allow_write) -> None:
        self.node_id = od.node_id
        self.state = NmtState.INITIALISING
        self._check_write = check_write
        self._store = ObjectStore(od)
        self.emcy = EmergencyProducer(self._store)
        self._heartbeat = HeartbeatProducer(self._store)
        self._sdo = SdoServer(self._store, self._commit)
        self._tpdo = TpdoService(self._store)
        self._rpdo = RpdoService(self._store, self.emcy)
        self._sync_id = self._store.number(0x1005) & 0x7FF
        self._own_ids = self._ids_only_this_node_sends()
        self._now_us = 0
        self._frames: list[CanFrame] = []
        self._events: list[Event] = []

    def read(self, index: int, subindex: int = 0) -> Value:
        """An object's value, for the application. Raises BusError when the EDS has none."""
        return self._store.values[self._store.od.entry(index, subindex).key]

    def write(self, index: int, subindex: int, value: Value) -> None:
        """Set an object, for the application. Raises BusError when it is not there or does not fit."""
        self._store.write(index, subindex, value)

    def trigger(self, numbers: Sequence[int]) -> None:
        """Send these TPDOs in the next call of :meth:`process`, with the values they have then."""
        self._tpdo.trigger(numbers)

    def accept_ids(self) -> tuple[int, ...]:
        """The identifiers to let through a receive filter: what is served and what reveals a conflict."""
        served = {NMT_ID, self._sync_id, self._sdo.request_id, *self._rpdo.can_ids()}
        return tuple(sorted(served | self._own_ids))

    def process(self, now_us: int, frames_in: Sequence[CanFrame]) -> Output:
        """Serve the frames that came and the timers that ran out by `now_us`."""
        self._now_us = now_us
        self._frames, self._events = [], []
        if self.state is NmtState.INITIALISING:
            self._boot_up(None)
        for frame in frames_in:
            if not frame.remote:
                self._receive(frame)
        self._poll()
        return Output(tuple(self._frames), self._next_due_us(), tuple(self._events))

    def _receive(self, frame: CanFrame) -> None:
        if frame.can_id == NMT_ID:
            command = command_for(self.node_id, frame.data)
            if command is not None:
                self._obey(command)
        elif frame.can_id == self._sync_id:
            self._events += self._rpdo.sync()
            self._frames += self._tpdo.sync(self._now_us)
        elif frame.can_id == self._sdo.request_id:
            if self.state in SDO_STATES:
                self._send(self._sdo.receive(self._now_us, frame.data))
        elif frame.can_id in self._own_ids:
            self._events.append(NodeIdConflict(frame.can_id))
        else:
            self._events += self._rpdo.receive(self._now_us, frame)

    def _poll(self) -> None:
        self._events += self._rpdo.poll(self._now_us)
        self._send(self._sdo.poll(self._now_us))
        self._frames += self.emcy.poll(self.state)
        self._frames += self._tpdo.poll(self._now_us)
        self._send(self._heartbeat.poll(self._now_us, self.state))

    def _send(self, frame: CanFrame | None) -> None:
        if frame is not None:
            self._frames.append(frame)

    def _next_due_us(self) -> int:
        services = (self._heartbeat, self._sdo, self._tpdo, self._rpdo)
        due = [at_us for service in services if (at_us := service.due_us()) is not None]
        return min([*due, self._now_us + IDLE_US])

    def _obey(self, command: NmtCommand) -> None:
        state = STATE_AFTER[command]
        if state is self.state:
            return
        if state is not NmtState.INITIALISING:
            self._enter(state, command)
            return
        node = command is NmtCommand.RESET_NODE
        self._store.restore_defaults(ALL_OBJECTS if node else COMMUNICATION_PROFILE)
        self._own_ids = self._ids_only_this_node_sends()
        self.emcy.reset()
        self._boot_up(command)

    def _boot_up(self, command: NmtCommand | None) -> None:
        self._send(boot_up(self.node_id))
        self._heartbeat.start(self._now_us)
        self._sdo.cancel()
        self._enter(NmtState.PRE_OPERATIONAL, command)

    def _enter(self, state: NmtState, command: NmtCommand | None) -> None:
        self.state = state
        self._tpdo.stop()
        self._rpdo.stop()
        if state is NmtState.OPERATIONAL:
            self._tpdo.start(self._now_us)
            self._rpdo.start()
        elif state is NmtState.STOPPED:
            self._sdo.cancel()
        self._events.append(NmtStateChanged(state, command))

    def _commit(self, entry: Entry, value: Value) -> None:
        """Take over what a master wrote by SDO, or raise SdoAbortError."""
        check_pdo_write(self._store, entry, value)
        self._check_write(entry, value)
        self._store.values[entry.key] = value
        self._events.append(ObjectWritten(entry.index, entry.subindex, value))
        if entry.index == 0x1017:
            self._heartbeat.reconfigure(self._now_us)
        elif entry.index in RPDO_PARAMETERS and self.state is NmtState.OPERATIONAL:
            self._rpdo.start()
        elif entry.index in TPDO_PARAMETERS:
            self._own_ids = self._ids_only_this_node_sends()
            if self.state is NmtState.OPERATIONAL:
                self._tpdo.start(self._now_us)

    def _ids_only_this_node_sends(self) -> set[int]:
        error_control_id = ERROR_CONTROL_ID + self.node_id
        emcy_id = self._store.number(0x1014) & 0x7FF
        return {error_control_id, emcy_id, self._sdo.response_id, *self._tpdo.can_ids()}
