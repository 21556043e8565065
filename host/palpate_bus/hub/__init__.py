"""The local CAN hub: a bus without hardware, for processes of one machine.

Belongs here: the simulated wire, the server, its clients, fault injection and the python-can plug-in. May
use: load, eds, logs.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["FaultRule", "Hub", "HubBus", "HubPort", "Wire"]

__getattr__ = lazy_exports(
    __name__, {"plugin": "HubBus", "port": "HubPort", "server": "Hub", "wire": "Wire", "faults": "FaultRule"}
)
