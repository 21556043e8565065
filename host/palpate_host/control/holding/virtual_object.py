"""The pose of the virtual object from joint angles, rolling tips and contact normals.

Contact i is at x_i = x_ci - r_i d_i with the face's outward normal d_i = R n_i, where n_i is fixed in the
object. A tip rolls without slip, Eq. (6): its skin at x_i and the object's face have the same velocity,

    dx_ci + w_i x (x_i - x_ci) = dx_o + w_o x (x_i - x_o),

three equations a contact for the six unknowns dx_o, w_o, solved in every tick by least squares over the
contacts. This follows the object without delay, at any rate, with the tips' rolling taken into account.

The integral of w_o drifts where tips slip or joint angles are wrong. Each measured normal d_i, Eq. (16),
therefore turns R towards it. As Eq. (15) does, it is compared with the estimate at its own exposure, which is
kept for the last half second; the same small rotation is applied to all later estimates. The error of a
contact depends on its place on the dome, so that no average removes it, while rolling tips are known well: a
normal therefore corrects by the angle alone that is beyond the 95 % radius of both, its own and that of the
normal which it is compared with, where the fingertip gives them. The two errors are of different places and
thus independent: the radius is the root of the sum of their squares. One contact in twenty is beyond its
radius, and stays there. Where an object has turned, other fingers see it, too, but for the part about their
own normals: a normal corrects only if another one shows at least `CONFIRMED` of the same turn.
Contacts on flat faces give no position along the faces: there the estimate of x_o is the integral alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_host.common import rotation, symmetric
from palpate_host.common.rows import ZERO, Row, cross
from palpate_host.control.kinematics import HandPose

KEPT = 128
"""Number of earlier estimates kept for late contacts."""
KEEP_EVERY_S = 0.004
CONFIRMED = 0.5
"""Share of a turn that another finger must show: 1 without errors, 0 on the average where it is none."""
LEAST_SEEN = 0.2
"""Share of a turn's square that a finger must be able to see: the part that is not about its own normal."""


class Grip(NamedTuple):
    """The contacts at one time.

    arm_m: (n, 3) from their centroid to each contact. centroid_m: (3,). normal: (n, 3) outward unit normals
    of the object. to_contact_m: (n, 3) from each tip's centre to its contact. per_spread: rows of the inverse
    of S, the sum of |a|^2 I - a a^T over the arms a. spread_m2: the sum of |a|^2. total_weight: the sum of
    the squared shares, the number of contacts when all are 1. share: (n,) of each contact in the grip, 0 for
    a lifted finger; None: all are 1. Centroid and S are weighted by its square; mean_weight: (n,) these
    weights over their sum; weighted_arm_m: (n, 3) the arms times the weights.
    """

    arm_m: Array
    centroid_m: Array
    normal: Array
    to_contact_m: Array
    per_spread: tuple[Row, Row, Row]
    spread_m2: float
    total_weight: float
    mean_weight: Array
    weighted_arm_m: Array
    share: Array | None = None


