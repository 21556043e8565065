"""The commands that each mode of the hand allows. Pure; host_core.py carries them out."""

from __future__ import annotations

from palpate_host.common.command import (
    Accept,
    Command,
    CommandError,
    Grasp,
    Move,
    Recover,
    Release,
    Reorient,
    Rotate,
    Stop,
)
from palpate_host.common.mode import MOVING, STOPPED, Mode
from palpate_host.safety.supervisor import Decision, Goal


def check_allowed(
    command: Command, decision: Decision, goal: Goal, *, is_ending: bool, bus_lost: bool, is_off: bool
) -> None:
    """Raise CommandError, with what to do first, when the mode does not allow the command.

    is_ending: the host is about to exit. is_off: since the stop every drive is commanded off.
    """
    mode = decision.mode
    match command:
        case Stop():
            pass
        case Recover():
            if mode not in STOPPED or is_ending:
                raise _refusal("recover", decision, "there is nothing to recover from")
            if bus_lost:
                raise _refusal("recover", decision, "the bus is lost, the host reopens it by itself")
            if not is_off:
                raise _refusal("recover", decision, "the drives are still stopping, try again")
        case Accept():
            if mode is not Mode.CHECK:
                raise _refusal("accept", decision, "only the mode check has a difference to accept")
        case Rotate() | Move() | Reorient():
            if mode not in MOVING or goal is Goal.NOTHING:
                raise _refusal(type(command).__name__.lower(), decision, "grasp first")
        case Grasp() | Release():
            if mode not in (Mode.READY, *MOVING):
                way_out = "recover first" if mode in STOPPED else "wait until it is ready"
                raise _refusal(type(command).__name__.lower(), decision, way_out)


def _refusal(command: str, decision: Decision, way_out: str) -> CommandError:
    return CommandError(f"{command} is refused in mode {decision.mode.value} ({decision.reason}): {way_out}")
