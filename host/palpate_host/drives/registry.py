"""Registry of drives by their key in hand.toml (`fingers.joints.drive`): palpate's and other packages'.

Another package registers a factory under the entry-point group ``palpate_host.drives``; CONTRIBUTING.md has a
worked example. AZ motors need no key of their own: the gateway makes each one a CiA 402 node.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TypeAlias

from palpate_edge.common.errors import ConfigError
from palpate_host.common.plugins import DRIVES, load_plugin, plugin_names
from palpate_host.drives.cia402 import Cia402Drive
from palpate_host.drives.drive import Drive, DriveNeeds

DriveFactory: TypeAlias = Callable[[DriveNeeds], Drive]

CIA402 = "cia402"
OWN_DRIVES: Mapping[str, DriveFactory] = {CIA402: Cia402Drive}
"""Key -> factory of the drives that are part of palpate."""


def make_drive(needs: DriveNeeds) -> Drive:
    """Make the drive that the joint's key `drive` chooses.

    Raises ConfigError with the allowed keys when no installed package has that key, or with the cause when
    the package that has it cannot be imported.
    """
    key = needs.joint.drive
    own = OWN_DRIVES.get(key)
    if own is not None:
        return own(needs)
    allowed = sorted({*OWN_DRIVES, *plugin_names(DRIVES)})
    if key not in allowed:
        raise ConfigError(
            f"fingers.joints.drive = {key!r} of {needs.joint.name} is not one of {', '.join(allowed)}:"
            f" correct hand.toml, or install the package that provides it (entry-point group {DRIVES})"
        )
    try:
        factory: DriveFactory = load_plugin(DRIVES, key)
    except (ImportError, AttributeError) as exc:
        raise ConfigError(
            f"fingers.joints.drive = {key!r} of {needs.joint.name} cannot be imported ({exc}):"
            " repair the package that provides it"
        ) from exc
    return factory(needs)
