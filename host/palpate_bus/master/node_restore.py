"""Restoring of a node's communication parameters to the defaults of its EDS (CiA 301, 1011h:02)."""

# mypy: disallow-untyped-calls=False
# (the canopen package is typed in part)
from __future__ import annotations

import threading

import canopen

from palpate_bus.decode.device import Device
from palpate_bus.master import sdo_access
from palpate_bus.master.node_check import differences
from palpate_bus.master.session import sdo_client
from palpate_edge.common.errors import BusError
from palpate_edge.node.nmt import ERROR_CONTROL_ID, NMT_ID, NmtCommand, NmtState

RESTORE_COMMUNICATION = (0x1011, 2)
LOAD = b"load"


def restore(network: canopen.Network, device: Device, timeout_s: float, boot_s: float) -> list[str]:
    """Restore the node and reset its communication; return its remaining differences from the EDS.

    A node that stores nothing rejects 1011h; it has the defaults after its reset all the same. Raises
    BusError when the node does not respond or does not boot within `boot_s`, and with the rejection when its
    parameters still differ.
    """
    node_id, rejection = device.node_id, ""
    client = sdo_client(network, node_id, timeout_s)
    sdo_access.read(client, node_id, device, (0x1000, 0), block=False)  # a node that is off is named here
    network.send_message(NMT_ID, bytes((NmtCommand.ENTER_PRE_OPERATIONAL, node_id)))
    try:
        sdo_access.write(client, node_id, device, RESTORE_COMMUNICATION, LOAD, block=False)
    except BusError as error:
        rejection = str(error)
    _reset(network, node_id, boot_s)
    found = list(differences(device, lambda key: sdo_access.read_number(client, node_id, device, key)))
    if found and rejection:
        raise BusError(rejection)
    return found


def _reset(network: canopen.Network, node_id: int, boot_s: float) -> None:
    booted = threading.Event()

    def heard(_can_id: int, data: bytearray, _stamp: float) -> None:
        if bytes(data) == bytes((NmtState.INITIALISING,)):
            booted.set()

    network.subscribe(ERROR_CONTROL_ID + node_id, heard)
    try:
        network.send_message(NMT_ID, bytes((NmtCommand.RESET_COMMUNICATION, node_id)))
        if not booted.wait(boot_s):
            raise BusError(
                f"node 0x{node_id:02X} did not boot within {boot_s:g} s of its reset: check its power"
            )
    finally:
        network.unsubscribe(ERROR_CONTROL_ID + node_id, heard)
