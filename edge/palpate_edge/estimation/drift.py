"""Slow drift: where the untouched skin has gone in the image since the reference frames or the last tare.

Warming moves the camera against the dome, changes its focal length and swells the silicone; all of it moves
the image's beads nearly as one: a shift, a turn, a zoom and two tilts. No press does: at least a quarter of
its motion is a dent that those six cannot make. So a frame tells drift from touch by itself:

- the skin moved less than the contact threshold: nothing touches, and the drift is followed;
- it moved more, as one, and no farther than drift can have gone since it was last seen untouched: nothing
  touches either (a touch held the drift back and has ended). A far motion is taken up at once; as a faint
  touch on the apex moves the beads nearly as one too, a small one only after some frames in a row;
- it moved much more, as one: the camera was knocked. That is no contact, but no frame to believe either until
  the drift has caught up; only the first frames ever may be any way off, as the calibration may be old;
- anything else is a touch, and the drift stands still however long it lasts.

A touch that grows too slowly for the threshold loses at most its part that looks like drift: the dent that
remains beside it is followed up to one threshold and no farther.
"""

from __future__ import annotations

import math
from enum import Enum

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_edge.estimation.skin_motion import found_means, means, rms
from palpate_edge.vision.tracker import Beads, Reference, distances

MAX_RATE_PX_S = 0.05  # 3 pixels in a minute
MAX_TOTAL_PX = 6.0  # about a quarter of the beads' spacing
SETTLING_S = 0.2  # time constant; lags the fastest drift by half a contact threshold
DENT_SETTLING_S = 2.0
DENT_SPACINGS = 1.4  # of the neighbourhood that a dent is averaged over
MAX_DENT_NOISE = 0.5  # of a motion as one, in contact thresholds; frames of the sample stay below 0.41
MAX_DENT_SHARE = 0.06  # of a motion as one: parallax and swelling leave up to 0.053, a press 0.25 or more
STEADY_FRAMES = 5  # in a row that move as one before a small motion above the threshold is followed
PLAIN = 10.0  # contact thresholds: a dent that noise hides in a motion of this size is none of a press
MOTIONS = 6
KNOCKED = 4.0  # contact thresholds: no press of this size can be taken for a motion as one


class Skin(Enum):
    """What a frame says of the whole skin."""

    UNTOUCHED = "untouched"
    TOUCHED = "touched"
    KNOCKED = "knocked"


