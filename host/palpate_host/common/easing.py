"""Ways from rest to rest: of a turn's ramp, of a phase of a gait, of a simulated press."""

from __future__ import annotations

from typing import TypeVar

from palpate_edge.common.arrays import Array

Share = TypeVar("Share", float, Array)


def eased(passed: Share) -> Share:
    """Return the share of a way from rest to rest after this share of its time, both from 0 to 1.

    The cubic of Lynch and Park, Modern Robotics, 2017, section 9.2.2: 1.5 times as fast in the middle.
    """
    return passed * passed * (3.0 - 2.0 * passed)
