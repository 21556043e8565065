"""The target pose of a held object, and the workspace about the pose in which the hold began."""

from __future__ import annotations

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_host.common import rotation
from palpate_host.common.command import CommandError
from palpate_host.config.control_config import PoseLawConfig


class PoseTarget:
    """Place (3,), m, and orientation (3, 3) where the object is to be.

    origin_m, origin_R: the middle of the workspace.
    """

    def __init__(self, place_m: Array, R: Array) -> None:
        """Take the pose of an object whose hold begins."""
        self.place_m = self.origin_m = place_m
        self.R = self.origin_R = R
        self._from_m, self._shift_m, self._shifted = place_m, np.zeros(3), 0.0

    def stay(self, place_m: Array, R: Array) -> None:
        """Take this pose as the target."""
        self.place_m, self.R = place_m, R
        self.shift(np.zeros(3))

    def follow_point(self, way_m: Array, place_m: Array) -> None:
        """Take place_m (3,) of another point of the object, which lies way_m (3,) from the former one."""
        self.origin_m = self.origin_m + way_m
        self.stay(place_m, self.R)

    def turn(self, R: Array) -> None:
        """Set the orientation; the workspace is about it from now on."""
        self.R = self.origin_R = R

    def shift(self, shift_m: Array) -> None:
        """Start to move the target by (3,) from where it is now; `follow_shift` leads it there."""
        self._from_m, self._shift_m, self._shifted = self.place_m, shift_m, 0.0

    def follow_shift(self, share: float) -> None:
        """Set the target after this share of the shift."""
        if share != self._shifted:
            self._shifted = share
            self.place_m = self._from_m + share * self._shift_m

    def check_reach(self, shift_m: Array, turn: Array, config: PoseLawConfig) -> None:
        """Raise CommandError when the target, moved by (3,) and turned by (3, 3), is beyond the workspace."""
        far_mm = 1e3 * float(np.linalg.norm(self.place_m + shift_m - self.origin_m))
        far_deg = rotation.angle_deg(turn @ self.R @ self.origin_R.T)
        if far_mm > config.reach_mm:
            raise CommandError(
                f"move is refused: {far_mm:.1f} mm from where the hold began, pose_law.reach_mm is"
                f" {config.reach_mm:g}: move less, or grasp again"
            )
        if far_deg > config.reach_deg:
            raise CommandError(
                f"move is refused: {far_deg:.1f} deg from where the hold began, pose_law.reach_deg is"
                f" {config.reach_deg:g}: turn less, or grasp again"
            )
