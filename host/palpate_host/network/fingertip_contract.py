"""Objects that a fingertip has to agree in before its contacts are used: identity, calibration, PDOs."""

from __future__ import annotations

from collections.abc import Iterator

from palpate_edge.common.contact_quantities import BASE_TPDOS, CONTACT_TPDOS, POSE_TPDOS
from palpate_edge.node.eds import load_eds
from palpate_edge.node.parsed_eds import FINGERTIP_EDS
from palpate_edge.node.pdo_codec import PdoDirection
from palpate_host.network.node_contract import (
    CALIBRATION,
    SERIAL,
    SOFTWARE,
    Wanted,
    identity_of,
    pdos_of,
)

TIME_STAMP_RPDO = 1  # 1013h, without which exposures are not on the bus clock


def fingertip_contract(
    node_id: int, *, poses: bool = True, serial: int | None = None, calibration: str | None = None
) -> Iterator[Wanted]:
    """Yield the objects of a fingertip in the order of reading.

    poses: the host takes the TPDOs of poses; see :class:`palpate_host.network.fingertips.Fingertip`. serial,
    calibration: 1018h:04 and 2001h, compared if hand.toml has them.
    """
    od = load_eds(FINGERTIP_EDS, node_id)
    yield from identity_of(od, "correct fingertip_node; palpate-host bus scan lists the nodes")
    if serial is not None:
        yield Wanted(SERIAL, serial, "connect that fingertip, or correct fingers.serial")
    version = str(od.entry(*SOFTWARE).default)
    yield Wanted(SOFTWARE, version, f"install palpate {version} on its board, or its version here")
    if calibration is not None:
        remedy = "start it with that calibration, or correct fingers.calibration"
        yield Wanted(CALIBRATION, calibration, remedy)
    remedy = f"palpate-host bus sdo restore 0x{node_id:02X}"
    taken = [number for number in CONTACT_TPDOS if poses or number not in POSE_TPDOS]
    yield from pdos_of(od, PdoDirection.TRANSMIT, taken, BASE_TPDOS, remedy)
    yield from pdos_of(od, PdoDirection.RECEIVE, [TIME_STAMP_RPDO], [TIME_STAMP_RPDO], remedy)
