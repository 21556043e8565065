"""Objects that a fingertip has to agree in before its contacts are used: identity, calibration, PDOs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from palpate_edge.common.contact_quantities import BASE_TPDOS, CONTACT_TPDOS, FD_TPDO, POSE_TPDOS
from palpate_edge.node.eds import load_eds
from palpate_edge.node.fd_bus import on_fd_bus
from palpate_edge.node.fingertip_objects import DATA_BITRATE
from palpate_edge.node.object_dictionary import ObjectDictionary
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
    node_id: int,
    *,
    poses: bool = True,
    serial: int | None = None,
    calibration: str | None = None,
    software: str | None = None,
    data_bitrate: int | None = None,
) -> Iterator[Wanted]:
    """Yield the objects of a fingertip in the order of reading.

    poses: the host takes the TPDOs of poses; see :class:`palpate_host.network.fingertips.Fingertip`. serial,
    calibration: 1018h:04 and 2001h, compared if hand.toml has them. software: 100Ah by hand.toml, None for
    the version of the EDS. data_bitrate: that of a CAN FD bus.
    """
    od = load_eds(FINGERTIP_EDS, node_id)
    yield from identity_of(od, "correct fingertip_node; palpate-host bus scan lists the nodes")
    accept = f"use this one: palpate-host command accept 0x{node_id:02X}"
    if serial is not None:
        remedy = f"connect that fingertip, or {accept}"
        yield Wanted(SERIAL, serial, remedy, key_in_hand="serial")
    version = str(od.entry(*SOFTWARE).default) if software is None else software
    remedy = f"install palpate {version} on its board, or {accept}"
    yield Wanted(SOFTWARE, version, remedy, key_in_hand="software")
    if calibration is not None:
        remedy = f"start it with that calibration, or {accept}"
        yield Wanted(CALIBRATION, calibration, remedy, key_in_hand="calibration")
    remedy = f"palpate-host bus sdo restore 0x{node_id:02X}"
    if data_bitrate is None:
        yield from _classic_contact(od, poses, remedy)
    else:
        yield from _fd_contact(od, data_bitrate, remedy)
    yield from pdos_of(od, PdoDirection.RECEIVE, [TIME_STAMP_RPDO], [TIME_STAMP_RPDO], remedy)


def _classic_contact(od: ObjectDictionary, poses: bool, remedy: str) -> Iterator[Wanted]:
    taken = [number for number in CONTACT_TPDOS if poses or number not in POSE_TPDOS]
    first, *others = pdos_of(od, PdoDirection.TRANSMIT, taken, BASE_TPDOS, remedy)
    yield replace(first, remedy=f"{remedy}; if its finger.toml has bus.data_bitrate, give hand.toml the same")
    yield from others


def _fd_contact(od: ObjectDictionary, data_bitrate: int, remedy: str) -> Iterator[Wanted]:
    """Yield the data bit rate, the COB-IDs of all TPDOs, and the mapping of TPDO 10, poses or not."""
    same = f"set bus.data_bitrate to {data_bitrate} in its finger.toml, or remove it from hand.toml"
    yield Wanted((DATA_BITRATE, 0), data_bitrate, same)
    count = (PdoDirection.TRANSMIT.mapping_index + FD_TPDO - 1, 0)
    whole = on_fd_bus(od, poses=True)
    for wanted in pdos_of(whole, PdoDirection.TRANSMIT, [FD_TPDO], [FD_TPDO], remedy):
        is_count = wanted.key == count
        yield replace(wanted, also=od.default_number(*count)) if is_count else wanted
