"""Verified boot of all nodes of a hand: which of them agree with what the host decodes (boot_check.py)."""

from __future__ import annotations

from collections.abc import Collection, Iterable

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.node.nmt import NmtCommand
from palpate_host.network.boot_check import BootCheck
from palpate_host.network.node_contract import changes_contract


class VerifiedBoot:
    """The checks of several nodes. reply_ids: the identifiers of their SDO responses."""

    def __init__(self, checks: Iterable[BootCheck]) -> None:
        self._checks = {check.node_id: check for check in checks}
        self._by_reply_id = {check.reply_id: check for check in self._checks.values()}
        self.reply_ids = frozenset(self._by_reply_id)

    def is_verified(self, node_id: int) -> bool:
        """Return whether the node agrees; a node without a check does."""
        check = self._checks.get(node_id)
        return check is None or check.is_verified

    def verified(self, node_ids: Iterable[int]) -> list[int]:
        """Return those of the nodes that agree."""
        return [node_id for node_id in node_ids if self.is_verified(node_id)]

    def problem(self, node_id: int) -> str:
        """Return the difference that was found, empty for none or while the node is being read."""
        return self._checks[node_id].problem if node_id in self._checks else ""

    def restart(self, node_id: int) -> None:
        """Read the node again before it counts; nothing happens for a node without a check."""
        if node_id in self._checks:
            self._checks[node_id].restart()

    def requests(self, tick_us: int, readable: Collection[int]) -> list[CanFrame]:
        """Return the next request to each of the nodes in `readable` that is not verified."""
        due = (self._checks[node_id].due(tick_us) for node_id in readable if node_id in self._checks)
        return [frame for frame in due if frame is not None]

    def receive(self, frame: CanFrame) -> None:
        """Take an SDO response with one of `reply_ids`."""
        self._by_reply_id[frame.can_id].receive(frame)

    def receive_request(self, node_id: int, frame: CanFrame) -> None:
        """Take another client's SDO request: a download into PDO parameters restarts the check."""
        if changes_contract(frame.data):
            self.restart(node_id)

    def receive_nmt(self, frame: CanFrame) -> None:
        """Take an NMT command to one node: any but START restarts its check.

        The host's own ones meet nodes that are not verified, so that they change nothing.
        """
        if len(frame.data) == 2 and frame.data[0] != NmtCommand.START and self.is_verified(frame.data[1]):
            self.restart(frame.data[1])
