"""The screen of a hand: lines from the host's status, for any size of a terminal. Pure."""

from __future__ import annotations

import math

from palpate_edge.common.terminal.bar_chart import level_bar, round_scale
from palpate_edge.common.terminal.lines import (
    GREEN,
    GREY,
    RED,
    YELLOW,
    Line,
    Palette,
    Span,
    number_text,
    text_line,
)
from palpate_host.common.mode import STOPPED, Mode
from palpate_host.common.status import FingerStatus, HostStatus, JointStatus

LEAST_SIZE = (60, 16)
BAR_COLUMNS = 12
LEAST_FULL_N, FULL_NM_STEP = 2.0, 0.1
KEYS = "SPACE stop  g grasp  x/X y/Y z/Z turn -/+10 deg  r release  c recover  q quit"
FINGER_HEAD = f"{'finger':<12}{'contact':<9}{'normal':<9}{'':<{BAR_COLUMNS + 2}}{'age':<9}rate"
JOINT_HEAD = f"{'joint':<12}{'position':<11}{'torque':<10}{'':<{BAR_COLUMNS + 2}}{'command':<10}drive"


def hand_lines(
    status: HostStatus | None,
    connection: str,
    notice: str,
    question: str,
    columns: int,
    rows: int,
    _palette: Palette,
) -> list[Line]:
    """Return the `rows` lines of the screen, each for `columns` columns at most.

    connection: why no status comes, or empty. notice: answer to the last command. question: the command that
    waits for Enter, or empty. From top to bottom: mode with its reason, warning, fingers, joints, notice,
    keys; where the rows do not suffice, the last joints are left out.
    """
    if columns < LEAST_SIZE[0] or rows < LEAST_SIZE[1]:
        least = "{} x {}".format(*LEAST_SIZE)
        return [text_line(f"{columns} x {rows} is too small: at least {least}; SPACE stops, q quits")]
    foot = [text_line(notice, YELLOW), _keys(question)]
    body = [] if status is None else _body(status)
    head = [text_line(connection, RED)] if connection else []
    shown = [*head, *body][: rows - len(foot)]
    return [*shown, *([] for _ in range(rows - len(foot) - len(shown))), *foot]


def _keys(question: str) -> Line:
    if question:
        return text_line(f"{question}: Enter sends it, any other key drops it; SPACE stops", YELLOW)
    return text_line(KEYS, GREY)


def _body(status: HostStatus) -> list[Line]:
    forces = (finger.normal_force_N or 0.0 for finger in status.fingers)
    torques = (abs(joint.torque_Nm or 0.0) for joint in status.joints)
    full_N = max(LEAST_FULL_N, round_scale(max(forces, default=0.0)))
    full_Nm = FULL_NM_STEP * round_scale(max(torques, default=0.0) / FULL_NM_STEP)
    return [
        _mode(status),
        text_line("; ".join(filter(None, (status.warning, status.last_emergency))), YELLOW),
        _turn(status),
        text_line(FINGER_HEAD, GREY),
        *(_finger(finger, full_N) for finger in status.fingers),
        text_line(JOINT_HEAD, GREY),
        *(_joint(joint, full_Nm) for joint in status.joints),
    ]


def _mode(status: HostStatus) -> Line:
    mode = status.mode
    colour = RED if mode in STOPPED else YELLOW if mode in (Mode.HOLD, Mode.BLIND) else GREEN
    return [Span(f"{mode.value:<12}", colour), Span(status.reason)]


def _turn(status: HostStatus) -> Line:
    target, turned = status.target_rpy_deg, status.turned
    angles = "–" if target is None else ", ".join(f"{angle:.0f}" for angle in target)
    done = "" if turned is None else f"  done {100 * turned:.0f} %"
    error = number_text(status.orientation_error_deg, 2, "deg")
    return [Span("target      ", GREY), Span(f"{angles} deg{done}  orientation error {error}")]


def _finger(finger: FingerStatus, full_N: float) -> Line:
    if not finger.valid:
        contact, colour = "invalid", RED
    elif finger.in_contact:
        contact, colour = ("slips", RED) if finger.slip else ("yes", GREEN)
    else:
        contact, colour = "none", GREY
    return [
        Span(f"{finger.name[:11]:<12}"),
        Span(f"{contact:<9}", colour),
        Span(f"{number_text(finger.normal_force_N, 2, 'N'):<9}"),
        *level_bar(finger.normal_force_N, full_N, BAR_COLUMNS),
        Span(f"  {number_text(finger.age_ms, 0, 'ms'):<9}{finger.frames_per_s:.0f} /s"),
    ]


def _joint(joint: JointStatus, full_Nm: float) -> Line:
    position_deg = None if joint.position_rad is None else math.degrees(joint.position_rad)
    torque_Nm = joint.torque_Nm
    return [
        Span(f"{joint.name[:11]:<12}{number_text(position_deg, 1, 'deg'):<11}"),
        Span(f"{number_text(torque_Nm, 3, 'Nm'):<10}"),
        *level_bar(None if torque_Nm is None else abs(torque_Nm), full_Nm, BAR_COLUMNS),
        Span(f"  {number_text(joint.command_Nm, 3, 'Nm'):<10}{joint.drive_state}"),
    ]
