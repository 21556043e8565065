"""Verified boot: reading of a node's objects over SDO until they agree with what the host decodes. Pure.

In the manner of CiA 302-2, where the NMT master compares identity and configuration of a slave before it
starts it. One request at a time, due with the host's ticks; every difference is a problem of one line with
object, value found, value wanted and remedy. A node with a problem is read again once a second, so that a
node that was mended on the bus is accepted without a command. A node with the signature of its configuration
(configuration_signature.py) is not read further; one that agrees without it is signed, if it can save.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import replace

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.node.sdo_abort import AbortCode
from palpate_host.drives.drive_settings import Write
from palpate_host.drives.identify import SDO_REPLY_ID, SDO_REQUEST_ID
from palpate_host.network.configuration_signature import (
    SAVE_COMMUNICATION,
    SAVES_ON_COMMAND,
    is_written,
    signature_of,
    signing,
)
from palpate_host.network.node_contract import Wanted
from palpate_host.network.sdo_upload import SdoUpload

RETRY_US = 200_000
"""Time after which a request without a response is sent again."""
NO_RESPONSE_US = 1_000_000
"""Time without a response after which the node has a problem."""
READ_AGAIN_US = 1_000_000
"""Time after which a node with a problem is read again."""

_MISSING = (AbortCode.NO_OBJECT, AbortCode.NO_SUBINDEX)


class BootCheck:
    """The reading of one node. problem: one line, empty for none. is_verified: every object agrees."""

    def __init__(self, node_id: int, name: str, wanted: Iterable[Wanted], *, signs: bool = False) -> None:
        """wanted: the objects in the order of reading; with none, the node is taken as it is.

        signs: read 1020h first; if it differs, read whether the node saves, and write it after the others
        agree.
        """
        self.node_id = node_id
        self.reply_id = SDO_REPLY_ID + node_id
        self.name = name
        self._signs = signs
        self._set_contract(tuple(wanted))
        self.restart()

    def _set_contract(self, contract: tuple[Wanted, ...]) -> None:
        self._contract = contract
        self._signature = signature_of(contract) if self._signs and contract else ()
        saves = (Wanted(SAVE_COMMUNICATION, SAVES_ON_COMMAND, "", SAVES_ON_COMMAND),)
        self._before = (*self._signature, *saves) if self._signature else ()
        self._wanted = (*self._before, *contract)

    def accept(self) -> tuple[Wanted, str | int] | None:
        """Expect the value that was found in place of the one that differs, and read the node again.

        Return the former expectation and the value; None when nothing differs that hand.toml may name.
        """
        if self._difference is None or not self._difference[0].key_in_hand:
            return None
        wanted, value = accepted = self._difference
        self._set_contract(tuple(replace(w, value=value) if w is wanted else w for w in self._contract))
        self.restart()
        return accepted

    def restart(self) -> None:
        """Begin again: the node has booted, or its parameters may have changed."""
        self.is_verified = not self._wanted
        self.problem = ""
        self._difference: tuple[Wanted, str | int] | None = None
        self._again_us: int | None = None  # set by a difference, at the tick that finds it
        if not self.is_verified:
            self._begin()

    def _begin(self) -> None:
        self._differs = False
        self._place = 0
        self._upload = SdoUpload(self.node_id, self._wanted[0].key)
        self._requested_us: int | None = None
        self._silent_since_us: int | None = None
        self._disabled_pdo = ""
        self._can_sign = False
        self._signing: deque[Write] = deque()

    def due(self, now_us: int) -> CanFrame | None:
        """Return the next request, or the last transfer's first one after RETRY_US without a response."""
        if self.is_verified:
            return None
        if self._differs:
            self._again_us = now_us + READ_AGAIN_US if self._again_us is None else self._again_us
            if now_us < self._again_us:
                return None
            self._again_us = None
            self._begin()
        if self._requested_us is not None:
            if now_us < self._requested_us + RETRY_US:
                return None
            if self._signing:  # a slow disk: the node goes on saving
                self._finish()
                return None
            self._upload.restart()
        self._silent_since_us = now_us if self._silent_since_us is None else self._silent_since_us
        if now_us >= self._silent_since_us + NO_RESPONSE_US:
            self.problem = self._no_response()
        self._requested_us = now_us
        if self._signing:
            return CanFrame(SDO_REQUEST_ID + self.node_id, self._signing[0].request())
        return self._upload.request()

    def receive(self, frame: CanFrame) -> None:
        """Take a frame with `reply_id`. Responses to other clients' requests are ignored."""
        if self.is_verified or self._differs or self._requested_us is None:
            return
        if self._signing:
            self._receive_signing(frame.data)
            return
        if not self._upload.receive(frame.data):
            return
        self._requested_us = self._silent_since_us = None
        if self._upload.finished:
            self._compare(self._wanted[self._place])

    def _compare(self, wanted: Wanted) -> None:
        upload = self._upload
        if self._place < len(self._before):
            self._compare_signature(wanted)
            return
        if upload.abort is not None and upload.abort not in _MISSING:
            problem = (
                f"{wanted.key[0]:04X}h:{wanted.key[1]:02X} cannot be read (abort {upload.abort:08X}h):"
                f" {wanted.remedy}"
            )
        else:
            problem = wanted.problem(upload.data)
        if problem:
            self.problem, self._differs = f"{self.name}: {problem}", True
            self._difference = None if upload.data is None else (wanted, wanted.found(upload.data))
            return
        if wanted.is_disabled(upload.data):
            self._disabled_pdo = wanted.pdo
        place = self._place + 1
        while place < len(self._wanted) and self._is_of_disabled_pdo(self._wanted[place]):
            place += 1
        self._read(place)

    def _compare_signature(self, wanted: Wanted) -> None:
        data, storage = self._upload.data, len(self._signature)
        agrees = data is not None and not wanted.problem(data)
        if self._place == storage:
            self._can_sign = agrees
            self._read(len(self._before))
        elif not agrees:
            self._read(len(self._before) if data is None else storage)
        elif self._place + 1 < storage:
            self._read(self._place + 1)
        else:
            self._finish()

    def _read(self, place: int) -> None:
        """Read the object at `place` next; behind the last one, sign the node or end."""
        self._place = place
        if place < len(self._wanted):
            self._upload = SdoUpload(self.node_id, self._wanted[place].key)
        elif self._can_sign:
            self._signing.extend(signing(self._signature))
        else:
            self._finish()

    def _receive_signing(self, response: bytes) -> None:
        """Take a response to a part of the signature. A node that refuses one is read whole the next time."""
        written = is_written(self._signing[0], response)
        if written is None:
            return
        self._requested_us = self._silent_since_us = None
        self._signing.popleft()
        if not written or not self._signing:
            self._finish()

    def _finish(self) -> None:
        self.problem, self.is_verified = "", True

    def _is_of_disabled_pdo(self, wanted: Wanted) -> bool:
        return bool(wanted.pdo) and wanted.pdo == self._disabled_pdo

    def _no_response(self) -> str:
        index, subindex = self._wanted[self._place].key
        return (
            f"{self.name}: no SDO response to a read of {index:04X}h:{subindex:02X} for"
            f" {NO_RESPONSE_US // 1_000_000} s: check the node, palpate-host bus scan"
        )
