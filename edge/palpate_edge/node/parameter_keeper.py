"""Storage of a node's parameters: requests to the application and responses to the master.

Requests are processed one at a time. The response to 1010h, 1011h or LSS is sent when the application has
reported the result, or after :data:`STORE_TIMEOUT_US`.
"""

from __future__ import annotations

from collections.abc import Callable

import msgspec

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.node.change_policy import WriteRates
from palpate_edge.node.events import StoreRequested
from palpate_edge.node.object_dictionary import Entry, Value
from palpate_edge.node.object_store import ObjectStore
from palpate_edge.node.sdo_abort import AbortCode, SdoAbortError
from palpate_edge.node.stored_parameters import RESTORE, STORE, StoredParameters, after_write

STORE_TIMEOUT_US = 5_000_000

Confirm = Callable[[bool], list[CanFrame]]
"""Function that makes the response to the requesting master; its argument is whether storing succeeded."""


class Storing(msgspec.Struct, frozen=True):
    """Store request in progress: the application is writing the parameters."""

    parameters: StoredParameters
    confirm: Confirm
    deadline_us: int


class ParameterKeeper:
    """Keeper of a node's stored parameters; `kept` are those stored last. rates: count the saves."""

    def __init__(self, store: ObjectStore, kept: StoredParameters, rates: WriteRates) -> None:
        self.kept = kept
        self._store = store
        self._storing: Storing | None = None
        self._rates = rates

    @property
    def is_storing(self) -> bool:
        """Return whether a request is in progress."""
        return self._storing is not None

    def write(self, now_us: int, entry: Entry, value: Value, confirm: Confirm) -> StoreRequested | None:
        """Process a master's write to 1010h or 1011h; return None when nothing changed since the last save.

        Raises SdoAbortError when it is not allowed: for another value than the signature, while another
        request is in progress, and after too many saves.
        """
        parameters = after_write(self._store, self.kept, entry, value)
        if self.is_storing:
            raise SdoAbortError(AbortCode.DEVICE_STATE)
        request = self._request(now_us, parameters, confirm)
        if entry.index == RESTORE:
            self._store.clear_signature()
        return request

    def keep_lss(self, now_us: int, node_id: int, confirm: Confirm) -> StoreRequested | None:
        """Process the store request of LSS; return None when nothing has changed since the last save.

        Raises SdoAbortError while another request is in progress, and after too many saves.
        """
        if self.is_storing:
            raise SdoAbortError(AbortCode.DEVICE_STATE)
        if node_id == self.kept.node_id:
            return None
        parameters = msgspec.structs.replace(self.kept.without_signature(), node_id=node_id)
        request = self._request(now_us, parameters, confirm)
        self._store.clear_signature()
        return request

    def finished(self, stored: bool, parameters: StoredParameters | None = None) -> list[CanFrame]:
        """Process the application's result and return the response to the master.

        parameters: those of the result; None for those of the request in progress. A result that arrives
        after the time-out has no response, but the parameters are stored.
        """
        storing = self._storing
        if parameters is None and storing is not None:
            parameters = storing.parameters
        if stored and parameters is not None:
            self.kept = parameters
            self._store.saved = self.kept.objects
        if storing is None or storing.parameters is not parameters:
            return []
        self._storing = None
        return storing.confirm(stored)

    def poll(self, now_us: int) -> list[CanFrame]:
        """Return the negative response when the request in progress has timed out."""
        late = self._storing is not None and now_us >= self._storing.deadline_us
        return self.finished(False) if late else []

    def _request(self, now_us: int, parameters: StoredParameters, confirm: Confirm) -> StoreRequested | None:
        if parameters == self.kept:
            return None
        self._rates.take(now_us, STORE)
        self._storing = Storing(parameters, confirm, now_us + STORE_TIMEOUT_US)
        return StoreRequested(parameters)
