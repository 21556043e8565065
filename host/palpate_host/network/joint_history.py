"""History of the joint angles, so that a late camera frame is used with the pose of its exposure."""

from __future__ import annotations

from collections import deque

import numpy as np

from palpate_edge.common.arrays import Array


class JointHistory:
    """Joint angles by increasing time; beyond `capacity` samples the oldest are dropped."""

    def __init__(self, capacity: int) -> None:
        self._samples: deque[tuple[int, Array]] = deque(maxlen=capacity)

    def add(self, time_us: int, q_rad: Array) -> None:
        """Append (nq,) angles; a sample that is not later than the last one is ignored."""
        if not self._samples or time_us > self._samples[-1][0]:
            self._samples.append((time_us, q_rad))

    def at(self, time_us: int) -> Array | None:
        """Return the angles at `time_us`: interpolated, or the newest; None before the oldest sample."""
        newer: tuple[int, Array] | None = None
        for sample in reversed(self._samples):
            if sample[0] <= time_us:
                return sample[1] if newer is None else _between(sample, newer, time_us)
            newer = sample
        return None


def _between(older: tuple[int, Array], newer: tuple[int, Array], time_us: int) -> Array:
    share = (time_us - older[0]) / (newer[0] - older[0])
    return np.asarray(older[1] + share * (newer[1] - older[1]))
