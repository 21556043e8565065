"""Shares of the contacts with which their internal forces need the least friction (grasp_forces.py)."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_host.control.holding.grasp_forces import internal_forces
from palpate_host.control.holding.virtual_object import grip_of

SHARES = (1.0, 0.7, 0.45, 0.25, 0.12)
"""Shares of a finger that holds the object."""
WORTHWHILE = 0.01
"""Friction that less equal shares must save."""


def needed_friction(contact_m: Array, normal: Array, share: Array) -> float:
    """Return the largest ratio of tangential to normal internal force.

    contact_m, normal: (n, 3) contacts and outward normals. share: (n,), 0 for a lifted finger. Infinite where
    a holding contact would be pulled.
    """
    grip = grip_of(contact_m, normal, np.zeros((len(normal), 1)), share)
    held = share > 0.0
    inner, outward = internal_forces(grip)[held], normal[held]
    pressing = -np.vecdot(inner, outward)
    if float(pressing.min()) <= 1e-6:
        return math.inf
    tangential = np.linalg.norm(inner + pressing[:, None] * outward, axis=1)
    return float((tangential / pressing).max())


def best_shares(
    grasps: Sequence[tuple[Array, Array]], is_held: Sequence[bool], enough: float
) -> tuple[Array, float]:
    """Return the most equal shares (n,) that need no more friction than `enough`, and what they need.

    Where none do, those that need the least. grasps: contacts and normals (n, 3), which may be several as an
    object turns; the worst counts. Equal shares carry torques best.
    """
    best, least = np.array(is_held, dtype=float), math.inf
    choices = [SHARES if held else (0.0,) for held in is_held]
    for chosen in sorted(itertools.product(*choices), key=sum, reverse=True):
        if max(chosen) < 1.0:
            continue
        share = np.array(chosen)
        needed = max(needed_friction(contact_m, normal, share) for contact_m, normal in grasps)
        if needed < least - WORTHWHILE:
            best, least = share, needed
        if least <= enough:
            break
    return best, least
