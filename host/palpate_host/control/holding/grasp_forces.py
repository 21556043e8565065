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
from palpate_host.common.rows import Row
from palpate_host.control.holding.virtual_object import Grip, times

LEAST_MARGIN = 0.1
"""Smallest friction ratio left to the wrench; far turned, internal forces alone may use up `friction`."""
_TINY = 1e-12
_Products = tuple[float, float, float, float, float]


class ContactForces(NamedTuple):
    """The tips' forces on the object (n rows), their normal parts (n), the grip, the share of the wrench.

    reserve: smallest friction of a contact less the ratio that internal forces alone use up there.
    """

    rows_N: Sequence[Row]
    normals_N: Sequence[float]
    grip_N: float
    share: float
    reserve: float

    @property
    def force_N(self) -> Array:
        """The tips' forces (n, 3)."""
        return np.array(self.rows_N)

    @property
    def normal_N(self) -> Array:
        """Their normal parts (n,)."""
        return np.array(self.normals_N)


def wrench_forces_N(grip: Grip, force_N: Array, torque_Nm: Array) -> Array:
    """Return the smallest contact forces (n, 3) with this force and torque about the contacts' centroid."""
    (fx, fy, fz), (tx, ty, tz) = force_N.tolist(), torque_Nm.tolist()
    return np.array(_wrench_forces(_Rows.of(grip), (fx, fy, fz), (tx, ty, tz)))


def internal_forces(grip: Grip) -> Array:
    """Return the internal forces (n, 3) nearest to the inward normals, with a mean normal part of 1.

    With shares, nearest to the normals times the shares, with a sum of normal parts equal to that of shares.
    """
    at = _Rows.of(grip)
    own = _own_forces(at)
    inward = -sum(hx * x + hy * y + hz * z for (hx, hy, hz), (x, y, z) in zip(own, at.normal, strict=True))
    per = _per_inward(at, inward)
    return np.array([(per * x, per * y, per * z) for x, y, z in own])


class _Rows(NamedTuple):
    """A grip as plain floats: for rows of three numbers numpy's overhead exceeds the computation."""

    arm_m: list[Row]
    normal: list[Row]
    per_spread: tuple[Row, Row, Row]
    total_weight: float
    share: list[float] | None

    @staticmethod
    def of(grip: Grip) -> _Rows:
        share = None if grip.share is None else grip.share.tolist()
        return _Rows(grip.arm_m.tolist(), grip.normal.tolist(), grip.per_spread, grip.total_weight, share)


def _wrench_forces(grip: _Rows, force_N: Row, torque_Nm: Row) -> list[Row]:
    per, (fx, fy, fz) = 1.0 / grip.total_weight, force_N
    fx, fy, fz = per * fx, per * fy, per * fz
    x, y, z = times(grip.per_spread, torque_Nm)
    rows = [(fx + y * az - z * ay, fy + z * ax - x * az, fz + x * ay - y * ax) for ax, ay, az in grip.arm_m]
    if grip.share is None:
        return rows
    return [(s * s * x, s * s * y, s * s * z) for s, (x, y, z) in zip(grip.share, rows, strict=True)]


def _own_forces(grip: _Rows) -> list[Row]:
    """Return internal forces along h, not scaled."""
    wanted: list[Row] = grip.normal
    if grip.share is not None:
        wanted = [(s * x, s * y, s * z) for s, (x, y, z) in zip(grip.share, grip.normal, strict=True)]
    fx = fy = fz = tx = ty = tz = 0.0
    for (ax, ay, az), (x, y, z) in zip(grip.arm_m, wanted, strict=True):
        fx, fy, fz = fx + x, fy + y, fz + z
        tx, ty, tz = tx + ay * z - az * y, ty + az * x - ax * z, tz + ax * y - ay * x
    least = _wrench_forces(grip, (fx, fy, fz), (tx, ty, tz))
    return [(hx - x, hy - y, hz - z) for (hx, hy, hz), (x, y, z) in zip(least, wanted, strict=True)]


def _per_inward(grip: _Rows, inward: float) -> float:
    """Return the factor that makes h of the own forces, whose normal parts have this sum."""
    shares = float(len(grip.normal)) if grip.share is None else sum(grip.share)
    return shares / max(inward, _TINY)


def forces_within_cones(
    grip: Grip, force_N: Row, torque_Nm: Row, friction: Sequence[float], least_N: float, most_N: float
) -> ContactForces:
    """Return contact forces with this wrench and the smallest grip from least_N on that friction needs.

    friction: of each contact. most_N: largest normal force of a contact. Where friction needs more, the
    wrench is scaled down to what it holds; least_N gives way before that.
    """
    at = _Rows.of(grip)
    asked, own = _wrench_forces(at, force_N, torque_Nm), _own_forces(at)
    rows = _products(at.normal, asked, own)
    needed, fits, reserve = 0.0, math.inf, math.inf
    for mu, (an, hn, aa, ah, hh) in zip(friction, rows, strict=True):
        if aa == hh == an == hn == 0.0:  # a lifted finger
            continue
        hn_at_least = hn if hn > _TINY else _TINY
        used = math.sqrt(hh) / hn_at_least if hh > 0.0 else 0.0
        left = mu - used
        reserve = left if left < reserve else reserve
        most_mu = mu if left > LEAST_MARGIN else used + LEAST_MARGIN
        mu2 = most_mu * most_mu
        needs = _least_grip(mu2 * hn * hn - hh, mu2 * hn * an - ah, mu2 * an * an - aa, hn, an)
        needed = needs if needs > needed else needed
        most = (most_N - an) / hn_at_least
        fits = most if most < fits else fits
    per = _per_inward(at, sum(row[1] for row in rows))  # h = per own, k = g per
    k, share = min(max(least_N * per, needed), fits), 1.0
    if needed > fits:
        k, share = _scaled(rows, needed, most_N)
    forces = [
        (share * ax + k * hx, share * ay + k * hy, share * az + k * hz)
        for (ax, ay, az), (hx, hy, hz) in zip(asked, own, strict=True)
    ]
    normals = [share * an + k * hn for an, hn, *_ in rows]
    return ContactForces(forces, normals, k / per, share, reserve)


def internal_ratio(grip: Grip, contact: int) -> float:
    """Return the friction ratio of one contact under internal forces alone, which no grip changes."""
    force, outward = internal_forces(grip)[contact], grip.normal[contact]
    inward = max(-float(force.dot(outward)), _TINY)
    return math.sqrt(max(float(force.dot(force)) - inward * inward, 0.0)) / inward


def _products(normal: list[Row], asked: list[Row], own: list[Row]) -> list[_Products]:
    """Return for each contact the normal parts an, hn, and the tangential parts' products aa, ah, hh.

    a: the wrench's force; h: the contact's force of `own`.
    """
    rows = []
    for (ax, ay, az), (hx, hy, hz), (nx, ny, nz) in zip(asked, own, normal, strict=True):
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
