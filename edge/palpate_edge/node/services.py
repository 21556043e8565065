"""The services of one node on one object store: checking and applying a master's writes to their objects."""

from __future__ import annotations

from collections.abc import Callable

from palpate_edge.node import sync, time_stamp
from palpate_edge.node.cob_ids import CAN_ID_MASK
from palpate_edge.node.emcy import COB_ID as EMCY_COB_ID
from palpate_edge.node.emcy import EmergencyProducer
from palpate_edge.node.heartbeat import PRODUCER_TIME, HeartbeatProducer
from palpate_edge.node.heartbeat_consumer import CONSUMER_TIMES, HeartbeatConsumer
from palpate_edge.node.nmt import ERROR_CONTROL_ID
from palpate_edge.node.object_dictionary import Entry, Value
from palpate_edge.node.object_store import ERROR_HISTORY, ObjectStore
from palpate_edge.node.pdo_codec import PdoDirection
from palpate_edge.node.pdo_parameters import COB_ID_SUB, check_pdo_write, valid_can_ids
from palpate_edge.node.rpdo import RpdoService
from palpate_edge.node.sdo_abort import AbortCode, SdoAbortError
from palpate_edge.node.sdo_server import SdoServer
from palpate_edge.node.tpdo import TpdoService

RPDO_PARAMETERS = range(PdoDirection.RECEIVE.communication_index, PdoDirection.TRANSMIT.communication_index)
TPDO_PARAMETERS = range(PdoDirection.TRANSMIT.communication_index, 0x1C00)

WriteCheck = Callable[[Entry, int], None]


class Services:
    """All services of one node. commit: see :class:`SdoServer`."""

    def __init__(self, store: ObjectStore, commit: Callable[[Entry, Value], bool]) -> None:
        self._store = store
        self.emcy = EmergencyProducer(store)
        self.heartbeat = HeartbeatProducer(store)
        self.watch = HeartbeatConsumer(store, self.emcy)
        self.sync = sync.SyncConsumer(store, self.emcy)
        self.time = time_stamp.TimeConsumer(store)
        self.sdo = SdoServer(store, commit)
        self.tpdo = TpdoService(store)
        self.rpdo = RpdoService(store, self.emcy, self.sync)
        self._checks: dict[int, WriteCheck] = {
            ERROR_HISTORY: self.emcy.check_write,
            EMCY_COB_ID: self.emcy.check_write,
            sync.COB_ID: self.sync.check_write,
            sync.COUNTER_OVERFLOW: self.sync.check_write,
            time_stamp.COB_ID: self.time.check_write,
            CONSUMER_TIMES: self.watch.check_write,
        }

    def restart(self) -> None:
        """Restart every service with the present values of its objects, after a reset."""
        self.emcy.reset()
        self.watch.start()
        self.sync.start()
        self.time.start()
        self.sdo.start()

    def check_write(self, entry: Entry, value: Value) -> None:
        """Raise SdoAbortError for a value that the object's service does not allow."""
        if not isinstance(value, int):
            return
        self._checks.get(entry.index, self._check_other)(entry, value)
        if self._is_cob_id(entry) and value & CAN_ID_MASK in self._taken_ids(entry.index):
            raise SdoAbortError(AbortCode.VALUE_INVALID)

    def written(self, now_us: int, entry: Entry) -> None:
        """Apply a value that a master wrote; parameters of PDOs apply from the next start on."""
        index = entry.index
        if index == PRODUCER_TIME:
            self.heartbeat.reconfigure(now_us)
        elif index == CONSUMER_TIMES:
            self.watch.reconfigure()
        elif index in (sync.COB_ID, sync.WINDOW, sync.COUNTER_OVERFLOW):
            self.sync.start()
        elif index == time_stamp.COB_ID:
            self.time.start()

    def own_ids(self) -> set[int]:
        """Return the identifiers that only this node may send."""
        emcy_id = self.emcy.can_id()
        ids = {ERROR_CONTROL_ID + self._store.od.node_id, self.sdo.response_id, *self.tpdo.can_ids()}
        return ids if emcy_id is None else ids | {emcy_id}

    def due_us(self) -> list[int]:
        """Return the times at which services have to be polled."""
        services = (self.heartbeat, self.watch, self.sdo, self.emcy, self.tpdo, self.rpdo)
        return [at_us for service in services if (at_us := service.due_us()) is not None]

    def _is_cob_id(self, entry: Entry) -> bool:
        if entry.index in RPDO_PARAMETERS or entry.index in TPDO_PARAMETERS:
            return entry.subindex == COB_ID_SUB and entry.index & 0x200 == 0
        return entry.index in (EMCY_COB_ID, sync.COB_ID, time_stamp.COB_ID)

    def _taken_ids(self, index: int) -> set[int | None]:
        """Return the identifiers that other objects of this node use; RPDOs may share one among them."""
        tpdos = [number for number in self.tpdo.numbers if TPDO_PARAMETERS.start + number - 1 != index]
        taken: set[int | None] = {
            self.sdo.response_id,
            *valid_can_ids(self._store, PdoDirection.TRANSMIT, tpdos),
        }
        others = {
            EMCY_COB_ID: self.emcy.can_id(),
            sync.COB_ID: self.sync.can_id,
            time_stamp.COB_ID: self.time.can_id,
        }
        rpdos = set() if index in RPDO_PARAMETERS else self.rpdo.can_ids()
        return taken | rpdos | {can_id for other, can_id in others.items() if other != index}

    def _check_other(self, entry: Entry, value: int) -> None:
        if entry.index in RPDO_PARAMETERS or entry.index in TPDO_PARAMETERS:
            check_pdo_write(self._store, entry, value)