class VirtualObject:
    """The estimate: `place_m` (3,) and `R` (3, 3), and `twist` (6,) of the last tick: velocity and spin.

    residual_deg: angle of the last normal from the expected one. doubted: number of normals left out.
    """

    def __init__(
        self,
        pose: HandPose,
        normal: Array,
        R: Array,
        radius_m: Array,
        doubt_deg: float,
        normal95_rad: Sequence[float] = (),
    ) -> None:
        """Start at the contacts' centroid, which moves with the object from then on.

        normal: (n, 3) outward unit normals d_i at the contacts, in the hand's frame. R: the object's
        orientation. radius_m: (n,) distance of each tip's centre from its contact. doubt_deg: a normal
        further than this from the expected one is left out. normal95_rad: the normals' 95 % radii; empty:
        not known.
        """
        self.R = R
        self._normal_in_object = normal @ R
        self._reference95_rad = list(normal95_rad) or [0.0] * len(normal)
        self._turn_rad = [ZERO] * len(normal)
        self._radius_m = radius_m[:, None]
        self._centre_m, self._tip_rotation = pose.tip_centre_m, pose.tip_rotation
        self.grip = grip_of(pose.tip_centre_m, normal, self._radius_m)
        self.place_m = self.grip.centroid_m
        self.twist = np.zeros(6)
        self.residual_deg, self.doubted = 0.0, 0
        self._doubt_rad = math.radians(doubt_deg)
        self._share = self._shared = None  # type: Array | None
        self._kept_q = np.tile(pose.q_rad, (KEPT, 1))
        self._kept_R = np.tile(R, (KEPT, 1, 1))
        self._next, self._since_kept_s = 0, 0.0

    def advance(self, pose: HandPose, dt_s: float) -> Grip:
        """Move the object with the tips' motion since the last tick, and return its contacts."""
        before = self.grip
        in_tip_m = np.vecmat(before.to_contact_m, self._tip_rotation)
        # Where the skin was has no moment: sum w a = 0.
        skin_m = pose.tip_centre_m + np.matvec(pose.tip_rotation, in_tip_m)
        # Plain floats from here on: for three numbers numpy's overhead exceeds the computation.
        (_, xy, xz), (yx, _, yz), (zx, zy, _) = before.weighted_arm_m.T.dot(skin_m).tolist()
        wx, wy, wz = times(before.per_spread, (yz - zy, zx - xz, xy - yx))
        mx, my, mz = before.mean_weight.dot(skin_m).tolist()
        cx, cy, cz = before.centroid_m.tolist()
        x, y, z = self.place_m.tolist()
        dx = mx - cx + wy * (z - cz) - wz * (y - cy)
        dy = my - cy + wz * (x - cx) - wx * (z - cz)
        dz = mz - cz + wx * (y - cy) - wy * (x - cx)
        self._centre_m, self._tip_rotation = pose.tip_centre_m, pose.tip_rotation
        self.place_m = np.array((x + dx, y + dy, z + dz))
        self.R = rotation.about(wx, wy, wz).dot(self.R)
        self.twist = np.array((dx, dy, dz, wx, wy, wz)) / dt_s
        self._keep(pose, dt_s)
        self.grip = grip_of(
            pose.tip_centre_m, self._normal_in_object.dot(self.R.T), self._radius_m, self._share
        )
        return self.grip

    def correct(
        self, finger: int, normal: Array, exposure_pose: HandPose, share: float, radius95_rad: float = 0.0
    ) -> bool:
        """Turn the estimates by `share` of the angle to a measured outward normal (3,) at its exposure.

        radius95_rad: the normal's 95 % radius, 0 where it is not known; only the angle counts that is beyond
        it and the reference's, and that another finger confirms. Return False for a normal in doubt; it
        changes nothing.
        """
        then = int(np.argmin(((self._kept_q - exposure_pose.q_rad) ** 2).sum(axis=1)))
        expected = self._kept_R[then].dot(self._normal_in_object[finger])
        turn = rotation.cross(expected, normal)
        angle = math.atan2(rotation.norm(turn), float(expected.dot(normal)))
        self.residual_deg = math.degrees(angle)
        if angle > self._doubt_rad:
            self.doubted += 1
            return False
        beyond_rad = angle - math.hypot(radius95_rad, self._reference95_rad[finger])
        self._turn_rad[finger] = turn.tolist()
        if beyond_rad <= 0.0 or (radius95_rad > 0.0 and not self._is_confirmed(finger)):
            return True
        small = rotation.exp(share * beyond_rad / angle * turn)
        self.R = small.dot(self.R)
        self._kept_R = np.matmul(small, self._kept_R)
        return True

    def _is_confirmed(self, finger: int) -> bool:
        """Return whether another finger's last normal shows the turn that this one's does."""
        x, y, z = self._turn_rad[finger]
        squared = x * x + y * y + z * z
        shown = zip(self._turn_rad, self.grip.normal.tolist(), strict=True)
        for other, ((ox, oy, oz), (nx, ny, nz)) in enumerate(shown):
            visible = squared - (x * nx + y * ny + z * nz) ** 2
            if other == finger or visible < LEAST_SEEN * squared:
                continue
            if x * ox + y * oy + z * oz >= CONFIRMED * visible:
                return True
        return False

    def touch_elsewhere(self, finger: int, normal: Array, radius95_rad: float = 0.0) -> None:
        """Take a new reference for a finger that touches another face; its normal (3,) is outward."""
        self._normal_in_object[finger] = normal @ self.R
        self._reference95_rad[finger] = radius95_rad

    def take_face(self, finger: int, normal_in_object: Array) -> None:
        """Take the outward normal (3,) of the face that a finger is going to touch, in the object's frame."""
        self._normal_in_object[finger] = normal_in_object
        self._reference95_rad[finger] = 0.0

    def set_share(self, share: Array) -> None:
        """Set the share (n,) of each contact in the grip and in the estimate; 0 for a lifted finger."""
        if share is self._shared:
            return
        self._shared = share
        self._share = None if np.all(share == 1.0) else share
        self.grip = grip_of(self._centre_m, self.grip.normal, self._radius_m, self._share)

    @property
    def radius_m(self) -> Array:
        """The distances (n,) of the tips' centres from their contacts."""
        return self._radius_m[:, 0]

    def set_radius(self, radius_m: Array) -> None:
        """Set the distances (n,) of the tips' centres from their contacts under the present load."""
        self._radius_m = radius_m[:, None]

    def _keep(self, pose: HandPose, dt_s: float) -> None:
        self._since_kept_s += dt_s
        if self._since_kept_s < KEEP_EVERY_S:
            return
        self._since_kept_s = 0.0
        self._kept_q[self._next], self._kept_R[self._next] = pose.q_rad, self.R
        self._next = (self._next + 1) % KEPT


