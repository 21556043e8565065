"""Stiffness and damping of the pose law that are stable at the hand's tick.

The joints' damping B resists the object with the 6 x 6 matrix D = G (J_x B^-1 J_x^T)^-1 G^T. With a total
delay T such a hand is the loop K e^(-sT)/(D s), unstable from K T/D = pi/2 on. The stiffness along each axis
of D is therefore limited to K T/D = STABLE_SHARE with T = DELAY_TICKS ticks (gain margin 3.1, phase margin
61 degrees), and D_p and D_o are reduced with the square of the same share.

The 3 x 3 blocks of D for place and orientation are taken alone. Four equal fingers leave a margin of 1.6 for
both together; with a lifted finger the blocks are coupled more. For contacts with shares both stiffnesses
are therefore reduced until the largest eigenvalue of D^-1 K T leaves COUPLED_MARGIN.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_host.config.control_config import PoseLawConfig
from palpate_host.control.holding.virtual_object import Grip
from palpate_host.control.kinematics import HandPose

DELAY_TICKS = 2.0
"""From the sample of the joint angles to the middle of the tick in which the torque acts, and half a tick."""
STABLE_SHARE = 0.5
COUPLED_MARGIN = 2.0
INTEGRAL_SHARE = 0.3
"""Largest rate of the integral along an axis over that of its error, K/D."""


@dataclass(frozen=True, slots=True)
class Stiffness:
    """The gains in use, in the hand's frame.

    springs: (12, 6), by which error of place and rotation vector give the stiffnesses' force and torque, and
    then the rates of the integrals' force and torque. dampers: (6, 6), by which velocity and spin give the
    damping's. margin_p, margin_o: how many times larger the stiffnesses could be before the loop is unstable.
    """

    springs: Array
    dampers: Array
    margin_p: float
    margin_o: float

    @property
    def K_p_N_m(self) -> Array:
        """The stiffness (3, 3) of the place."""
        return self.springs[:3, :3]

    @property
    def K_o_Nm_rad(self) -> Array:
        """The stiffness (3, 3) of the orientation."""
        return self.springs[3:6, 3:]

    def towards(self, other: Stiffness, share: float) -> Stiffness:
        """Return these gains after this share, 0 to 1, of the way to others; the margins are the others'."""
        if share >= 1.0:
            return other
        rest = 1.0 - share
        return Stiffness(
            springs=rest * self.springs + share * other.springs,
            dampers=rest * self.dampers + share * other.dampers,
            margin_p=other.margin_p,
            margin_o=other.margin_o,
        )


def stable_stiffness(
    config: PoseLawConfig,
    pose: HandPose,
    grip: Grip,
    B_Nms_rad: Array,
    dt_s: float,
    place_m: Array | None = None,
) -> Stiffness:
    """Return the configured gains, limited along each axis of the joints' damping at this pose.

    place_m: (3,) the point of the object that the stiffness pulls; None: the contacts' centroid.
    """
    D = object_damping(pose, grip, B_Nms_rad)
    found = _stiffness(config, D, dt_s, 1.0)
    if grip.share is None:
        return found
    margin = coupled_margin(found, D, grip.centroid_m if place_m is None else place_m, grip, dt_s)
    return found if margin >= COUPLED_MARGIN else _stiffness(config, D, dt_s, margin / COUPLED_MARGIN)


def coupled_margin(found: Stiffness, D: Array, place_m: Array, grip: Grip, dt_s: float) -> float:
    """Return how many times larger both stiffnesses together could be before the loop is unstable.

    D (6, 6): of `object_damping`, about the contacts' centroid. place_m: (3,) where the stiffness pulls.
    """
    x, y, z = (place_m - grip.centroid_m).tolist()
    to_place = np.eye(6)
    to_place[3:, :3] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
    D_there = to_place @ D @ to_place.T
    rates = np.linalg.eigvals(np.linalg.pinv(D_there, rcond=1e-9) @ found.springs[:6])
    return 0.5 * math.pi / float(rates.real.max() * DELAY_TICKS * dt_s)


