"""Joint drives: the master's side of each kind of drive, and the device's side of CiA 402.

Belongs here: one kind of drive a file, their group, modes and homing. May use: safety, control, config,
common, palpate_bus.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["Cia402Device", "Cia402Drive", "DriveGroup"]

__getattr__ = lazy_exports(
    __name__, {"drive_group": "DriveGroup", "cia402": "Cia402Drive", "cia402_device": "Cia402Device"}
)
