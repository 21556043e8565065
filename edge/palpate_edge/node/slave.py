"""CANopen slave: CiA 301 and 305 for one object dictionary, without clock, thread or bus.

Input is frames and time, output is frames and events; the same input gives the same output. The time may be
any counter of microseconds that never decreases.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import msgspec

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.node import lss
from palpate_edge.node.change_policy import LSS_STATES, WriteRates, check_state
from palpate_edge.node.emcy import EmcyCode, EmergencyProducer, ErrorRegister
from palpate_edge.node.events import (
    AcceptIdsChanged,
    Event,
    HeartbeatLost,
    NmtStateChanged,
    NodeIdConflict,
    ObjectWritten,
    SyncReceived,
)
from palpate_edge.node.nmt import (
    HEARTBEAT_BYTES,
    NMT_ID,
    SDO_STATES,
    STATE_AFTER,
    STATE_AFTER_ERROR,
    NmtCommand,
    NmtState,
    boot_up,
    command_for,
)
from palpate_edge.node.object_dictionary import (
    UNCONFIGURED_NODE_ID,
    Entry,
    ObjectDictionary,
    ObjectKey,
    Value,
)
from palpate_edge.node.object_store import SIGNATURE_KEYS, ObjectStore
from palpate_edge.node.parameter_keeper import ParameterKeeper
from palpate_edge.node.sdo_abort import SdoAbortError
from palpate_edge.node.services import Services
from palpate_edge.node.stored_check import StoredParametersError, check_stored, usable_node_id
from palpate_edge.node.stored_parameters import (
    COMMUNICATION,
    NOTHING_STORED,
    SIGNATURES,
    StoredParameters,
    is_parameter,
)

IDLE_US = 1_000_000
"""Longest time between two calls that a slave requests."""

ERROR_BEHAVIOUR = 0x1029
ALL_OBJECTS = range(0x10000)

WriteCheck = Callable[[Entry, Value], None]
"""The application's check of a master's write; it raises SdoAbortError to reject the value."""


def allow_write(_entry: Entry, _value: Value) -> None:
    """Allow every write; the default check."""


class SlaveOutput(msgspec.Struct, frozen=True):
    """Result of one call of `Slave.process`.

    frames_out: frames to send, in order. next_due_us: time of the next call if no frame is received before.
    """

    frames_out: tuple[CanFrame, ...]
    next_due_us: int
    events: tuple[Event, ...]


class Slave:
    """One node. The first call of :meth:`process` sends the boot-up and enters PRE-OPERATIONAL.

    A node with id 255 (given or stored by LSS) waits for LSS instead. kept: the stored parameters.
    stored_fault: why they are not used (EMCY 6300h); the defaults of the EDS then apply.
    rates: count the writes whose rate is bounded.
    """

    def __init__(
        self,
        od: ObjectDictionary,
        check_write: WriteCheck = allow_write,
        kept: StoredParameters = NOTHING_STORED,
    ) -> None:
        self.state = NmtState.INITIALISING
        self._now_us = 0
        self._is_held = self._starts_on_release = False
        self._frames: list[CanFrame] = []
        self._events: list[Event] = []
        self._check_write = check_write
        self._store = ObjectStore(od)
        self.stored_fault: StoredParametersError | None = None
        try:
            check_stored(od, kept)
        except StoredParametersError as fault:
            self.stored_fault = fault
            kept = msgspec.structs.replace(kept, objects={}, node_id=usable_node_id(kept))
        self.rates = WriteRates()
        self._keeper = ParameterKeeper(self._store, kept, self.rates)
        if kept.node_id is not None:
            self._store.set_node_id(kept.node_id)
        self._first_node_id = self.node_id
        self._store.saved = kept.objects
        self._store.restore(ALL_OBJECTS)
        self._services = Services(self._store, self._commit)
        self._lss = lss.LssSlave(self._store, self._store_lss, lambda: self.state in LSS_STATES)
        self._handlers: dict[int, Callable[[CanFrame, int], None]] = {}
        self._connect()
        if self.stored_fault is not None:
            self.emcy.report(EmcyCode.DATA_SET, ErrorRegister.GENERIC)

    @property
    def node_id(self) -> int:
        return self._store.od.node_id

    @property
    def emcy(self) -> EmergencyProducer:
        """The emergency producer, for errors of the application."""
        return self._services.emcy

    def read(self, index: int, subindex: int = 0) -> Value:
        """Return an object's value, for the application. Raises BusError when the EDS has no such object."""
        return self._store.values[self._store.od.entry(index, subindex).key]

    def write(self, index: int, subindex: int, value: Value) -> None:
        """Set an object, for the application.

        Raises BusError when it does not exist or the value does not fit.
        """
        self._store.write(index, subindex, value)

    def write_all(self, objects: Mapping[ObjectKey, Value]) -> None:
        """Write like :meth:`write`, either all objects or none."""
        self._store.write_all(objects)

    def trigger(self, numbers: Sequence[int]) -> None:
        """Send these TPDOs in the next call of :meth:`process`, with the values at that time."""
        self._services.tpdo.trigger(numbers)

    def due_tpdos(self, now_us: int, *, last: bool = False) -> tuple[CanFrame, ...]:
        """Return the TPDOs that may be sent now, ahead of :meth:`process`.

        last: the node stops transmitting, so triggered ones do not wait for their inhibit time.
        """
        return tuple(self._services.tpdo.poll(now_us, last=last))

    def accept_ids(self) -> tuple[int, ...]:
        """Return the identifiers for a receive filter: those to process and those of an id conflict."""
        return tuple(sorted(self._handlers))

    def communication_error(self, code: int, info: bytes = b"") -> None:
        """Report a failure of the bus (bus-off, overrun ...) and enter the state given by 1029h:01.

        Call ``emcy.clear(code)`` when the bus works again.
        """
        self.emcy.report(code, ErrorRegister.COMMUNICATION, info)
        self._behave_on_error()

    def hold(self) -> None:
        """Leave OPERATIONAL for PRE-OPERATIONAL until :meth:`release`; a start command is deferred."""
        if not self._is_held:
            self._is_held = True
            self._starts_on_release = self.state is NmtState.OPERATIONAL
            if self._starts_on_release:
                self._enter(NmtState.PRE_OPERATIONAL, None)

    def release(self) -> None:
        """End :meth:`hold`; enter OPERATIONAL if the node was there, or was started meanwhile."""
        self._is_held = False
        if self._starts_on_release:
            self._starts_on_release = False
            self._enter(NmtState.OPERATIONAL, None)

    def store_finished(self, stored: bool, parameters: StoredParameters | None = None) -> None:
        """Report the result of StoreRequested; the next :meth:`process` sends the response to the master.

        parameters: those of the request; None for the request in progress.
        """
        self._frames += self._keeper.finished(stored, parameters)

    def process(
        self, now_us: int, frames_in: Sequence[CanFrame], arrived_us: Sequence[int] | None = None
    ) -> SlaveOutput:
        """Process the received frames and the timers that have elapsed by `now_us`.

        arrived_us: reception time of each frame on the clock of `now_us`; None for now. It is used in the
        events of SYNC and time stamps and for the SYNC window.
        """
        self._now_us = now_us
        if self.state is NmtState.INITIALISING and self.node_id != UNCONFIGURED_NODE_ID:
            self._boot_up(None)
        for number, frame in enumerate(frames_in):
            handler = self._handlers.get(frame.can_id)
            if handler is not None and not frame.remote:
                handler(frame, now_us if arrived_us is None else arrived_us[number])
        self._frames += self._keeper.poll(now_us)
        due_us = now_us + IDLE_US
        if self.state is not NmtState.INITIALISING:
            self._poll()
            due_us = min([*self._services.due_us(), due_us])
        frames, self._frames = tuple(self._frames), []
        events, self._events = tuple(self._events), []
        return SlaveOutput(frames, due_us, events)

    def _connect(self) -> None:
        """Assign a handler to each identifier; a later line takes precedence."""
        services = self._services
        handlers: dict[int, Callable[[CanFrame, int], None]] = {}
        if self.node_id != UNCONFIGURED_NODE_ID:
            handlers |= dict.fromkeys(services.rpdo.can_ids(), self._on_rpdo)
            handlers |= dict.fromkeys(services.watch.can_ids(), self._on_heartbeat)
            handlers |= dict.fromkeys(services.own_ids(), self._on_conflict)
            if services.time.can_id is not None:
                handlers[services.time.can_id] = self._on_time
            handlers[services.sync.can_id] = self._on_sync
            handlers[services.sdo.request_id] = self._on_sdo
            handlers[NMT_ID] = self._on_nmt
        handlers[lss.MASTER_ID] = self._on_lss
        if self._handlers and handlers.keys() != self._handlers.keys():
            self._events.append(AcceptIdsChanged(tuple(sorted(handlers))))
        self._handlers = handlers

    def _on_nmt(self, frame: CanFrame, _arrived_us: int) -> None:
        command = command_for(self.node_id, frame.data)
        if command is None:
            return
        state = STATE_AFTER[command]
        if self._is_held:
            self._starts_on_release = state is NmtState.OPERATIONAL
            state = NmtState.PRE_OPERATIONAL if self._starts_on_release else state
        if state is NmtState.INITIALISING:
            self._reset(command)
        elif state is not self.state:
            self._enter(state, command)

    def _on_sync(self, frame: CanFrame, arrived_us: int) -> None:
        sync = self._services.sync
        if self.state not in SDO_STATES or not sync.accept(arrived_us, frame.data):
            return
        counter = frame.data[0] if frame.data else None
        self._events.append(SyncReceived(arrived_us, counter))
        if self.state is NmtState.OPERATIONAL:
            self._events += self._services.rpdo.sync()
            if sync.in_window(self._now_us):
                self._frames += self._services.tpdo.sync(self._now_us, counter)

    def _on_time(self, frame: CanFrame, arrived_us: int) -> None:
        event = self._services.time.receive(arrived_us, frame.data)
        if event is not None and self.state in SDO_STATES:
            self._events.append(event)

    def _on_sdo(self, frame: CanFrame, _arrived_us: int) -> None:
        if self.state in SDO_STATES:
            self._frames += self._services.sdo.receive(self._now_us, frame.data)

    def _on_rpdo(self, frame: CanFrame, arrived_us: int) -> None:
        self._events += self._services.rpdo.receive(self._now_us, arrived_us, frame)

    def _on_heartbeat(self, frame: CanFrame, _arrived_us: int) -> None:
        if len(frame.data) == HEARTBEAT_BYTES:
            self._services.watch.receive(self._now_us, frame.can_id)

    def _on_conflict(self, frame: CanFrame, _arrived_us: int) -> None:
        self._events.append(NodeIdConflict(frame.can_id))

    def _on_lss(self, frame: CanFrame, _arrived_us: int) -> None:
        answer = self._lss.receive(frame.data)
        if answer is not None:
            self._frames.append(answer)
        if self._lss.leaves_unconfigured:
            self._start_over(None)

    def _poll(self) -> None:
        now_us, services = self._now_us, self._services
        self._events += services.rpdo.poll(now_us)
        for node_id in services.watch.poll(now_us):
            self._events.append(HeartbeatLost(node_id))
            self._behave_on_error()
        self._frames += services.sdo.poll(now_us)
        self._frames += services.emcy.poll(now_us, self.state)
        self._frames += services.tpdo.poll(now_us)
        heartbeat = services.heartbeat.poll(now_us, self.state)
        if heartbeat is not None:
            self._frames.append(heartbeat)

    def _behave_on_error(self) -> None:
        state = STATE_AFTER_ERROR.get(self._store.optional_number(ERROR_BEHAVIOUR, 1))
        if self.state is NmtState.OPERATIONAL and state is not None:
            self._enter(state, None)

    def _reset(self, command: NmtCommand) -> None:
        node = command is NmtCommand.RESET_NODE
        if node:
            self._lss.pending_node_id = self._keeper.kept.node_id or self._first_node_id
        self._store.restore(ALL_OBJECTS if node else COMMUNICATION)
        self._start_over(command)

    def _start_over(self, command: NmtCommand | None) -> None:
        """Restart through INITIALISING with the node id that LSS may have assigned."""
        self._store.set_node_id(self._lss.pending_node_id)
        self._starts_on_release = False
        self._lss.restart()
        self._services.restart()
        self._connect()
        if self.node_id == UNCONFIGURED_NODE_ID:
            self._enter(NmtState.INITIALISING, command)
        else:
            self._boot_up(command)

    def _boot_up(self, command: NmtCommand | None) -> None:
        self._frames.append(boot_up(self.node_id))
        self._services.heartbeat.start(self._now_us)
        self._enter(NmtState.PRE_OPERATIONAL, command)

    def _enter(self, state: NmtState, command: NmtCommand | None) -> None:
        self.state = state
        services = self._services
        services.tpdo.stop()
        services.rpdo.stop()
        if state is NmtState.OPERATIONAL:
            services.tpdo.start(self._now_us)
            services.rpdo.start()
        elif state is NmtState.STOPPED:
            services.sdo.cancel()
        self._events.append(NmtStateChanged(state, command))

    def _commit(self, entry: Entry, value: Value) -> bool:
        """Apply a value that a master wrote by SDO, or raise SdoAbortError.

        Return False while the application stores it.
        """
        check_state(entry.index, NmtState.OPERATIONAL if self._starts_on_release else self.state)
        if entry.index in SIGNATURES:
            confirm = self._services.sdo.confirm
            request = self._keeper.write(self._now_us, entry, value, confirm)
            if request is not None:
                self._events.append(request)
            return request is None
        self._services.check_write(entry, value)
        self._check_write(entry, value)
        self.rates.take(self._now_us, entry.index)
        if is_parameter(entry) and entry.key not in SIGNATURE_KEYS and self._store.values[entry.key] != value:
            self._store.clear_signature()
        self._store.values[entry.key] = value
        self._events.append(ObjectWritten(entry.index, entry.subindex, value))
        if entry.index in COMMUNICATION:
            self._services.written(self._now_us, entry)
            self._connect()
        return True

    def _store_lss(self, node_id: int) -> bool | None:
        try:
            request = self._keeper.keep_lss(self._now_us, node_id, self._lss.confirm_store)
        except SdoAbortError:
            return False
        if request is None:
            return True
        self._events.append(request)
        return None
