"""Largest sizes of a recording, with the defaults of every recorder. Needs no extra."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Bounds:
    """Largest sizes. piece_bytes: of one piece, log and MCAP together; folder_bytes: of all pieces."""

    piece_bytes: int = 100_000_000
    folder_bytes: int = 2_000_000_000
