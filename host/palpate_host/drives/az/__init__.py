"""Oriental Motor AZ drives on RS-485 (Modbus), served as CiA 402 nodes.

Belongs here: registers, ports, axes and the gateway. May use: the same rooms as drives.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["AzConfig", "run_gateway"]

__getattr__ = lazy_exports(__name__, {"gateway": "run_gateway", "config": "AzConfig"})
