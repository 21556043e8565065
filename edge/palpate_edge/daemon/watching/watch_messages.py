"""Messages between a fingertip's daemon and its console: one JSON object a packet of the watch socket.

The daemon sends `WatchedFingertip` first, then each second `WatchedHealth`, and, to a watcher that wants
pictures, `WatchedFrame`, whose picture is in a ring of frames (frame_ring.py). A watcher sends
`WatchRequest`; each has one `WatchAnswer`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import msgspec

from palpate_edge.common.contact import Contact
from palpate_edge.common.errors import PalpateError
from palpate_edge.daemon.health import SYSTEM_FOLDER, HealthReport, health_path
from palpate_edge.estimation.frame_estimator import BeadsInView

LONGEST_PACKET = 1 << 18
PLACE_DIGITS = 2

Place = tuple[float, float]
Level = Annotated[int, msgspec.Meta(ge=0, le=255)]
WatchCommand = Literal["pictures", "no_pictures", "record", "record_no_more", "tare", "identify", "light"]


class WatchRefusedError(PalpateError):
    """A fingertip cannot do what a watcher requests; the text states why and what to do."""


class BeadsShown(msgspec.Struct, frozen=True):
    """Beads of a picture, in its pixels: where they are and where they rest; lost: indices of those that
    were not found."""

    position_px: list[Place]
    rest_px: list[Place]
    lost: list[int]


class WatchedFingertip(msgspec.Struct, frozen=True, tag="fingertip"):
    """The fingertip of a daemon. outer_radius_mm: of the dome, None where it is not known; pictures: path of
    the ring of frames, which exists while somebody watches; method: ``none`` without a calibration."""

    name: str
    method: str
    outer_radius_mm: float | None
    has_light: bool
    has_tare: bool
    pictures: str


class WatchedFrame(msgspec.Struct, frozen=True, tag="frame"):
    """A frame, whose picture has contact.sequence. latency_ms: from the exposure to the estimate."""

    contact: Contact
    latency_ms: float
    beads: BeadsShown | None


class WatchedHealth(msgspec.Struct, frozen=True, tag="health"):
    """The report of the daemon's health, each second."""

    report: HealthReport


class WatchAnswer(msgspec.Struct, frozen=True, tag="answer"):
    """The answer to the request of this number; refused: the reason, or empty."""

    number: int
    text: str = ""
    refused: str = ""


class WatchRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A request. level: of the LEDs, for ``light``, 0 (off) to 255."""

    number: int
    command: WatchCommand
    level: Level = 0


WatchMessage = WatchedFingertip | WatchedFrame | WatchedHealth | WatchAnswer


def watch_paths(name: str, health: str) -> list[Path]:
    """Return the possible paths of a fingertip's watch socket: beside its health file, own folder first.

    health: as configured.
    """
    paths = [health_path(name, health)]
    if not health:
        paths.append(SYSTEM_FOLDER / f"palpate-{name}.json")
    return [path.with_name(f"{path.stem}.watch") for path in paths]


def beads_shown(beads: BeadsInView) -> BeadsShown:
    """Return the beads as they are sent, rounded to hundredths of a pixel."""
    return BeadsShown(
        position_px=beads.position_px.round(PLACE_DIGITS).tolist(),
        rest_px=beads.rest_px.round(PLACE_DIGITS).tolist(),
        lost=(~beads.found).nonzero()[0].tolist(),
    )
