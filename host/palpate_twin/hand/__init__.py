"""Dynamics of hand and object, rolling or with friction (Eqs. (4) to (8)).

Belongs here: engines, the hand's simulation model, films. May use: drives, camera, dome.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["Engine", "FrictionHand", "LostGraspError", "RollingHand"]

__getattr__ = lazy_exports(
    __name__, {"engine": "Engine LostGraspError", "rolling": "RollingHand", "friction": "FrictionHand"}
)
