"""Registry of drives by their key in hand.toml (`fingers.joints.drive`): palpate's and other packages'.

Another package registers a factory under the entry-point group ``palpate_host.drives``; CONTRIBUTING.md has a
worked example. AZ motors need no key of their own: the gateway makes each one a CiA 402 node.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeAlias

from palpate_edge.common.plugins import load_part
from palpate_host.common.plugin_groups import DRIVES
from palpate_host.drives.cia402_axes import axes_of_node
from palpate_host.drives.drive import Drive, DriveNeeds

DriveFactory: TypeAlias = Callable[[DriveNeeds], Drive]

CIA402 = "cia402"
OWN_DRIVES = {CIA402: "palpate_host.drives.cia402:Cia402Drive"}
"""Key -> ``module:factory`` of the drives that are part of palpate."""


def make_drive(needs: DriveNeeds) -> Drive:
    """Make the drive that the joint's key `drive` chooses.

    Raises ConfigError with the allowed keys when no installed package has that key, or with the cause when
    the package that has it cannot be imported.
    """
    choice = f"fingers.joints.drive = {needs.joint.drive!r} of {needs.joint.name}"
    factory: DriveFactory = load_part(DRIVES, needs.joint.drive, choice, OWN_DRIVES)
    return factory(needs)


def make_drives(needs: Sequence[DriveNeeds]) -> tuple[Drive, ...]:
    """Make the drives of a hand, in the order of `needs`; joints that share a node share its frames.

    Raises ConfigError as `make_drive`.
    """
    drives: dict[str, Drive] = {}
    for one in needs:
        if not one.axes:
            drives[one.joint.name] = make_drive(one)
        elif one.joint.name not in drives:
            of_node = [other for other in needs if other.node_id == one.node_id]
            names = [other.joint.name for other in of_node]
            drives |= dict(zip(names, axes_of_node(of_node), strict=True))
    return tuple(drives[one.joint.name] for one in needs)
