"""Contact forces for a wrench on the object: the grasp matrix, and internal forces within friction cones.

With the arms a_i from the contacts' centroid, forces f_i on the object give the wrench (F, t) = G f (Murray,
Li, Sastry, A Mathematical Introduction to Robotic Manipulation, 1994, chapter 5):

    F = sum f_i,        t = sum a_i x f_i.

The smallest forces with a given wrench are G^+ (F, t). Since sum a_i = 0, G G^T is diag(n I, S) with
S = sum |a_i|^2 I - a_i a_i^T, which gives the closed form

    f_i = F/n + (S^-1 t) x a_i.

A contact's share s_i of the grip is 1 unless a finger lifts or takes hold again (gait/). With the weights
w_i = s_i^2 the smallest forces are those with the least sum |f_i|^2/w_i: with arms from the weighted centroid
and S weighted likewise, f_i = w_i (F/sum w + (S^-1 t) x a_i). A finger that lifts thus gives up its part of
the wrench before its normal force.

Internal forces have no wrench. Those nearest to the inward normals are h = (I - G^+ G)(-s d), scaled here to
a mean normal part of 1 for a share of 1 and multiplied by the grip g in N. Contact i holds while the
tangential part of f_i + g h_i is at most mu times its normal part: a quadratic inequality in g, and for a
given g in the share s of the wrench that the contacts get.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_host.control.virtual_object import Grip, moment

LEAST_MARGIN = 0.1
"""Smallest friction ratio left to the wrench; far turned, internal forces alone may use up `friction`."""
_TINY = 1e-12


class ContactForces(NamedTuple):
    """The tips' forces (n, 3) on the object, their normal parts (n,), the grip, the share of the wrench.

    reserve: smallest friction of a contact less the ratio that internal forces alone use up there.
    """

    force_N: Array
    normal_N: Array
    grip_N: float
    share: float
    reserve: float


def wrench_forces_N(grip: Grip, force_N: Array, torque_Nm: Array) -> Array:
    """Return the smallest contact forces (n, 3) with this force and torque about the contacts' centroid."""
    x, y, z = grip.per_spread.dot(torque_Nm).tolist()
    turning = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])  # a @ turning = (x, y, z) x a
    return grip.weighted(np.asarray(force_N / grip.total_weight + grip.arm_m.dot(turning)))


def internal_forces(grip: Grip) -> Array:
    """Return the internal forces (n, 3) nearest to the inward normals, with a mean normal part of 1.

    With shares, nearest to the normals times the shares, with a sum of normal parts equal to that of shares.
    """
    normal = grip.normal if grip.share is None else grip.normal * grip.share[:, None]
    shares = len(normal) if grip.share is None else float(np.add.reduce(grip.share))
    own = wrench_forces_N(grip, np.add.reduce(normal), moment(grip.arm_m, normal)) - normal
    return np.asarray(own * (-shares / min(float(np.vdot(own, grip.normal)), -_TINY)))


def forces_within_cones(
    grip: Grip, force_N: Array, torque_Nm: Array, friction: Sequence[float], least_N: float, most_N: float
) -> ContactForces:
    """Return contact forces with this wrench and the smallest grip in [least_N, most_N] that friction needs.

    friction: of each contact. At most_N the wrench is scaled down to what friction holds.
    """
    asked, inner, normal = wrench_forces_N(grip, force_N, torque_Nm), internal_forces(grip), grip.normal
    asked_n, inner_n = -np.vecdot(asked, normal), -np.vecdot(inner, normal)
    # For each contact the normal parts, and the tangential parts' products.
    rows = list(
        zip(
            asked_n.tolist(),
            inner_n.tolist(),
            (np.vecdot(asked, asked) - asked_n * asked_n).tolist(),
            (np.vecdot(asked, inner) - asked_n * inner_n).tolist(),
            (np.vecdot(inner, inner) - inner_n * inner_n).tolist(),
            strict=True,
        )
    )
    g, slopes, reserve = least_N, [], math.inf
    for mu, (an, hn, aa, ah, hh) in zip(friction, rows, strict=True):
        if aa == hh == an == hn == 0.0:  # a lifted finger
            slopes.append(mu * mu)
            continue
        used = math.sqrt(max(hh, 0.0)) / max(hn, _TINY)
        reserve = min(reserve, mu - used)
        mu2 = max(mu, used + LEAST_MARGIN) ** 2
        slopes.append(mu2)
        needed = _least_grip(mu2 * hn * hn - hh, mu2 * hn * an - ah, mu2 * an * an - aa, hn, an)
        g = needed if needed > g else g
    share = 1.0
    if g > most_N:
        g = most_N
        for mu2, (an, hn, aa, ah, hh) in zip(slopes, rows, strict=True):
            fits = _largest_share(
                mu2 * an * an - aa, g * (mu2 * hn * an - ah), g * g * (mu2 * hn * hn - hh), an, g * hn
            )
            share = fits if fits < share else share
    return ContactForces(share * asked + g * inner, share * asked_n + g * inner_n, g, share, reserve)


def _least_grip(a: float, b: float, c: float, hn: float, an: float) -> float:
    """Return the g from which on a g^2 + 2 b g + c >= 0 and g hn + an >= 0; a > 0 and hn > 0, or infinite."""
    if a <= 0.0 or hn <= 0.0:
        return math.inf
    inside = b * b - a * c
    root = (math.sqrt(inside) - b) / a if inside > 0.0 else 0.0
    return max(root, -an / hn, 0.0)


def _largest_share(a: float, b: float, c: float, an: float, hn: float) -> float:
    """Return the s in [0, 1] up to which a s^2 + 2 b s + c >= 0 and s an + hn >= 0; both hold at 0."""
    most = min(1.0, -hn / an) if an < 0.0 else 1.0
    inside = b * b - a * c
    if c < 0.0 or inside < 0.0:
        return 0.0 if c < 0.0 else most
    root = math.sqrt(inside)
    # The roots are c / (-b +- root), which needs no division by a.
    for divisor in (root - b, -root - b):
        if divisor > 0.0:
            most = min(most, c / divisor)
    return max(most, 0.0)
