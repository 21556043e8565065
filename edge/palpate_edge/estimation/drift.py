"""Drift: how far the untouched skin has moved in the image since the reference frames or the last tare.

The drift is followed while nothing touches (touch_classification.py decides) and stands still during a
contact, however long it lasts. Its common part (camera_motion.py) is followed quickly, at most as far as
drift can have moved since it was last observed. The dent beside it is followed slowly and only up to one
contact threshold: a contact that grows too slowly to be noticed loses no more than that.

A camera that zooms or turns moves the skin where it is, not where it was at rest: the common part changes
from place to place (`camera_slopes`), which matters where a press displaces beads by a spacing.
"""

from __future__ import annotations

import math

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_edge.estimation.camera_motion import SplitMotion, camera_modes, camera_slopes
from palpate_edge.estimation.skin_motion import DriftField
from palpate_edge.kernels.skin_motion import MOTIONS
from palpate_edge.vision.beads import Reference
from palpate_edge.vision.neighbourhood import rms

MAX_RATE_PX_S = 0.05  # 3 pixels in a minute
MAX_TOTAL_PX = 6.0  # about a quarter of the beads' spacing
FOLLOWING_S = 0.2  # time constant; the fastest drift is followed within half a contact threshold
DENT_FOLLOWING_S = 2.0
MAX_DENT_SHARE = 0.06  # of a common motion: parallax and swelling leave up to 0.053, a press 0.25 or more


class Drift:
    """The drift of one sensor.

    field: with which skin_motion.SkinMotion measures frames as they would be without the drift.
    """

    def __init__(self, reference: Reference, threshold_px: float) -> None:
        """threshold_px: skin motion above which something touches."""
        self._threshold_px = threshold_px
        self._rest_px = reference.position_px
        self._fit = np.linalg.pinv(camera_modes(reference.position_px).reshape(-1, MOTIONS))
        self._flat_slopes = camera_slopes(reference.position_px).reshape(-1, MOTIONS)
        self._without_slopes = np.tile(np.eye(2), (len(reference.position_px), 1, 1))
        self._common_px = np.zeros_like(reference.position_px)
        self._dent_px = np.zeros_like(reference.position_px)
        self._sum_up()
        self._unobserved_px = math.inf  # how far the drift can have moved since it was last followed

    @property
    def total_px(self) -> float:
        """Root mean square of the drift over the beads."""
        return rms(self._drift_px)

    def elapse(self, elapsed_s: float) -> None:
        """Allow for the drift of `elapsed_s` seconds that no frame showed."""
        self._unobserved_px += MAX_RATE_PX_S * elapsed_s

    def explains(self, common_px: Array) -> bool:
        """Return whether drift can have made a common motion (n, 2) since it was last followed."""
        return rms(common_px) <= min(self._unobserved_px, self._remaining_px())

    def follow_motion(self, split: SplitMotion, elapsed_s: float, *, at_once: bool) -> None:
        """Follow the motion of an untouched frame.

        elapsed_s: since the frame before; at_once: take up all of the common part, as far as drift goes.
        """
        size_px = max(rms(split.common_px), 1e-12)
        share = 1.0 if at_once else 1.0 - math.exp(-elapsed_s / FOLLOWING_S)
        share = min(share, self._unobserved_px / size_px, self._remaining_px() / size_px)
        self._common_px = self._common_px + share * split.common_px
        amounts = self._fit @ self._common_px.ravel()
        slopes = (self._flat_slopes @ amounts).reshape(2, -1, 2)
        self._without_slopes = np.eye(2) - slopes.transpose(1, 2, 0)
        self._unobserved_px = min(max(0.0, self._unobserved_px - share * size_px), (1.0 - share) * size_px)
        self._dent_px = self._dent_px + (1.0 - math.exp(-elapsed_s / DENT_FOLLOWING_S)) * split.dent_px
        limit_px = self._threshold_px + MAX_DENT_SHARE * rms(self._common_px)
        self._dent_px *= min(1.0, limit_px / max(rms(self._dent_px), 1e-12))
        self._sum_up()

    def _sum_up(self) -> None:
        self._drift_px = self._common_px + self._dent_px
        self.field = DriftField(self._rest_px + self._drift_px, self._without_slopes)

    def _remaining_px(self) -> float:
        """Return how much farther the common part may move."""
        return max(0.0, MAX_TOTAL_PX - rms(self._common_px))
