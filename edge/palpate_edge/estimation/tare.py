"""Tare: the mean of the next frames becomes the untouched sensor."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from palpate_edge.estimation.frame_record import FrameRejectedError
from palpate_edge.vision.beads import Beads, Reference

TARE_FRAMES = 10


class Tare:
    """Collects the frames of a tare; idle unless begun."""

    def __init__(self, reference: Reference, on_completed: Callable[[Reference], None]) -> None:
        """on_completed: receives the tared reference."""
        self._reference = reference
        self._on_completed = on_completed
        self._frames_left = 0
        self._accepts_contact = True
        self._restart_sums()

    def begin(self, *, accepts_contact: bool = True) -> None:
        """Take the next `TARE_FRAMES` plausible frames; a tare in progress starts again.

        accepts_contact: False cancels the tare when one of them shows a contact; the reference then stays.
        """
        self._accepts_contact = accepts_contact
        self._frames_left = TARE_FRAMES
        self._restart_sums()

    def collect(self, tracked: Beads, *, is_touched: bool) -> None:
        """Add a frame's beads, before drift compensation, while a tare is in progress.

        Raises FrameRejectedError then: these frames give no contact. A bead that none of them shows keeps its
        reference place.
        """
        if is_touched and not self._accepts_contact:
            self._frames_left = 0
        if not self._frames_left:
            return
        self._sum_px[tracked.found] += tracked.position_px[tracked.found]
        self._count += tracked.found
        self._frames_left -= 1
        if not self._frames_left:
            mean_px = self._sum_px / np.maximum(self._count, 1)[:, None]
            seen = self._count[:, None] > 0
            position_px = np.where(seen, mean_px, self._reference.position_px)
            self._reference = replace(self._reference, position_px=position_px)
            self._on_completed(self._reference)
        raise FrameRejectedError("tare in progress")

    def _restart_sums(self) -> None:
        self._sum_px = np.zeros_like(self._reference.position_px)
        self._count = np.zeros(len(self._reference.position_px))
