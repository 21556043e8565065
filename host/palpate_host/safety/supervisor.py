"""The modes of the hand and the transitions between them: which control law may move the joints.

    INIT -> CHECK -> HOME -> READY -> GRASP -> MANIPULATE <-> BLIND, HOLD        any -> FAULT, STOP

Pure: the time is an argument. The tiers of staleness: a contact older than `warn_us` is reported; older than
`freeze_us`, or lost, it freezes the desired frame; older than `hold_us` it leaves only the grasp; a fingertip
without a valid frame for `stop_us` is a fault. A finger that a gait has lifted touches nothing: of it the age
of its frames counts in place of its contact's. A held object that fewer than two fingers have touched for
`lost_us` is lost, which is a fault too. Only the operator's `Recover` leads out of FAULT and STOP
(host_core.py). The limits hold in every mode (control_law.py, runaway.py).
"""

from __future__ import annotations

import enum
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from palpate_host.common.mode import STARTING, STOPPED, Mode

NO_PLACE = 'gives no contact place: turn with control.mode = "blind", or calibrate it with contact places'
NO_FORCE = (
    "gives no contact force, so limits.contact_force_N cannot be kept: calibrate it with forces, "
    'or set the limit to inf, or control.mode = "blind"'
)
"""What a fingertip lacks for control by contacts, and the ways out."""


class Goal(enum.Enum):
    """The operator's goal for the hand; each goal includes the ones before it."""

    NOTHING = "nothing"
    GRASP = "grasp"
    TURN = "turn"


@dataclass(frozen=True, slots=True)
class Tiers:
    """Durations in us: the tiers of staleness, the loss of the object, the settling of the grasp, the opening
    on release."""

    warn_us: int
    freeze_us: int
    hold_us: int
    stop_us: int
    lost_us: int
    settle_us: int
    release_us: int


@dataclass(frozen=True, slots=True)
class FingerHealth:
    """One fingertip: ages of its last valid frame and of its last contact, None when there was none.

    gives_no_place, gives_no_force: its calibration knows no contact places or no newtons. unverified: why
    its contacts are not used, empty once its parameters have been read and agree. is_lifted: by a gait.
    """

    name: str
    frame_age_us: int | None
    contact_age_us: int | None
    in_contact: bool
    heartbeat_timed_out: bool
    gives_no_place: bool = False
    gives_no_force: bool = False
    unverified: str = ""
    is_lifted: bool = False


@dataclass(frozen=True, slots=True)
class Inputs:
    """The inputs of one decision. The texts are reasons; an empty text means that there is none.

    stop: the operator's stop. fault: of a drive, the bus, a lost joint or a limit. missing: nodes that have
    not reported since their reset. unchecked: nodes that are not operational yet. homing: the drive that is
    looking for its zero. drives_waiting: the first drive that is not enabled. no_virtual_frame: why R_vir of
    Eq. (12) does not exist. no_contact_frame: why the contacts give no R_c of Eq. (16). blind_by_choice: the
    configuration selects Tahara's law, which needs no fingertip. force_is_limited: limits.contact_force_N is
    finite, so every fingertip has to measure its force. left_out: fingers whose contacts contradict the
    others. hold_warning: what is unusual about the hold (hold_report.py). gait: what a turn by finger gaiting
    is doing.
    """

    now_us: int
    stop: str
    fault: str
    missing: str
    unchecked: str
    homing: str
    drives_waiting: str
    no_virtual_frame: str
    no_contact_frame: str
    blind_by_choice: bool
    goal: Goal
    fingers: Sequence[FingerHealth]
    force_is_limited: bool = True
    left_out: str = ""
    hold_warning: str = ""
    gait: str = ""


@dataclass(frozen=True, slots=True)
class Decision:
    """A mode, its reason and its beginning; `warning` reports stale contacts."""

    mode: Mode
    reason: str
    since_us: int
    warning: str = ""


def decide(last: Decision, inputs: Inputs, tiers: Tiers) -> Decision:
    """Return the next decision; `since_us` changes only with the mode."""
    if last.mode in STOPPED:
        return last
    mode, reason = _next_mode(last, inputs, tiers)
    warning = "" if mode in STARTING + STOPPED else _warning(inputs, tiers)
    if mode is last.mode:
        return replace(last, reason=reason, warning=warning)
    return Decision(mode, reason, inputs.now_us, warning)


