"""Simulated drives at their real border: CAN frames or Modbus bytes.

Belongs here: plants, servos and simulated drives. May use: palpate_host.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["SimulatedDrive"]

__getattr__ = lazy_exports(__name__, {"simulated_drives": "SimulatedDrive"})
