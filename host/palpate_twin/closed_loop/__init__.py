"""Hand, fingertips, bus and host together, in lock step or in real time.

Belongs here: what joins the parts of the twin. May use: hand, camera, drives, dome.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["LiveHand", "LockstepLoop"]

__getattr__ = lazy_exports(__name__, {"lockstep": "LockstepLoop", "live_hand": "LiveHand"})