def _next_mode(last: Decision, inputs: Inputs, tiers: Tiers) -> tuple[Mode, str]:
    if inputs.stop or inputs.fault:
        return (Mode.STOP, inputs.stop) if inputs.stop else (Mode.FAULT, inputs.fault)
    if last.mode in STARTING:
        return _starting(last.mode, inputs)
    if inputs.goal is Goal.NOTHING:
        is_open = last.mode is Mode.RELEASE and inputs.now_us - last.since_us >= tiers.release_us
        return (Mode.READY, "released") if is_open else (Mode.RELEASE, "opening")
    if last.mode is Mode.RELEASE:
        return Mode.GRASP, "grasping"
    return (_by_joint_angles if inputs.blind_by_choice else _by_contacts)(last, inputs, tiers)


def _starting(last: Mode, inputs: Inputs) -> tuple[Mode, str]:
    """Return the next stage of the start-up.

    READY returns to an earlier stage only for a drive that has booted again and may have lost its zero; any
    other drive is just enabled again.
    """
    if last is not Mode.READY or inputs.homing:
        if inputs.missing:
            return Mode.INIT, f"waiting for {inputs.missing}"
        if inputs.unchecked:
            return Mode.CHECK, f"waiting for {inputs.unchecked}"
        if inputs.homing:
            return Mode.HOME, f"homing {inputs.homing}"
    waiting = inputs.drives_waiting or _first_unverified(inputs) or _first_frame_missing(inputs)
    blocked = f"waiting for {waiting}" if waiting else _force_not_known(inputs)
    if blocked:
        return Mode.READY, blocked
    if inputs.goal is Goal.NOTHING:
        return Mode.READY, "waiting for a command: palpate-host command grasp"
    return Mode.GRASP, "grasping"


def _first_unverified(inputs: Inputs) -> str:
    if inputs.blind_by_choice:
        return ""
    return next((finger.unverified for finger in inputs.fingers if finger.unverified), "")


def _first_frame_missing(inputs: Inputs) -> str:
    if inputs.blind_by_choice:
        return ""
    missing = [finger.name for finger in inputs.fingers if finger.frame_age_us is None]
    return f"a valid frame of {', '.join(missing)}" if missing else ""


def _by_joint_angles(last: Decision, inputs: Inputs, tiers: Tiers) -> tuple[Mode, str]:
    waits_in = last.mode if last.mode is Mode.GRASP else Mode.HOLD
    if inputs.no_virtual_frame:
        return waits_in, inputs.no_virtual_frame
    if inputs.goal is not Goal.TURN:
        return Mode.GRASP, _GRASPED
    if last.mode is not Mode.BLIND and inputs.now_us - last.since_us < tiers.settle_us:
        return waits_in, "grasp settling"
    return Mode.BLIND, "control.mode is blind"


def _by_contacts(last: Decision, inputs: Inputs, tiers: Tiers) -> tuple[Mode, str]:
    fault = (
        _first(_frame_fault, inputs.fingers, tiers)
        or _object_lost(last, inputs, tiers)
        or _force_not_known(inputs)
    )
    if fault:
        return Mode.FAULT, fault
    waits_in = last.mode if last.mode is Mode.GRASP else Mode.HOLD
    was_turning = last.mode in (Mode.MANIPULATE, Mode.BLIND)
    only_grasp = inputs.no_virtual_frame or _first(_grasp_reason, inputs.fingers, tiers)
    if only_grasp:
        return waits_in, only_grasp
    frozen = _first(_freeze_reason, inputs.fingers, tiers) or inputs.no_contact_frame
    if inputs.goal is not Goal.TURN:
        return Mode.GRASP, frozen or inputs.gait or _GRASPED
    if frozen:
        return (Mode.BLIND if was_turning else waits_in), frozen
    if not was_turning and inputs.now_us - last.since_us < tiers.settle_us:
        return waits_in, "grasp settling"
    return Mode.MANIPULATE, inputs.gait or "every finger in contact"


