"""Slip: the object slides over the skin that it touches.

A contact's position refers to the undeformed dome, so it identifies a material point of the skin. While the
object sticks, the position stays, however far the skin is sheared: the beads move with the contact. When the
object slides or rolls, the position travels. Sliding needs the friction limit: silicone on dry solids has a
friction coefficient of 0.5 or more, so travel with a lower ratio of tangential to normal force is rolling. At
a higher ratio, with travel along the tangential force, friction drags the skin along: slip. The ratio is a
mean over `MEAN_US`: rolling under a high load reaches the limit for shorter times. Travel counts from when
that mean rose above the limit: what moved before has rolled.

Not detected: a flat face that slides over the dome touches the same skin as before. From the first local slip
until the whole face slides, the beads' displacement field keeps its shape within 1 % (finite elements,
friction 0.3); then it stands still, as when the push ends. slip_onset.py detects how it comes to a stand.
"""

from __future__ import annotations

import math
from collections import deque
from itertools import islice
from operator import mul

import msgspec

from palpate_edge.common.contact import Contact, Vector3

WINDOW_US = 1_000_000
MEAN_US = 90_000  # of the means: of places at either end of the window, of the last force ratios
LEAST_FRAMES = 3  # of these means
MIN_TRAVEL_MM = 1.0
TRAVEL_OVER_RADIUS = 2.0  # times the largest 95 % radius within the window: noise is no travel
MIN_FORCE_RATIO = 0.45  # of tangential to normal force; the rolling plates reach 0.4
MIN_COSINE = 0.5  # of the angle between travel and tangential force


class _SeenContact(msgspec.Struct, frozen=True):
    """A frame's contact: its place, the 95 % radius of that, and the ratio of tangential to normal force."""

    exposed_at_us: int
    position_mm: Vector3
    radius_mm: float
    force_ratio: float


class SlipDetector:
    """Detects slip of one fingertip's contacts, frame by frame."""

    def __init__(self) -> None:
        self._past: deque[_SeenContact] = deque()

    def detect(self, contact: Contact) -> bool:
        """Return whether the object slides over the skin; False without a contact or its force."""
        if not contact.in_contact or contact.position_mm is None or contact.force_N is None:
            self._past.clear()
            return False
        position, force = contact.position_mm, contact.force_N
        radius_mm = math.inf if contact.radius95_mm is None else contact.radius95_mm
        normal_N = -sum(map(mul, force, position)) / math.hypot(*position)
        ratio = 0.0
        if normal_N > 0.0:
            ratio = math.sqrt(max(0.0, sum(map(mul, force, force)) - normal_N**2)) / normal_N
        self._past.append(_SeenContact(contact.exposed_at_us, position, radius_mm, ratio))
        while contact.exposed_at_us - self._past[0].exposed_at_us > WINDOW_US:
            self._past.popleft()
        count, mean_ratio = self._recent_ratio()
        if mean_ratio < MIN_FORCE_RATIO:
            while len(self._past) > count:
                self._past.popleft()
            return False  # most contacts end here, before anything slower
        travel = self._travel_mm(count)
        travel_mm = math.hypot(*travel)
        largest_mm = max(seen.radius_mm for seen in self._past)
        if travel_mm < max(MIN_TRAVEL_MM, TRAVEL_OVER_RADIUS * largest_mm):
            return False
        share = normal_N / math.hypot(*position)
        tangential = [part + share * outward for part, outward in zip(force, position, strict=True)]
        along: float = sum(map(mul, travel, tangential))
        return along >= MIN_COSINE * travel_mm * math.hypot(*tangential)

    def _recent_ratio(self) -> tuple[int, float]:
        """Return the number of the last frames within `MEAN_US`, at least `LEAST_FRAMES`, known or not, and
        the mean force ratio of those known."""
        since_us = self._past[-1].exposed_at_us - MEAN_US
        count, total = 0, 0.0
        for seen in reversed(self._past):
            if count >= LEAST_FRAMES and seen.exposed_at_us < since_us:
                break
            count += 1
            total += seen.force_ratio
        return max(count, LEAST_FRAMES), total / count

    def _travel_mm(self, count: int) -> Vector3:
        """Return the travel over the skin within the window, between means of `count` frames."""
        if len(self._past) < 2 * count:
            return 0.0, 0.0, 0.0
        first = [seen.position_mm for seen in islice(self._past, count)]
        last = [seen.position_mm for seen in islice(reversed(self._past), count)]
        starts, ends = zip(*first, strict=True), zip(*last, strict=True)
        x, y, z = ((sum(end) - sum(start)) / count for start, end in zip(starts, ends, strict=True))
        return x, y, z
