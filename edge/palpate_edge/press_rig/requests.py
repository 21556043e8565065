"""Requests of a run to the rig: one after the other, each is answered before the next."""

from __future__ import annotations

from dataclasses import dataclass

from palpate_edge.common.arrays import Array, Image
from palpate_edge.press_rig.journal import PressRecord


@dataclass(frozen=True, slots=True)
class Command:
    """Send a G-code line. Answer: the printer's replies, a list of lines."""

    line: str


@dataclass(frozen=True, slots=True)
class MoveTo:
    """Go straight to a printer position (3,) and stand still. Answer: None, after the motion."""

    to_mm: Array
    speed_mm_s: float


@dataclass(frozen=True, slots=True)
class Weigh:
    """Weigh once the scale has settled. Answer: a Weight."""

    count: int


@dataclass(frozen=True, slots=True)
class Watch:
    """Stop the run when the scale reads more than this. Answer: None."""

    limit_N: float


@dataclass(frozen=True, slots=True)
class TakePicture:
    """Take a picture that is exposed after the request. Answer: a Frame."""


@dataclass(frozen=True, slots=True)
class Keep:
    """Store an image at a path inside the dataset, then the record, if any. Answer: None."""

    path: str
    image: Image
    record: PressRecord | None = None


@dataclass(frozen=True, slots=True)
class Tell:
    """Print a line for the user. Answer: None."""

    line: str


Request = Command | MoveTo | Weigh | Watch | TakePicture | Keep | Tell


@dataclass(frozen=True, slots=True)
class Weight:
    """Mean of some readings of the scale, N, and its standard error."""

    mean_N: float
    sd_N: float
