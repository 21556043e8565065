"""The status of a hold, for views and recordings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from palpate_edge.common.arrays import Array
from palpate_host.common.status import HoldStatus
from palpate_host.config.control_config import PoseLawConfig
from palpate_host.control.gait.gait import GaitPhase
from palpate_host.control.manipulation import Manipulation

FAR = 2.0
"""Distance over the workspace's from which the hold ends: a wrong estimate, or an object pulled away."""
DIGITS = 4
"""Digits after the point; a recording keeps a tick's values only where they changed."""


def hold_status(control: Manipulation) -> HoldStatus:
    """Return the friction of each tip; while the pose law holds an object also its pose, load and grip."""
    tips, law = control.friction.tips, control.pose_law
    found = None if law is None else law.object
    status = HoldStatus(
        friction_ratio=tuple(_rounded(tip.ratio) for tip in tips),
        friction=tuple(round(tip.friction, DIGITS) for tip in tips),
        friction_margin=tuple(_rounded(tip.margin) for tip in tips),
        slips=tuple(tip.slips for tip in tips),
        grip_N=None,
        turn_waits=control.turn_waits,
    )
    gait = control.gait
    if control.reorientation.request is not None:
        status = replace(status, gait="planning")
    elif control.reorientation.problem:
        status = replace(status, gait="refused", gait_reason=control.reorientation.problem)
    elif gait is not None:
        status = replace(status, gait=gait.phase.value, gait_reason=gait.reason, lifted=gait.away)
    if law is None or found is None:
        return status
    return replace(
        status,
        grip_N=round(law.grip_N, DIGITS),
        place_mm=_vector(1e3 * found.place_m),
        place95_mm=round(law.uncertainty.place95_mm(law.moved_mm), DIGITS),
        orientation95_deg=round(law.orientation95_deg, DIGITS),
        load_N=_vector(law.load_N),
        is_load_known=law.is_load_known,
        place_error_mm=_rounded(law.place_error_mm),
    )


def hold_fault(control: Manipulation, config: PoseLawConfig) -> str:
    """Return why the hold has to end: the object is far beyond the workspace. Empty otherwise."""
    law = control.pose_law
    if law is None or not (law.moved_mm > FAR * config.reach_mm or law.turned_deg > FAR * config.reach_deg):
        return ""
    return f"the object is far {_beyond(config)}: take it out, then palpate-host command recover"


def gait_text(control: Manipulation, names: Sequence[str]) -> str:
    """Return what a turn by finger gaiting is doing; empty without one."""
    gait = control.gait
    if control.reorientation.request is not None:
        return "holding: a turn by finger gaiting is being planned"
    if gait is None:
        return ""
    lifted = "" if gait.away is None else f"{names[gait.away]} is lifted"
    if gait.phase is GaitPhase.STOPPED:
        way_out = f"; {lifted}: palpate-host command grasp lets it take hold" if lifted else ""
        return gait.reason + way_out
    if gait.phase is GaitPhase.DONE:
        return ""
    return f"turning by finger gaiting: {gait.phase.value}" + (f", {lifted}" if lifted else "")


def hold_warning(control: Manipulation, config: PoseLawConfig, names: Sequence[str]) -> str:
    """Return what is unusual about the hold, empty without anything.

    Slip; a load that is not known yet; a grip at its limit; an object beyond the workspace of `move`.
    """
    law, found = control.pose_law, []
    lowered = [name for name, tip in zip(names, control.friction.tips, strict=True) if tip.is_lowered]
    if lowered:
        waits = ", and the turn waits where friction holds" if control.turn_waits else ""
        found.append(f"{', '.join(lowered)}: slipped, so less friction is assumed{waits}")
    if control.reorientation.problem:
        found.append(control.reorientation.problem)
    if law is not None and law.object is not None:
        if not law.is_load_known:
            found.append("weight unknown: the load on the object is being learned")
        if law.is_grip_at_limit:
            found.append(f"grip at its limit: the load needs more than most_grip_N = {config.most_grip_N:g}")
        if law.moved_mm > config.reach_mm or law.turned_deg > config.reach_deg:
            found.append(f"the object is {_beyond(config)}")
    return "; ".join(found)


def _beyond(config: PoseLawConfig) -> str:
    return (
        f"beyond the workspace, pose_law.reach_mm = {config.reach_mm:g}, reach_deg = {config.reach_deg:g}"
        " from where the hold began"
    )


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, DIGITS)


def _vector(v: Array) -> tuple[float, float, float]:
    x, y, z = v.tolist()
    return round(x, DIGITS), round(y, DIGITS), round(z, DIGITS)
