"""Slip: the object slides over the skin that it touches.

A contact's position refers to the undeformed dome, so it identifies a material point of the skin. While the
object sticks, the position stays, however far the skin is sheared: the beads move with the contact. When the
object slides or rolls, the position travels. Sliding needs the friction limit: silicone on dry solids has a
friction coefficient of 0.5 or more, so travel with a lower ratio of tangential to normal force is rolling. At
a higher ratio, with travel along the tangential force, friction drags the skin along: slip.

Not detected: a flat face that slides over the dome touches the same skin as before. From the first local slip
until the whole face slides, the beads' displacement field keeps its shape within 1 % (finite elements,
friction 0.3); then it stands still, as when the push ends. slip_onset.py detects how it comes to a stand.
"""

from __future__ import annotations

import math
from collections import deque
from operator import mul

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_edge.common.contact import Contact, Vector3

WINDOW_US = 1_000_000
END_FRAMES = 3  # averaged at either end of the window
MIN_TRAVEL_MM = 1.0
TRAVEL_OVER_RADIUS = 2.0  # times the largest 95 % radius within the window: noise is no travel
MIN_FORCE_RATIO = 0.45  # of tangential to normal force; the rolling plates reach 0.4
MIN_COSINE = 0.5  # of the angle between travel and tangential force


class SlipDetector:
    """Detects slip of one fingertip's contacts, frame by frame."""

    def __init__(self) -> None:
        self._past: deque[tuple[int, Vector3, float]] = deque()  # time, position, its 95 % radius

    def detect(self, contact: Contact) -> bool:
        """Return whether the object slides over the skin; False without a contact or its force."""
        if not contact.in_contact or contact.position_mm is None or contact.force_N is None:
            self._past.clear()
            return False
        position, force = contact.position_mm, contact.force_N
        radius_mm = math.inf if contact.radius95_mm is None else contact.radius95_mm
        self._past.append((contact.exposed_at_us, position, radius_mm))
        while contact.exposed_at_us - self._past[0][0] > WINDOW_US:
            self._past.popleft()
        normal_N = -sum(map(mul, force, position)) / math.hypot(*position)
        if normal_N <= 0 or math.hypot(*force) < math.hypot(1.0, MIN_FORCE_RATIO) * normal_N:
            return False  # most contacts end here, before anything slower
        outward = np.array(position) / math.hypot(*position)
        tangential = np.array(force) + normal_N * outward
        tangential_N = float(np.linalg.norm(tangential))
        travel = self._travel_mm()
        travel_mm = float(np.linalg.norm(travel))
        if travel_mm < max(MIN_TRAVEL_MM, TRAVEL_OVER_RADIUS * max(radius for *_, radius in self._past)):
            return False
        return float(travel @ tangential) >= MIN_COSINE * travel_mm * tangential_N

    def _travel_mm(self) -> Array:
        """Return the contact's travel (3,) over the skin within the window."""
        places = [place for _, place, _ in self._past]
        if len(places) < 2 * END_FRAMES:
            return np.zeros(3)
        return np.asarray(np.mean(places[-END_FRAMES:], axis=0) - np.mean(places[:END_FRAMES], axis=0))
