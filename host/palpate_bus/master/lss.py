"""LSS master (CiA 305) on the canopen package: fastscan for unconfigured nodes, assignment of node ids."""

# mypy: disallow-untyped-calls=False
# (the canopen package is typed in part)
from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import canopen
from canopen.lss import LssError

from palpate_edge.common.errors import BusError, ConfigError

ANSWER_TIMEOUTS_S = (0.05, 0.2, 0.5)
"""Response timeouts of fastscan, tried in turn until a scan succeeds.

A node responds within 1 ms, a busy one later; a scan fails when a response arrives after its timeout.
"""
COMMAND_TIMEOUT_S = 1.0
TRIES = 2
NO_RESPONSE = "No LSS response"  # of the canopen package
MAX_NODES = 127
SETTLE_S = 0.05


@dataclass(frozen=True, slots=True)
class LssAddress:
    """LSS address, unique for each device: the identity object 1018h."""

    vendor: int
    product: int
    revision: int
    serial: int

    def __str__(self) -> str:
        return f"{self.vendor:X}:{self.product:X}:{self.revision:X}:{self.serial:X}"


def parse_address(text: str) -> LssAddress:
    """Parse ``vendor:product:revision:serial`` in hexadecimal. Raises ConfigError for any other text."""
    parts = text.split(":")
    if len(parts) != 4 or not all(re.fullmatch(r"(0x)?[0-9a-fA-F]{1,8}", part) for part in parts):
        raise ConfigError(
            f"LSS address {text!r} is not vendor:product:revision:serial in hexadecimal: copy it from"
            " palpate-host bus lss list"
        )
    return LssAddress(*(int(part, 16) for part in parts))


def find_unconfigured(
    network: canopen.Network,
    progress: Callable[[LssAddress], None] = lambda _address: None,
    timeouts_s: Sequence[float] = ANSWER_TIMEOUTS_S,
) -> list[LssAddress]:
    """Return every node without an id, found by repeated fastscan, each confirmed by its address.

    A found node is in configuration state, where it must not respond to further scans. Some devices respond
    to every request there (CANopenNode), which looks like a node 0:0:0:0 and hides the nodes that are not
    found yet: give the found ones an id, and scan again. All nodes are in LSS waiting state afterwards.
    """
    found: list[LssAddress] = []
    with _lss_errors("fastscan"):
        try:
            while len(found) < MAX_NODES:
                address = _fast_scan(network, timeouts_s)
                if address is None or address in found:
                    break
                found.append(address)
        finally:
            _switch_to_waiting(network)
        with _timeout(network, COMMAND_TIMEOUT_S):
            confirmed = [address for address in found if _select(network, address)]
        _switch_to_waiting(network)
    for address in confirmed:
        progress(address)
    return confirmed


def _switch_to_waiting(network: canopen.Network) -> None:
    """Switch every device to LSS waiting state, with pauses: there is no response to wait for.

    A device may miss a request that directly follows its last response or another request: CANopenNode does
    until its main loop has cleared a flag (CO_LSSslave_process). Closing the bus drops frames in the queue.
    """
    time.sleep(SETTLE_S)
    network.lss.send_switch_state_global(network.lss.WAITING_STATE)
    time.sleep(SETTLE_S)


def _select(network: canopen.Network, address: LssAddress) -> bool:
    """Return whether a device responds to its address; it alone is in configuration state then."""
    for _ in range(TRIES):
        _switch_to_waiting(network)
        try:
            return bool(
                network.lss.send_switch_state_selective(
                    address.vendor, address.product, address.revision, address.serial
                )
            )
        except LssError:  # no response
            continue
    return False


def _fast_scan(network: canopen.Network, timeouts_s: Sequence[float]) -> LssAddress | None:
    for timeout_s in timeouts_s:
        with _timeout(network, timeout_s):
            is_found, numbers = network.lss.fast_scan()
        if is_found:
            return LssAddress(*numbers)
    return None


def set_node_id(network: canopen.Network, address: LssAddress, node_id: int, store: bool) -> None:
    """Assign a node id to the device, stored in it if `store`.

    Raises BusError when the device rejects the id or does not respond.
    """
    lss = network.lss
    with _lss_errors(f"device {address}"), _timeout(network, COMMAND_TIMEOUT_S):
        if not _select(network, address):
            raise BusError(
                f"device {address} does not respond: list the unconfigured devices with"
                " palpate-host bus lss list"
            )
        try:
            _configure(lambda: lss.configure_node_id(node_id))
            if store:
                _configure(lss.store_configuration)
        finally:
            _switch_to_waiting(network)


def _configure(request: Callable[[], None]) -> None:
    """Send a request, and again while there is no response. Raises LssError for an error code."""
    for _ in range(TRIES - 1):
        try:
            return request()
        except LssError as error:
            if NO_RESPONSE not in str(error):
                raise
    return request()


def only_unconfigured(network: canopen.Network) -> LssAddress:
    """Return the only node without an id. Raises BusError when there is none or more than one."""
    found = find_unconfigured(network)
    if len(found) != 1:
        names = ", ".join(map(str, found)) or "none"
        raise BusError(f"{len(found)} unconfigured nodes ({names}), not one: choose one with --address")
    return found[0]


@contextmanager
def _lss_errors(what: str) -> Iterator[None]:
    try:
        yield
    except LssError as error:
        reason = " ".join(str(error).split())
        raise BusError(
            f"LSS, {what}: {reason} (error code 1: rejected or not supported, 2: storage failed, "
            "255: not in this NMT state): check the id, that the device supports LSS, and that it is not "
            "OPERATIONAL (palpate-host bus nmt preop NODE)"
        ) from error


@contextmanager
def _timeout(network: canopen.Network, timeout_s: float) -> Iterator[None]:
    former, network.lss.RESPONSE_TIMEOUT = network.lss.RESPONSE_TIMEOUT, timeout_s
    try:
        yield
    finally:
        network.lss.RESPONSE_TIMEOUT = former
