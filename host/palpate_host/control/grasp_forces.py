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
from palpate_host.control.virtual_object import Grip

LEAST_MARGIN = 0.1
"""Smallest friction ratio left to the wrench; far turned, internal forces alone may use up `friction`."""
_TINY = 1e-12
_Row = tuple[float, float, float]
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
    return np.array(_wrench_forces(_Rows.of(grip), force_N.tolist(), torque_Nm.tolist()))


def internal_forces(grip: Grip) -> Array:
    """Return the internal forces (n, 3) nearest to the inward normals, with a mean normal part of 1.

    With shares, nearest to the normals times the shares, with a sum of normal parts equal to that of shares.
    """
    return np.array(_internal_forces(_Rows.of(grip)))


class _Rows(NamedTuple):
    """A grip as plain floats: for rows of three numbers numpy's overhead exceeds the computation."""

    arm_m: list[_Row]
    normal: list[_Row]
    per_spread: list[_Row]
    total_weight: float
    share: list[float] | None

    @staticmethod
    def of(grip: Grip) -> _Rows:
        share = None if grip.share is None else grip.share.tolist()
        arm_m, normal, per_spread = grip.arm_m.tolist(), grip.normal.tolist(), grip.per_spread.tolist()
        return _Rows(arm_m, normal, per_spread, grip.total_weight, share)


def _wrench_forces(grip: _Rows, force_N: Sequence[float], torque_Nm: Sequence[float]) -> list[_Row]:
    per, (fx, fy, fz), (tx, ty, tz) = 1.0 / grip.total_weight, force_N, torque_Nm
    fx, fy, fz = per * fx, per * fy, per * fz
    x, y, z = [sx * tx + sy * ty + sz * tz for sx, sy, sz in grip.per_spread]
    rows = [(fx + y * az - z * ay, fy + z * ax - x * az, fz + x * ay - y * ax) for ax, ay, az in grip.arm_m]
    if grip.share is None:
        return rows
    return [(s * s * x, s * s * y, s * s * z) for s, (x, y, z) in zip(grip.share, rows, strict=True)]


def _internal_forces(grip: _Rows) -> list[_Row]:
    normal, shares = grip.normal, float(len(grip.normal))
    wanted: list[_Row] = normal
    if grip.share is not None:
        wanted = [(s * x, s * y, s * z) for s, (x, y, z) in zip(grip.share, normal, strict=True)]
        shares = sum(grip.share)
    fx = fy = fz = tx = ty = tz = 0.0
    for (ax, ay, az), (x, y, z) in zip(grip.arm_m, wanted, strict=True):
        fx, fy, fz = fx + x, fy + y, fz + z
        tx, ty, tz = tx + ay * z - az * y, ty + az * x - ax * z, tz + ax * y - ay * x
    least = _wrench_forces(grip, (fx, fy, fz), (tx, ty, tz))
    own = [(hx - x, hy - y, hz - z) for (hx, hy, hz), (x, y, z) in zip(least, wanted, strict=True)]
    outward = 0.0
    for (hx, hy, hz), (x, y, z) in zip(own, normal, strict=True):
        outward += hx * x + hy * y + hz * z
    per = -shares / min(outward, -_TINY)
    return [(per * x, per * y, per * z) for x, y, z in own]


def forces_within_cones(
    grip: Grip, force_N: Array, torque_Nm: Array, friction: Sequence[float], least_N: float, most_N: float
) -> ContactForces:
    """Return contact forces with this wrench and the smallest grip from least_N on that friction needs.

    friction: of each contact. most_N: largest normal force of a contact. Where friction needs more, the
    wrench is scaled down to what it holds; least_N gives way before that.
    """
    at = _Rows.of(grip)
    asked, inner = _wrench_forces(at, force_N.tolist(), torque_Nm.tolist()), _internal_forces(at)
    rows = _products(asked, inner, at.normal)
    needed, fits, reserve = 0.0, math.inf, math.inf
    for mu, (an, hn, aa, ah, hh) in zip(friction, rows, strict=True):
        if aa == hh == an == hn == 0.0:  # a lifted finger
            continue
        hn_at_least = hn if hn > _TINY else _TINY
        used = math.sqrt(hh) / hn_at_least if hh > 0.0 else 0.0
        left = mu - used
        reserve = left if left < reserve else reserve
        mu2 = max(mu, used + LEAST_MARGIN) ** 2
        needs = _least_grip(mu2 * hn * hn - hh, mu2 * hn * an - ah, mu2 * an * an - aa, hn, an)
        needed = needs if needs > needed else needed
        most = (most_N - an) / hn_at_least
        fits = most if most < fits else fits
    g, share = min(max(least_N, needed), fits), 1.0
    if needed > fits:
        g, share = _scaled(rows, needed, most_N)
    forces = [
        (share * ax + g * hx, share * ay + g * hy, share * az + g * hz)
        for (ax, ay, az), (hx, hy, hz) in zip(asked, inner, strict=True)
    ]
    normal_N = np.array([share * an + g * hn for an, hn, *_ in rows])
    return ContactForces(np.array(forces), normal_N, g, share, reserve)


def internal_ratio(grip: Grip, contact: int) -> float:
    """Return the friction ratio of one contact under internal forces alone, which no grip changes."""
    force, outward = internal_forces(grip)[contact], grip.normal[contact]
    inward = max(-float(force.dot(outward)), _TINY)
    return math.sqrt(max(float(force.dot(force)) - inward * inward, 0.0)) / inward


def _products(asked: list[_Row], inner: list[_Row], normal: list[_Row]) -> list[_Products]:
    """Return for each contact the normal parts an, hn, and the tangential parts' products aa, ah, hh."""
    rows = []
    forces = zip(asked, inner, normal, strict=True)
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
