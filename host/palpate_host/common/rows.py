"""Vectors as three plain floats: for so few, numpy's overhead exceeds the computation."""

from __future__ import annotations

import math

Row = tuple[float, float, float]

ZERO: Row = (0.0, 0.0, 0.0)


def plus(a: Row, b: Row, factor: float = 1.0) -> Row:
    """Return a + factor b."""
    (ax, ay, az), (bx, by, bz) = a, b
    return ax + factor * bx, ay + factor * by, az + factor * bz


def cross(a: Row, b: Row) -> Row:
    """Return a x b."""
    (ax, ay, az), (bx, by, bz) = a, b
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


def length(v: Row) -> float:
    """Return the length."""
    x, y, z = v
    return math.sqrt(x * x + y * y + z * z)


def bounded(v: Row, most: float) -> Row:
    """Return the vector, shortened to at most this length."""
    size = length(v)
    if size <= most:
        return v
    return plus(ZERO, v, most / size)
