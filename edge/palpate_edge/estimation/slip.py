"""Slip: the object moves against the skin that it touches.

A contact's place is given on the undeformed dome, so it is the name of a piece of skin: while the object
sticks the place stays, however far the skin is sheared, and the beads about it move with the contact. An
object that slides or rolls makes the place travel. Sliding needs the friction's limit: silicone on dry solids
has a coefficient of 0.5 or more, so a force across the normal below that is rolling; above it, and along the
travel, it is friction that drags the skin along: a slip.

What the beads cannot tell: a flat face that slides over the dome touches the same skin as before. From the
first slip to the whole face sliding, the field of the beads keeps its shape within 1 % (finite elements,
friction 0.3); then it stands still, as when the push ends. Only the force could tell that case, where the
coefficient of friction is known.
"""

from __future__ import annotations

import math
from collections import deque
from operator import mul

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_edge.common.contact import Contact, Vector3

WINDOW_US = 1_000_000
ENDS = 3  # frames averaged at either end of the window
LEAST_TRAVEL_MM = 1.0
TRAVEL_OVER_RADIUS = 2.0  # the largest 95 % radius within the window: noise is no travel
LEAST_RATIO = 0.45  # of the force across the normal to the one along it; the rolling plates reach 0.4
LEAST_COSINE = 0.5  # between travel and the force across the normal


class SlipWatch:
    """Watches one fingertip's contacts, frame by frame."""

    def __init__(self) -> None:
        self._past: deque[tuple[int, Vector3, float]] = deque()  # time, place, its 95 % radius

    def slips(self, contact: Contact) -> bool:
        """Whether what touches slides over the skin; False without a contact or without its force."""
        if not contact.in_contact or contact.position_mm is None or contact.force_N is None:
            self._past.clear()
            return False
        position, force = contact.position_mm, contact.force_N
        radius_mm = math.inf if contact.radius95_mm is None else contact.radius95_mm
        self._past.append((contact.exposed_at_us, position, radius_mm))
        while contact.exposed_at_us - self._past[0][0] > WINDOW_US:
            self._past.popleft()
        normal_N = -sum(map(mul, force, position)) / math.hypot(*position)
        if normal_N <= 0 or math.hypot(*force) < math.hypot(1.0, LEAST_RATIO) * normal_N:
            return False  # before anything that takes longer: most contacts end here
        outward = np.array(position) / math.hypot(*position)
        across = np.array(force) + normal_N * outward
        across_N = float(np.linalg.norm(across))
        travel = self._travel_mm()
        travel_mm = float(np.linalg.norm(travel))
        if travel_mm < max(LEAST_TRAVEL_MM, TRAVEL_OVER_RADIUS * max(radius for *_, radius in self._past)):
            return False
        return float(travel @ across) >= LEAST_COSINE * travel_mm * across_N

    def _travel_mm(self) -> Array:
        """(3,): of the contact over the skin within the window."""
        places = [place for _, place, _ in self._past]
        if len(places) < 2 * ENDS:
            return np.zeros(3)
        return np.asarray(np.mean(places[-ENDS:], axis=0) - np.mean(places[:ENDS], axis=0))