def _stiffness(config: PoseLawConfig, D: Array, dt_s: float, share: float) -> Stiffness:
    """Return the gains that D (6, 6) allows; share: of the stiffness."""
    most_per_s = config.integral_per_s
    place = _limited(
        D[:3, :3],
        config.position_stiffness_N_m,
        config.position_damping_Ns_m,
        most_per_s,
        dt_s,
        share,
    )
    turn = _limited(
        D[3:, 3:],
        config.orientation_stiffness_Nm_rad,
        config.orientation_damping_Nms_rad,
        most_per_s,
        dt_s,
        share,
    )
    springs, dampers = np.zeros((12, 6)), np.zeros((6, 6))
    springs[:3, :3], springs[3:6, 3:] = place.K, turn.K
    springs[6:9, :3], springs[9:, 3:] = place.integral, turn.integral
    dampers[:3, :3], dampers[3:, 3:] = place.D, turn.D
    return Stiffness(springs, dampers, margin_p=place.margin, margin_o=turn.margin)


class _Limited(NamedTuple):
    K: Array
    D: Array
    integral: Array
    margin: float


def _limited(
    resisting: Array, stiffness: float, damping: float, integral_per_s: float, dt_s: float, share: float
) -> _Limited:
    """Return stiffness and damping (3, 3), limited along each axis of the joints' damping `resisting` (3, 3).

    integral: K times the integral's rate, at most INTEGRAL_SHARE of the axis' own K/D. margin: pi/2 over the
    largest K T/D.
    """
    delay_s = DELAY_TICKS * dt_s
    per_axis, axes = np.linalg.eigh(resisting)
    K = share * np.minimum(stiffness, STABLE_SHARE * per_axis / delay_s)
    rates = K / per_axis
    return _Limited(
        K=(axes * K) @ axes.T,
        D=(axes * (damping * (K / stiffness) ** 2)) @ axes.T,
        integral=(axes * (K * np.minimum(integral_per_s, INTEGRAL_SHARE * rates))) @ axes.T,
        margin=0.5 * math.pi / float(rates.max() * delay_s),
    )


def contact_jacobian_m(pose: HandPose, grip: Grip) -> Array:
    """Return J_xi = J_i - [x_i - x_ci]x J_wi (n, 3, nq), the Jacobians of the tips' skin at the contacts."""
    turn = pose.tip_turn_jacobian
    assert turn is not None
    x, y, z = (grip.to_contact_m[:, axis, None] for axis in range(3))
    moved = pose.tip_jacobian_m.copy()
    moved[:, 0] += turn[:, 1] * z - turn[:, 2] * y
    moved[:, 1] += turn[:, 2] * x - turn[:, 0] * z
    moved[:, 2] += turn[:, 0] * y - turn[:, 1] * x
    return moved


def grasp_matrix(grip: Grip) -> Array:
    """Return G (6, 3 n): the force, and the torque about the contacts' centroid, of contact forces (3 n,)."""
    G = np.zeros((6, 3 * len(grip.arm_m)))
    for finger, (x, y, z) in enumerate(grip.arm_m.tolist()):
        at = slice(3 * finger, 3 * finger + 3)
        G[:3, at] = np.eye(3)
        G[3:, at] = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]
    return G


def object_damping(pose: HandPose, grip: Grip, B_Nms_rad: Array) -> Array:
    """Return D (6, 6): the wrench with which the joints' damping B resists velocity and spin of the object.

    A joint without damping counts as one of 1e-6 N m s/rad.
    """
    J, G = contact_jacobian_m(pose, grip), grasp_matrix(grip)
    if grip.share is not None:  # a lifted finger resists nothing
        held = np.flatnonzero(grip.share)
        J, G = J[held], G.reshape(6, -1, 3)[:, held].reshape(6, -1)
    J = J.reshape(-1, J.shape[2])
    per_B = J @ (J.T / np.maximum(B_Nms_rad, 1e-6)[:, None])
    return np.asarray(G @ np.linalg.pinv(per_B, rcond=1e-9, hermitian=True) @ G.T)
