"""Which law may move the hand: the modes and what switches between them. Pure, in the time it is given.

The ladder of staleness: a contact older than `warn` is reported, older than `freeze` (or let go) freezes the
desired frame, older than `hold` leaves only the grasp, and a fingertip without a valid frame for `stop` stops
the hand. STOP is left by no input: a person starts the host again. Every mode keeps the torque limits
(control.py).
"""

from __future__ import annotations

import enum
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace


class Mode(enum.Enum):
    """What the host does with the joints."""

    INIT = "init"  # nodes missing: drives off
    READY = "ready"  # drives enabling, torque 0, waiting for the first frames
    HOLD = "hold"  # grasp only, u_sg
    MANIPULATE = "manipulate"  # Eqs. (9)-(16), contacts correct the desired frame
    BLIND = "blind"  # Eqs. (9)-(14), desired frame frozen or by joint angles alone
    STOP = "stop"  # torque 0, drives quick-stopped


@dataclass(frozen=True, slots=True)
class Tiers:
    """Times of the ladder and of the settling grasp, in us."""

    warn_us: int
    freeze_us: int
    hold_us: int
    stop_us: int
    settle_us: int


@dataclass(frozen=True, slots=True)
class FingerHealth:
    """One fingertip: ages of its last valid frame and contact (None: never); whether it touches."""

    name: str
    frame_age_us: int | None
    contact_age_us: int | None
    in_contact: bool
    is_silent: bool


@dataclass(frozen=True, slots=True)
class Inputs:
    """What one decision sees. The texts are reasons; empty means there is none.

    stop: operator's wish, drive fault, bus fault or lost joint. waiting_for: nodes not yet operating.
    drives_waiting: drives not yet enabled. no_virtual_frame: why R_vir of Eq. (12) does not exist now.
    no_contact_frame: why the contacts give no R_c of Eq. (16) now.
    blind_by_choice: the configuration asks for Tahara's law: fingertips do not matter.
    """

    now_us: int
    stop: str
    waiting_for: str
    drives_waiting: str
    no_virtual_frame: str
    no_contact_frame: str
    blind_by_choice: bool
    fingers: Sequence[FingerHealth]


@dataclass(frozen=True, slots=True)
class Decision:
    """The mode, why, and since when."""

    mode: Mode
    reason: str
    since_us: int
    warning: str = ""


def decide(last: Decision, inputs: Inputs, tiers: Tiers) -> Decision:
    """The next decision; `since_us` moves only when the mode changes."""
    if last.mode is Mode.STOP:
        return last
    mode, reason = _next_mode(last, inputs, tiers)
    warning = "" if mode in (Mode.INIT, Mode.READY, Mode.STOP) else _warning(inputs, tiers)
    if mode is last.mode:
        return replace(last, reason=reason, warning=warning)
    return Decision(mode, reason, inputs.now_us, warning)


def _next_mode(last: Decision, inputs: Inputs, tiers: Tiers) -> tuple[Mode, str]:
    if inputs.stop:
        return Mode.STOP, inputs.stop
    if last.mode is Mode.INIT and inputs.waiting_for:
        return Mode.INIT, f"waiting for {inputs.waiting_for}"
    if last.mode in (Mode.INIT, Mode.READY):
        waiting = inputs.drives_waiting or _first_frame_missing(inputs)
        if waiting:
            return Mode.READY, f"waiting for {waiting}"
        return Mode.HOLD, "grasping"
    if inputs.blind_by_choice:
        return _by_joint_angles(last, inputs, tiers)
    return _by_contacts(last, inputs, tiers)


def _first_frame_missing(inputs: Inputs) -> str:
    if inputs.blind_by_choice:
        return ""
    missing = [finger.name for finger in inputs.fingers if finger.frame_age_us is None]
    return f"a valid frame of {', '.join(missing)}" if missing else ""


def _by_joint_angles(last: Decision, inputs: Inputs, tiers: Tiers) -> tuple[Mode, str]:
    if inputs.no_virtual_frame:
        return Mode.HOLD, inputs.no_virtual_frame
    if last.mode is Mode.HOLD and inputs.now_us - last.since_us < tiers.settle_us:
        return Mode.HOLD, "grasp settling"
    return Mode.BLIND, "control.mode is blind"


def _by_contacts(last: Decision, inputs: Inputs, tiers: Tiers) -> tuple[Mode, str]:
    for finger in inputs.fingers:
        if finger.frame_age_us is None or finger.frame_age_us > tiers.stop_us:
            return Mode.STOP, f"{finger.name}: no valid frame for more than {tiers.stop_us // 1000} ms"
    only_grasp = inputs.no_virtual_frame or _first(_grasp_reason, inputs.fingers, tiers)
    if only_grasp:
        return Mode.HOLD, only_grasp
    frozen = _first(_freeze_reason, inputs.fingers, tiers) or inputs.no_contact_frame
    was_turning = last.mode in (Mode.MANIPULATE, Mode.BLIND)
    if frozen:
        return (Mode.BLIND if was_turning else Mode.HOLD), frozen
    if not was_turning and inputs.now_us - last.since_us < tiers.settle_us:
        return Mode.HOLD, "grasp settling"
    return Mode.MANIPULATE, "every finger in contact"


def _first(
    reason: Callable[[FingerHealth, Tiers], str], fingers: Sequence[FingerHealth], tiers: Tiers
) -> str:
    return next((text for finger in fingers if (text := reason(finger, tiers))), "")


def _grasp_reason(finger: FingerHealth, tiers: Tiers) -> str:
    if finger.is_silent:
        return f"{finger.name}: heartbeat lost"
    if finger.contact_age_us is None or finger.contact_age_us > tiers.hold_us:
        return f"{finger.name}: no contact for more than {tiers.hold_us // 1000} ms"
    return ""


def _freeze_reason(finger: FingerHealth, tiers: Tiers) -> str:
    if not finger.in_contact:
        return f"{finger.name}: no contact"
    if finger.contact_age_us is not None and finger.contact_age_us > tiers.freeze_us:
        return f"{finger.name}: contact older than {tiers.freeze_us // 1000} ms"
    return ""


def _warning(inputs: Inputs, tiers: Tiers) -> str:
    old = [
        f"{finger.name}: contact {finger.contact_age_us // 1000} ms old"
        for finger in inputs.fingers
        if finger.contact_age_us is not None and finger.contact_age_us > tiers.warn_us
    ]
    return "; ".join(old)
