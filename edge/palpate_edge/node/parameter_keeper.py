"""Keeps a node's parameters over a loss of power: asks the application to write them, and tells who waits.

One storing at a time: 1010h, 1011h and LSS are answered only when the application has said how it went, or
when :data:`STORE_TIMEOUT_US` has passed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.node.events import StoreRequested
from palpate_edge.node.object_dictionary import Entry, Value
from palpate_edge.node.object_store import ObjectStore
from palpate_edge.node.sdo_abort import AbortCode, SdoAbortError
from palpate_edge.node.stored_parameters import StoredParameters, after_write

STORE_TIMEOUT_US = 5_000_000

Confirm = Callable[[bool], list[CanFrame]]
"""Makes the answer to whoever asked: True when it is stored."""


@dataclass(frozen=True, slots=True)
class Storing:
    """Parameters that the application is writing."""

    parameters: StoredParameters
    confirm: Confirm
    deadline_us: int


class ParameterKeeper:
    """kept: what was stored last."""

    def __init__(self, store: ObjectStore, kept: StoredParameters) -> None:
        self.kept = kept
        self._store = store
        self._storing: Storing | None = None

    def write(self, now_us: int, entry: Entry, value: Value, confirm: Confirm) -> StoreRequested:
        """A master's write to 1010h or 1011h. Raises SdoAbortError to refuse it."""
        parameters = after_write(self._store, self.kept, entry, value)
        request = self._request(now_us, parameters, confirm)
        if request is None:
            raise SdoAbortError(AbortCode.DEVICE_STATE)
        return request

    def keep_lss(
        self, now_us: int, node_id: int, bit_rate_kbit_s: int | None, confirm: Confirm
    ) -> StoreRequested | None:
        """The store request of LSS; None while an earlier storing is under way."""
        rate = bit_rate_kbit_s or self.kept.bit_rate_kbit_s
        return self._request(now_us, replace(self.kept, node_id=node_id, bit_rate_kbit_s=rate), confirm)

    def finished(self, stored: bool) -> list[CanFrame]:
        """The application has written what was asked for, or could not."""
        if self._storing is None:
            return []
        storing, self._storing = self._storing, None
        if stored:
            self.kept = storing.parameters
            self._store.saved = self.kept.objects
        return storing.confirm(stored)

    def poll(self, now_us: int) -> list[CanFrame]:
        """The refusal of a storing that takes too long."""
        late = self._storing is not None and now_us >= self._storing.deadline_us
        return self.finished(False) if late else []

    def _request(self, now_us: int, parameters: StoredParameters, confirm: Confirm) -> StoreRequested | None:
        if self._storing is not None:
            return None
        self._storing = Storing(parameters, confirm, now_us + STORE_TIMEOUT_US)
        return StoreRequested(parameters)
