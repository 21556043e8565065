"""The status of a hold, for views and recordings."""

from __future__ import annotations

from collections.abc import Sequence

from palpate_host.common.status import HoldStatus
from palpate_host.control.manipulation import Manipulation

DIGITS = 4
"""Digits after the point; a recording keeps a tick's values only where they changed."""


def hold_status(control: Manipulation) -> HoldStatus:
    """Return the friction of each tip, and the grip while the pose law holds an object."""
    tips, law = control.friction, control.pose_law
    holds = law is not None and law.object is not None
    return HoldStatus(
        friction_ratio=tuple(_rounded(tip.ratio) for tip in tips),
        friction=tuple(round(tip.friction, DIGITS) for tip in tips),
        friction_margin=tuple(_rounded(tip.margin) for tip in tips),
        slips=tuple(tip.slips for tip in tips),
        grip_N=round(law.grip_N, DIGITS) if law is not None and holds else None,
        turn_waits=control.turn_waits,
    )


def slip_warning(control: Manipulation, names: Sequence[str]) -> str:
    """Return which fingers' friction is lowered by slip, and whether the turn waits; empty without slip."""
    lowered = [name for name, tip in zip(names, control.friction, strict=True) if tip.is_lowered]
    if not lowered:
        return ""
    waits = ", and the turn waits where friction holds" if control.turn_waits else ""
    return f"{', '.join(lowered)}: slipped, so less friction is assumed{waits}"


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, DIGITS)
