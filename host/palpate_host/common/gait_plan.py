"""The plan of a large turn by finger gaiting, and why one is refused; plain data, an input of the host."""

from __future__ import annotations

import enum

import msgspec

from palpate_host.common.command import CommandError

Vector = tuple[float, float, float]


class GaitRefusal(enum.Enum):
    """Why a turn cannot be planned."""

    FINGERS = "too few fingers"
    REACH = "no place in reach"
    FRICTION = "too little friction"
    TIPS = "tips would touch"


class GaitRefusedError(CommandError):
    """A turn by gaiting cannot be planned; `reason` is for programs."""

    def __init__(self, reason: GaitRefusal, message: str) -> None:
        super().__init__(message)
        self.reason = reason


def fingers_refused(fingers: int) -> GaitRefusedError:
    """Return the refusal of a hand with too few fingers."""
    return GaitRefusedError(
        GaitRefusal.FINGERS,
        f"the turn is refused: a hand of {fingers} fingers holds with too few while one lifts; turn"
        " within the fingers' reach, or use a hand of four",
    )


class TurnTo(msgspec.Struct, frozen=True, tag="turn"):
    """Turn the object to an angle, with shares (n,) of the contacts. friction: what the grip alone needs."""

    angle_rad: float
    share: tuple[float, ...]
    friction: float


class Regrasp(msgspec.Struct, frozen=True, tag="regrasp"):
    """Let one finger take hold again.

    finger: from 0. normal, point_m: (3,) of the new contact in the object's frame, from its place.
    clearance_m: by which the tip lifts. share: (n,) while the finger is lifted; share_after: (n,) with it.
    friction: what the others' grip needs.
    """

    finger: int
    normal: Vector
    point_m: Vector
    clearance_m: float
    share: tuple[float, ...]
    share_after: tuple[float, ...]
    friction: float


class GaitPlan(msgspec.Struct, frozen=True):
    """A turn of `angle_rad` about `axis` (3,), in steps.

    normals: (n, 3) of the faces that the tips touch at first, in the object's frame.
    """

    axis: Vector
    angle_rad: float
    normals: tuple[Vector, ...]
    steps: tuple[TurnTo | Regrasp, ...]

    @property
    def regrasps(self) -> int:
        """The number of times that a finger takes hold again."""
        return sum(isinstance(step, Regrasp) for step in self.steps)

    @property
    def friction(self) -> float:
        """The largest friction ratio that internal forces alone need."""
        return max(step.friction for step in self.steps)