_GRASPED = "holding: palpate-host command rotate turns the object"


def _first(
    reason: Callable[[FingerHealth, Tiers], str], fingers: Sequence[FingerHealth], tiers: Tiers
) -> str:
    return next((text for finger in fingers if (text := reason(finger, tiers))), "")


def _frame_fault(finger: FingerHealth, tiers: Tiers) -> str:
    if finger.frame_age_us is None or finger.frame_age_us > tiers.stop_us:
        why = f" ({finger.unverified})" if finger.unverified and not finger.heartbeat_timed_out else ""
        return f"{finger.name}: no valid frame for more than {tiers.stop_us // 1000} ms{why}"
    return ""


def _object_lost(last: Decision, inputs: Inputs, tiers: Tiers) -> str:
    """Return why the held object counts as lost; empty while two fingers may still hold it.

    Only frames without contact count: a fingertip that is silent or rejects its frames may be touching. In
    GRASP the object is held once every finger has touched it.
    """
    grasped_for_us = inputs.now_us - last.since_us
    is_held = last.mode is not Mode.GRASP or all(
        finger.contact_age_us is not None and finger.contact_age_us <= grasped_for_us
        for finger in inputs.fingers
    )
    lifted = sum(finger.is_lifted for finger in inputs.fingers)
    empty = [
        finger
        for finger in inputs.fingers
        if not finger.is_lifted
        and not finger.in_contact
        and finger.contact_age_us is not None
        and finger.contact_age_us >= tiers.lost_us
        and finger.frame_age_us is not None
        and finger.frame_age_us <= tiers.warn_us
    ]
    if not is_held or len(inputs.fingers) - lifted - len(empty) >= 2:
        return ""
    names = ", ".join(finger.name for finger in empty)
    return f"the object is lost: no contact of {names} for {tiers.lost_us // 1000} ms"


def _grasp_reason(finger: FingerHealth, tiers: Tiers) -> str:
    if finger.heartbeat_timed_out:
        return f"{finger.name}: heartbeat lost"
    if finger.unverified:
        return finger.unverified
    if finger.is_lifted:
        is_old = finger.frame_age_us is None or finger.frame_age_us > tiers.hold_us
        return f"{finger.name}: lifted, no frame for more than {tiers.hold_us // 1000} ms" if is_old else ""
    if finger.contact_age_us is None or finger.contact_age_us > tiers.hold_us:
        return f"{finger.name}: no contact for more than {tiers.hold_us // 1000} ms"
    return ""


def _force_not_known(inputs: Inputs) -> str:
    """Return why the limit of the contact force cannot be kept; empty when it can, or need not."""
    if inputs.blind_by_choice or not inputs.force_is_limited:
        return ""
    unknown = [finger.name for finger in inputs.fingers if finger.gives_no_force]
    return f"{', '.join(unknown)}: {NO_FORCE}" if unknown else ""


def _freeze_reason(finger: FingerHealth, tiers: Tiers) -> str:
    if finger.gives_no_place:
        return f"{finger.name}: {NO_PLACE}"
    if finger.is_lifted:
        is_old = finger.frame_age_us is None or finger.frame_age_us > tiers.freeze_us
        return f"{finger.name}: lifted, frame older than {tiers.freeze_us // 1000} ms" if is_old else ""
    if not finger.in_contact:
        return f"{finger.name}: no contact"
    if finger.contact_age_us is not None and finger.contact_age_us > tiers.freeze_us:
        return f"{finger.name}: contact older than {tiers.freeze_us // 1000} ms"
    return ""


def _warning(inputs: Inputs, tiers: Tiers) -> str:
    old = [
        f"{finger.name}: contact {finger.contact_age_us // 1000} ms old"
        for finger in inputs.fingers
        if finger.contact_age_us is not None
        and finger.contact_age_us > tiers.warn_us
        and not finger.is_lifted
    ]
    doubtful = [f"{inputs.left_out}: contact does not fit the object, left out"] if inputs.left_out else []
    return "; ".join(old + doubtful + ([inputs.hold_warning] if inputs.hold_warning else []))
