"""The CAN bus as a fingertip or host sees it.

Belongs here: CAN frames, opening and reopening a bus, the transmit queue, the bus clock. May use: common.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["Bus", "BusClock", "BusConfig", "CanFrame", "ReconnectingBus", "TransmitQueue", "open_bus"]

__getattr__ = lazy_exports(
    __name__,
    {
        "bus": "Bus BusConfig open_bus",
        "can_frame": "CanFrame",
        "reconnecting_bus": "ReconnectingBus",
        "clock_sync": "BusClock",
        "transmit_queue": "TransmitQueue",
    },
)
