"""palpate_host: gathers the fingertips, computes the virtual-frame torques and drives the hand.

    from palpate_host import Hand

    with Hand.open("hand.toml") as hand:
        hand.grasp()
        hand.rotate(rpy_deg=(30, 0, 0))

`Hand` here is a running hand (session.py); its kinematics are `palpate_host.control.kinematics.Hand`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from palpate_host.operator.session import Hand

__all__ = ["Hand"]


def __getattr__(name: str) -> type:
    """`Hand` when it is first asked for: the commands shall not wait for what it imports."""
    if name != "Hand":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from palpate_host.operator.session import Hand  # noqa: PLC0415

    return Hand