class Drift:
    """Follows one sensor's drift; time is each frame's exposure time."""

    def __init__(self, rest: Reference, threshold_px: float) -> None:
        """rest: the untouched beads; threshold_px: skin motion above which something touches."""
        self._rest_px = rest.position_px
        self._threshold_px = threshold_px
        near = distances(rest.position_px, rest.position_px) / rest.spacing_px[:, None]
        self._around = np.exp(-0.5 * (near / DENT_SPACINGS) ** 2)
        self._around_all = means(self._around).astype(np.float32)
        self._modes = camera_motions(rest.position_px)
        self._flat_modes = self._modes.reshape(-1, MOTIONS)  # a stack of small ones multiplies slowly
        self._fit = np.linalg.pinv(self._flat_modes)
        self._whole_px = np.zeros_like(rest.position_px)
        self._dent_px = np.zeros_like(rest.position_px)
        self._drift_px = self._whole_px + self._dent_px
        self._last_us: int | None = None
        self._unseen_px = math.inf  # how far the drift can have gone since it was last followed
        self._steady = 0
        self._catching_up = False

    @property
    def total_px(self) -> float:
        """Root mean square of the drift over the beads."""
        return rms(self._drift_px)

    def settled(self, beads: Beads) -> Beads:
        """The beads as they would be seen without the drift."""
        return Beads(beads.position_px - self._drift_px, beads.found, beads.lost, beads.searched)

    def judge(self, beads: Beads, motion_px: float, at_us: int) -> Skin:
        """Whether something touches, and the drift followed when nothing does.

        beads: settled; motion_px: their Motion.size_px; at_us: exposure time.
        """
        elapsed_s = 0.0 if self._last_us is None else max(0.0, 1e-6 * (at_us - self._last_us))
        self._last_us = at_us
        self._unseen_px += MAX_RATE_PX_S * elapsed_s
        moved = motion_px > self._threshold_px
        whole_px, dent_px = self._split(beads)
        skin = Skin.UNTOUCHED
        if moved:
            skin = self._moved_as_one(motion_px, whole_px, self._size(dent_px, beads))
        self._catching_up = skin is Skin.KNOCKED
        self._steady = 0 if skin is Skin.TOUCHED else self._steady + 1
        plain = motion_px > PLAIN * self._threshold_px
        if skin is not Skin.TOUCHED and (not moved or plain or self._steady > STEADY_FRAMES):
            self._follow(
                whole_px, dent_px, elapsed_s, 1.0 if plain else 1.0 - math.exp(-elapsed_s / SETTLING_S)
            )
        return skin

    def _moved_as_one(self, motion_px: float, whole_px: Array, dent_size_px: float) -> Skin:
        """What a motion above the threshold is."""
        if dent_size_px > MAX_DENT_NOISE * self._threshold_px + MAX_DENT_SHARE * motion_px:
            return Skin.TOUCHED
        if rms(whole_px) <= min(self._unseen_px, self._room_px()):
            return Skin.UNTOUCHED
        knocked = self._catching_up or motion_px > KNOCKED * self._threshold_px
        return Skin.KNOCKED if knocked else Skin.TOUCHED

    def _follow(self, whole_px: Array, dent_px: Array, elapsed_s: float, share: float) -> None:
        """elapsed_s: since the frame before, whatever that showed; share of the motion as one to take up."""
        size_px = max(rms(whole_px), 1e-12)
        share = min(share, self._unseen_px / size_px, self._room_px() / size_px)
        self._whole_px = self._whole_px + share * whole_px
        self._unseen_px = min(max(0.0, self._unseen_px - share * size_px), (1.0 - share) * size_px)
        self._dent_px = self._dent_px + (1.0 - math.exp(-elapsed_s / DENT_SETTLING_S)) * dent_px
        limit_px = self._threshold_px + MAX_DENT_SHARE * rms(self._whole_px)
        self._dent_px *= min(1.0, limit_px / max(rms(self._dent_px), 1e-12))
        self._drift_px = self._whole_px + self._dent_px

    def _room_px(self) -> float:
        return max(0.0, MAX_TOTAL_PX - rms(self._whole_px))

    def _split(self, beads: Beads) -> tuple[Array, Array]:
        """The beads' motion (n, 2) as one, and what is beside it: 0 for beads that were not found."""
        seen, moved = beads.found, beads.position_px - self._rest_px
        if not len(beads.lost):
            whole = (self._flat_modes @ (self._fit @ moved.ravel())).reshape(-1, 2)
            return whole, moved - whole
        modes = self._modes[seen].reshape(-1, MOTIONS)
        shares = np.linalg.solve(modes.T @ modes, modes.T @ moved[seen].ravel())
        whole = (self._flat_modes @ shares).reshape(-1, 2)
        return whole, np.where(seen[:, None], moved - whole, 0.0)

    def _size(self, dent_px: Array, beads: Beads) -> float:
        """Root mean square, over the found beads, of the dent averaged over each one's neighbourhood."""
        if not len(beads.lost):
            return rms(self._around_all @ dent_px.astype(np.float32))
        return rms(found_means(self._around, dent_px, beads.found)[beads.found])


def camera_motions(position_px: Array) -> Array:
    """(n, 2, 6): motion of beads at (n, 2) by a shift in x and in y, a turn, a zoom and two tilts."""
    centred = position_px - position_px.mean(axis=0)
    x, y = (centred / np.abs(centred).max()).T
    one, none = np.ones_like(x), np.zeros_like(x)
    motions = (one, none), (none, one), (-y, x), (x, y), (x * x, x * y), (x * y, y * y)
    return np.stack([np.stack(motion, axis=1) for motion in motions], axis=2)
