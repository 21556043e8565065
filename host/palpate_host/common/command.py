"""Commands of an operator: plain data, the same for the control socket, Python and tests."""

from __future__ import annotations

from typing import Annotated

import msgspec

from palpate_edge.common.errors import PalpateError

Angle = Annotated[float, msgspec.Meta(ge=-180, le=180)]
Length = Annotated[float, msgspec.Meta(ge=-1000, le=1000)]
FEWEST_CORNERS, MOST_CORNERS = 4, 64
RampSeconds = Annotated[float, msgspec.Meta(ge=0, le=600)]


class CommandError(PalpateError):
    """The hand's mode does not allow a command, or a command is invalid; the message has the next step."""

    exit_status = 8


class _Command(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="command", tag=str.lower):
    pass


class Grasp(_Command, frozen=True):
    """Close and hold; while turning: go on holding, turn no more."""


class Rotate(_Command, frozen=True):
    """Turn the held object about the hand's fixed axes x, y, z (rpy_deg), from where it was to be before.

    ramp_s: in what time; None: target.ramp_s of hand.toml.
    """

    rpy_deg: tuple[Angle, Angle, Angle]
    ramp_s: RampSeconds | None = None


class Move(_Command, frozen=True):
    """Move and turn the held object, from where it was to be before, along and about the hand's fixed axes.

    Only under control.law = "pose", within pose_law.reach_mm and reach_deg of the place where the hold began.
    ramp_s: as for `Rotate`.
    """

    xyz_mm: tuple[Length, Length, Length] = (0.0, 0.0, 0.0)
    rpy_deg: tuple[Angle, Angle, Angle] = (0.0, 0.0, 0.0)
    ramp_s: RampSeconds | None = None


class Reorient(_Command, frozen=True):
    """Turn the held object by any angle: fingers lift in turn and take hold again (docs/holding.md).

    Only under control.law = "pose", with four fingers and more. rpy_deg: as for `Rotate`. corners_mm: of the
    convex object, in the hand's frame, where it is now; it turns about the centre of its volume.
    """

    rpy_deg: tuple[Angle, Angle, Angle]
    corners_mm: Annotated[
        tuple[tuple[Length, Length, Length], ...],
        msgspec.Meta(min_length=FEWEST_CORNERS, max_length=MOST_CORNERS),
    ]


class Release(_Command, frozen=True):
    """Open for control.release_ms, then let the joints go."""


class Stop(_Command, frozen=True):
    """Quick stop, drives off. `Recover` leads on."""


class Recover(_Command, frozen=True):
    """Leave FAULT or STOP: reset the nodes, restart from INIT without movement."""


class Accept(_Command, frozen=True):
    """Use a fingertip whose calibration, software or serial number differs from what hand.toml names.

    The difference that is the reason of the mode CHECK now; another difference needs another `Accept`.
    """

    node_id: Annotated[int, msgspec.Meta(ge=1, le=127)]


Command = Grasp | Rotate | Move | Reorient | Release | Stop | Recover | Accept


class Accepted(msgspec.Struct, frozen=True):
    """The difference that `Accept` took: fingers[].`key` of the finger `finger` is now `value`.

    key: ``calibration``, ``software`` or ``serial``. instead_of: the value that was expected.
    """

    finger: str
    key: str
    value: str | int
    instead_of: str | int
