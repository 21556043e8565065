"""Nodes of a scan, sorted by their objects into the fingertips and drives of a hand; pure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from palpate_bus.master.scan import FoundNode
from palpate_edge.common.errors import BusError
from palpate_edge.node.eds import load_eds
from palpate_edge.node.parsed_eds import FINGERTIP_EDS
from palpate_host.network.node_contract import PRODUCT, VENDOR
from palpate_host.service.hand_check import DRIVE_PROFILE, FINGERTIP_PROFILE

LEAST_TURN_RAD = 0.05
"""Smallest turn of a joint that identifies its drive; the play of a gear is smaller."""


class DrivePlace(NamedTuple):
    """A drive on the bus: its node, and its axis where the node has several."""

    node_id: int
    axis: int | None = None

    def __str__(self) -> str:
        return f"{self.node_id}" if self.axis is None else f"{self.node_id}:{self.axis}"


@dataclass(frozen=True, slots=True)
class HandNodes:
    """The nodes of a bus, each kind in the order of node ids. others: devices that no hand uses."""

    fingertips: tuple[FoundNode, ...]
    drives: tuple[FoundNode, ...]
    others: tuple[FoundNode, ...]

    @property
    def lines(self) -> list[str]:
        """One line of text for each node."""
        kinds = (("fingertip", self.fingertips), ("drive", self.drives), ("other", self.others))
        return [_line(kind, node) for kind, nodes in kinds for node in nodes]


def sort_nodes(found: Iterable[FoundNode], host_node: int) -> HandNodes:
    """Return the nodes by kind: drives by 1000h, fingertips also by vendor and product of their EDS.

    Raises BusError when several nodes have one id, or a host runs as `host_node`.
    """
    nodes = list(found)
    for node in nodes:
        if node.node_id == host_node:
            raise BusError(
                f"node 0x{host_node:02X} is on this bus, the id of a host: stop palpate-host run first"
            )
        if node.answers > 1:
            raise BusError(
                f"{node.answers} nodes have the id 0x{node.node_id:02X}: give one another (bus lss)"
            )
    od = load_eds(FINGERTIP_EDS, 1)
    make = (od.default_number(*VENDOR), od.default_number(*PRODUCT))
    tips = tuple(one for one in nodes if _profile(one) == FINGERTIP_PROFILE and one.identity[:2] == make)
    drives = tuple(one for one in nodes if _profile(one) == DRIVE_PROFILE)
    return HandNodes(tips, drives, tuple(one for one in nodes if one not in tips + drives))


def turned_drive(
    before_rad: Mapping[DrivePlace, float], after_rad: Mapping[DrivePlace, float]
) -> tuple[DrivePlace, int] | None:
    """Return the drive that turned most between two readings of the angles, and its direction, 1 or -1.

    None when no drive turned by LEAST_TURN_RAD.
    """
    turns_rad = {place: after_rad[place] - angle for place, angle in before_rad.items() if place in after_rad}
    place = max(turns_rad, key=lambda one: abs(turns_rad[one]), default=None)
    if place is None or abs(turns_rad[place]) < LEAST_TURN_RAD:
        return None
    return place, 1 if turns_rad[place] > 0 else -1


def _profile(node: FoundNode) -> int:
    return (node.device_type or 0) & 0xFFFF


def _line(kind: str, node: FoundNode) -> str:
    identity = "/".join("-" if number is None else f"{number:X}" for number in node.identity)
    words = (node.name or node.profile or "no name", f"1018h {identity}", node.state, node.remark)
    return f"{kind:<10}0x{node.node_id:02X}  {', '.join(word for word in words if word)}"
