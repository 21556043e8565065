"""Inputs of the host beside the bus frames of other nodes: what a tick of a recorded run depends on.

Frames of other nodes are in the bus log. The rest is here: how far the host had read them, when it was
called, and each command, end request, loss and return of the bus, with its place among the frames."""

from __future__ import annotations

from dataclasses import dataclass

import msgspec

from palpate_host.common.command import Accept, Grasp, Move, Recover, Release, Reorient, Rotate, Stop
from palpate_host.common.gait_plan import GaitPlan


class _Event(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="command"):
    pass


class End(_Event, frozen=True, tag="end"):
    """The host was asked to stop the hand and to end (SIGTERM, --duration)."""

    reason: str


class BusLost(_Event, frozen=True, tag="bus-lost"):
    """The bus was lost. at_us: epoch us."""

    at_us: int
    reason: str


class BusRestored(_Event, frozen=True, tag="bus-restored"):
    """The bus was taken into use again. at_us: epoch us."""

    at_us: int


class Planned(_Event, frozen=True, tag="planned"):
    """The planner has answered `Reorient`. plan: None where it refuses, for the reason in problem."""

    plan: GaitPlan | None
    problem: str = ""


HostEvent = (
    Grasp
    | Rotate
    | Move
    | Reorient
    | Release
    | Stop
    | Recover
    | Accept
    | End
    | BusLost
    | BusRestored
    | Planned
)


@dataclass(frozen=True, slots=True)
class HostInput:
    """An event before a tick. after: number of frames that the host took since its last tick before it."""

    after: int
    event: HostEvent


@dataclass(frozen=True, slots=True)
class TickInputs:
    """Inputs of one tick.

    called_us: time of the call, at or after the tick's own time. taken: frames with the host's identifiers
    since the last tick, its own SYNC among them, without NMT frames and SDO
    requests, of which some buses return its own. until_us: time stamp of the newest
    frame, 0 before the first. events: since the last tick. event_count: events since the start, with these.
    waits: whether the host waits for commands (run.start = "command").
    """

    called_us: int
    taken: int
    until_us: int
    events: tuple[HostInput, ...] = ()
    event_count: int = 0
    waits: bool = False