def grip_of(tip_centre_m: Array, normal: Array, radius_m: Array, share: Array | None = None) -> Grip:
    """Return the contacts of tips (n, 3) with outward normals (n, 3), radii (n, 1) and shares (n,)."""
    to_contact_m = -radius_m * normal
    contact_m = tip_centre_m + to_contact_m
    if share is None:
        total_weight, mean_weight = float(len(contact_m)), _equal_weights(len(contact_m))
    else:
        squared = share * share
        total_weight = float(share.dot(share))
        mean_weight = squared / total_weight
    centroid_m = mean_weight.dot(contact_m)
    arm_m = contact_m - centroid_m
    weighted_arm_m = arm_m if share is None else arm_m * squared[:, None]
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = arm_m.T.dot(weighted_arm_m).tolist()
    per_spread = symmetric.inverse_rows(yy + zz, -xy, -xz, xx + zz, -yz, xx + yy)
    return Grip(
        arm_m,
        centroid_m,
        normal,
        to_contact_m,
        per_spread,
        xx + yy + zz,
        total_weight,
        mean_weight,
        weighted_arm_m,
        share,
    )


@cache
def _equal_weights(contacts: int) -> Array:
    return np.full(contacts, 1.0 / contacts)


def times(matrix: Sequence[Row], v: Row) -> Row:
    """Return a matrix (3, 3) times a vector (3,), in plain floats."""
    x, y, z = v
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = matrix
    return xx * x + xy * y + xz * z, yx * x + yy * y + yz * z, zx * x + zy * y + zz * z


def moment_rows(arm_m: Sequence[Row], force: Sequence[Row]) -> list[Row]:
    """Return a_i x f_i of n rows."""
    return [cross(arm, pull) for arm, pull in zip(arm_m, force, strict=True)]
