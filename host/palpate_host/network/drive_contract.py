"""Objects that a CiA 402 drive has to agree in before it is started: COB-ID and mapping of its PDOs."""

from __future__ import annotations

from collections.abc import Iterator

from palpate_bus.eds.cia402 import CIA402_EDS
from palpate_edge.node.eds import load_eds
from palpate_edge.node.pdo_codec import PdoDirection
from palpate_host.common.joint_command import Follows
from palpate_host.drives.cia402_modes import COMMAND_MAPPING
from palpate_host.network.node_contract import Wanted, mapping_of, pdos_of

COMMAND_RPDO = 1
STATE_TPDOS = (1, 2)


def drive_contract(node_id: int, follows: Follows) -> Iterator[Wanted]:
    """Yield the objects of a drive in the order of reading.

    Transmission types are not compared: drives of other makes send TPDO 2 in their own time. Identity and
    scale are read by identify.py.
    """
    od = load_eds(CIA402_EDS, node_id)
    remedy = f"palpate-host bus sdo restore 0x{node_id:02X}, or map it as in {od.source}"
    yield from pdos_of(od, PdoDirection.TRANSMIT, STATE_TPDOS, STATE_TPDOS, remedy, types=False)
    yield from pdos_of(od, PdoDirection.RECEIVE, (), (COMMAND_RPDO,), remedy)
    yield from mapping_of(PdoDirection.RECEIVE, COMMAND_RPDO, COMMAND_MAPPING[follows], remedy)
