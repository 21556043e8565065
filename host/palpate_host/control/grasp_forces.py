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
tangential part of f_i + g h_i is at most mu times its normal part: a quadratic inequality in g. Where its
solution presses a contact harder than the limit, wrench and grip are scaled down alike.
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
_Products = tuple[float, float, float, float, float]


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
    """Return contact forces with this wrench and the smallest grip from least_N on that friction needs.

    friction: of each contact. most_N: largest normal force of a contact. Where friction needs more, the
    wrench is scaled down to what it holds; least_N gives way before that.
    """
    asked, inner = wrench_forces_N(grip, force_N, torque_Nm), internal_forces(grip)
    rows = _products(asked, inner, grip.normal)
    needed, fits, reserve = 0.0, math.inf, math.inf
    for mu, (an, hn, aa, ah, hh) in zip(friction, rows, strict=True):
        if aa == hh == an == hn == 0.0:  # a lifted finger
            continue
        used = math.sqrt(max(hh, 0.0)) / max(hn, _TINY)
        reserve = min(reserve, mu - used)
        mu2 = max(mu, used + LEAST_MARGIN) ** 2
        needs = _least_grip(mu2 * hn * hn - hh, mu2 * hn * an - ah, mu2 * an * an - aa, hn, an)
        needed = needs if needs > needed else needed
        fits = min(fits, (most_N - an) / max(hn, _TINY))
    g, share = min(max(least_N, needed), fits), 1.0
    if needed > fits:
        g, share = _scaled(rows, needed, most_N)
    normal_N = np.array([share * an + g * hn for an, hn, *_ in rows])
    return ContactForces(share * asked + g * inner, normal_N, g, share, reserve)


def _products(asked: Array, inner: Array, normal: Array) -> list[_Products]:
    """Return for each contact the normal parts an, hn, and the tangential parts' products aa, ah, hh.

    Plain floats: for rows of three numbers numpy's overhead exceeds the computation.
    """
    rows = []
    forces = zip(asked.tolist(), inner.tolist(), normal.tolist(), strict=True)
    for (ax, ay, az), (hx, hy, hz), (nx, ny, nz) in forces:
        an, hn = -(ax * nx + ay * ny + az * nz), -(hx * nx + hy * ny + hz * nz)
        aa = ax * ax + ay * ay + az * az - an * an
        ah = ax * hx + ay * hy + az * hz - an * hn
        hh = hx * hx + hy * hy + hz * hz - hn * hn
        rows.append((an, hn, aa, ah, hh))
    return rows


def _scaled(rows: Sequence[_Products], needed_N: float, most_N: float) -> tuple[float, float]:
    """Return the grip and the largest share of the wrench with at most most_N at every contact.

    Friction cones are cones: what holds with the grip needed_N holds scaled by any factor.
    """
    if needed_N == math.inf:
        return most_N / max(_TINY, *(hn for _, hn, *_ in rows)), 0.0
    share = most_N / max(an + needed_N * hn for an, hn, *_ in rows)
    return share * needed_N, share


def _least_grip(a: float, b: float, c: float, hn: float, an: float) -> float:
    """Return the g from which on a g^2 + 2 b g + c >= 0 and g hn + an >= 0; a > 0 and hn > 0, or infinite."""
    if a <= 0.0 or hn <= 0.0:
        return math.inf
    inside = b * b - a * c
    root = (math.sqrt(inside) - b) / a if inside > 0.0 else 0.0
    return max(root, -an / hn, 0.0)
