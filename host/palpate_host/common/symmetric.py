"""Closed forms for symmetric 3 x 3 matrices [[a, b, c], [b, d, e], [c, e, f]].

numpy's general ones take four times as long and more.
"""

from __future__ import annotations

import math

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_host.common.rows import Row


def inverse(a: float, b: float, c: float, d: float, e: float, f: float) -> Array:
    """Return the inverse (3, 3) by cofactors. Raises ZeroDivisionError when the determinant is 0."""
    return np.array(inverse_rows(a, b, c, d, e, f))


def inverse_rows(a: float, b: float, c: float, d: float, e: float, f: float) -> tuple[Row, Row, Row]:
    """Return the rows of `inverse` in plain floats."""
    aa, ab, ac = d * f - e * e, c * e - b * f, b * e - c * d
    bb, bc, cc = a * f - c * c, b * c - a * e, a * d - b * b
    per = 1.0 / (a * aa + b * ab + c * ac)
    ab, ac, bc = per * ab, per * ac, per * bc
    return (per * aa, ab, ac), (ab, per * bb, bc), (ac, bc, per * cc)


def determinant(a: float, b: float, c: float, d: float, e: float, f: float) -> float:
    """Return the determinant."""
    return a * (d * f - e * e) + b * (c * e - b * f) + c * (b * e - c * d)


def largest_eigenvalue(a: float, b: float, c: float, d: float, e: float, f: float) -> float:
    """Return the largest eigenvalue (Smith, Communications of the ACM 4, 1961, 168)."""
    mean = (a + d + f) / 3.0
    a, d, f = a - mean, d - mean, f - mean
    p = math.sqrt((a * a + d * d + f * f + 2.0 * (b * b + c * c + e * e)) / 6.0)
    if p == 0.0:
        return mean
    cosine = 0.5 * determinant(a, b, c, d, e, f) / (p * p * p)
    return mean + 2.0 * p * math.cos(math.acos(min(1.0, max(-1.0, cosine))) / 3.0)
