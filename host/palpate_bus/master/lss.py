"""LSS master (CiA 305) by the canopen package: finds unconfigured nodes by fastscan, gives node ids."""

# mypy: disallow-untyped-calls=False
# (the canopen package is typed in part)
from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import canopen
from canopen.lss import LssError

from palpate_edge.common.errors import BusError, ConfigError

ANSWER_TIMEOUTS_S = (0.05, 0.2, 0.5)
"""Of one fastscan question, in turn until a scan succeeds: a node answers within a millisecond, a busy one
later, and an answer that comes too late makes a scan fail."""
COMMAND_TIMEOUT_S = 1.0
MAX_NODES = 127
SETTLE_S = 0.05


@dataclass(frozen=True, slots=True)
class LssAddress:
    """What tells one device from all others: 1018h."""

    vendor: int
    product: int
    revision: int
    serial: int

    def __str__(self) -> str:
        return f"{self.vendor:X}:{self.product:X}:{self.revision:X}:{self.serial:X}"


def parse_address(text: str) -> LssAddress:
    """``vendor:product:revision:serial`` in hexadecimal; ConfigError otherwise."""
    parts = text.split(":")
    if len(parts) != 4 or not all(re.fullmatch(r"(0x)?[0-9a-fA-F]{1,8}", part) for part in parts):
        raise ConfigError(
            f"LSS address {text!r}: write vendor:product:revision:serial in hexadecimal, "
            "as palpate-host bus lss list does"
        )
    return LssAddress(*(int(part, 16) for part in parts))


def find_unconfigured(
    network: canopen.Network, progress: Callable[[LssAddress], None] = lambda _address: None
) -> list[LssAddress]:
    """Every node without an id, by repeated fastscan; all are back in LSS waiting afterwards."""
    found: list[LssAddress] = []
    with _lss_errors("fastscan"):
        try:
            while len(found) < MAX_NODES:
                address = _fast_scan(network)
                # A node that has been found must be silent; one that is not would be found for ever.
                if address is None or address in found:
                    return found
                found.append(address)
                progress(address)
        finally:
            network.lss.send_switch_state_global(network.lss.WAITING_STATE)
    return found


def _fast_scan(network: canopen.Network) -> LssAddress | None:
    for timeout_s in ANSWER_TIMEOUTS_S:
        with _timeout(network, timeout_s):
            there, numbers = network.lss.fast_scan()
        if there:
            return LssAddress(*numbers)
    return None


def set_node_id(network: canopen.Network, address: LssAddress, node_id: int, store: bool) -> None:
    """Give the device an id, and have it keep it when `store`. BusError when it refuses or is not there."""
    lss = network.lss
    with _lss_errors(f"device {address}"), _timeout(network, COMMAND_TIMEOUT_S):
        lss.send_switch_state_global(lss.WAITING_STATE)
        if not lss.send_switch_state_selective(
            address.vendor, address.product, address.revision, address.serial
        ):
            raise BusError(f"device {address} does not answer: palpate-host bus lss list shows who does")
        try:
            lss.configure_node_id(node_id)
            if store:
                lss.store_configuration()
        finally:
            lss.send_switch_state_global(lss.WAITING_STATE)
            time.sleep(SETTLE_S)  # closing the bus may drop what its queue still holds


def only_unconfigured(network: canopen.Network) -> LssAddress:
    """The one node without an id; BusError when there is none or more than one."""
    found = find_unconfigured(network)
    if len(found) != 1:
        names = ", ".join(map(str, found)) or "none"
        raise BusError(f"one unconfigured node is wanted, there are {len(found)} ({names}): give --address")
    return found[0]


@contextmanager
def _lss_errors(what: str) -> Iterator[None]:
    try:
        yield
    except LssError as error:
        reason = " ".join(str(error).split())
        raise BusError(
            f"LSS, {what}: {reason}: 1 is refused or not supported, 2 a fault of its storage; "
            "check the id and that the device has LSS"
        ) from error


@contextmanager
def _timeout(network: canopen.Network, timeout_s: float) -> Iterator[None]:
    former, network.lss.RESPONSE_TIMEOUT = network.lss.RESPONSE_TIMEOUT, timeout_s
    try:
        yield
    finally:
        network.lss.RESPONSE_TIMEOUT = former
