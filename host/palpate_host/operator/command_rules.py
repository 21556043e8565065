"""Which command the hand obeys in which mode. Pure; what obeying means is the master's."""

from __future__ import annotations

from palpate_host.common.command import Command, CommandError, Grasp, Recover, Release, Rotate, Stop
from palpate_host.common.mode import MOVING, STOPPED, Mode
from palpate_host.safety.supervisor import Decision, Wish


def check_allowed(
    command: Command, decision: Decision, wish: Wish, *, leaves: bool, bus_is_away: bool, is_off: bool
) -> None:
    """CommandError, saying what to do first, when the mode does not allow the command.

    leaves: the host has been told to end. is_off: after a stop, no drive has power any more.
    """
    mode = decision.mode
    match command:
        case Stop():
            pass
        case Recover():
            if mode not in STOPPED or leaves:
                raise _refusal("recover", decision, "there is nothing to recover from")
            if bus_is_away:
                raise _refusal("recover", decision, "the bus is away, it is opened again by itself")
            if not is_off:
                raise _refusal("recover", decision, "the drives are still stopping, try again")
        case Rotate():
            if mode not in MOVING or wish is Wish.NOTHING:
                raise _refusal("rotate", decision, "grasp first")
        case Grasp() | Release():
            if mode not in (Mode.READY, *MOVING):
                way_out = "recover first" if mode in STOPPED else "wait until it is ready"
                raise _refusal(type(command).__name__.lower(), decision, way_out)


def _refusal(what: str, decision: Decision, way_out: str) -> CommandError:
    return CommandError(f"{what} is refused in mode {decision.mode.value} ({decision.reason}): {way_out}")
