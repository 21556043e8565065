"""Motion of a printer's axes: straight moves with limited speed and acceleration, and play."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from palpate_edge.common.arrays import Array

# Limits of a usual bed-slinger with a lead screw in z: x, y and z.
SPEEDS_MM_S = np.array([200.0, 200.0, 12.0])
ACCELERATIONS_MM_S2 = np.array([1000.0, 1000.0, 100.0])


@dataclass(frozen=True, slots=True)
class StraightMove:
    """A move from rest to rest between positions (3,), at a trapezoid of speeds."""

    start_us: int
    start_mm: Array
    end_mm: Array
    length_mm: float
    speed_mm_s: float
    acceleration_mm_s2: float

    @classmethod
    def plan(cls, start_us: int, start_mm: Array, end_mm: Array, speed_mm_s: float) -> StraightMove:
        """Return the move at the given speed, or slower where an axis needs it."""
        step = end_mm - start_mm
        length = float(np.linalg.norm(step))
        share = np.maximum(np.abs(step) / max(length, 1e-9), 1e-9)
        acceleration = float((ACCELERATIONS_MM_S2 / share).min())
        speed = min(speed_mm_s, float((SPEEDS_MM_S / share).min()), math.sqrt(acceleration * length))
        return cls(start_us, start_mm, end_mm, length, speed, acceleration)

    @property
    def end_us(self) -> int:
        """Return the time of the end."""
        if self.length_mm == 0:
            return self.start_us
        seconds = self.length_mm / self.speed_mm_s + self.speed_mm_s / self.acceleration_mm_s2
        return self.start_us + math.ceil(1e6 * seconds)

    def at_mm(self, now_us: int) -> Array:
        """Return the position (3,) at a time."""
        if self.length_mm == 0 or now_us >= self.end_us:
            return self.end_mm
        speed, acceleration = self.speed_mm_s, self.acceleration_mm_s2
        total_s = (self.end_us - self.start_us) / 1e6
        ramp_s = speed / acceleration
        time_s = min(max((now_us - self.start_us) / 1e6, 0.0), total_s)
        if time_s < ramp_s:
            way = acceleration * time_s**2 / 2
        elif time_s < total_s - ramp_s:
            way = speed * (time_s - ramp_s / 2)
        else:
            way = self.length_mm - acceleration * (total_s - time_s) ** 2 / 2
        share = min(1.0, max(0.0, way / self.length_mm))
        return np.asarray(self.start_mm + share * (self.end_mm - self.start_mm))


class Play:
    """Backlash of each axis: the carriage follows the motor only beyond half the play on either side."""

    def __init__(self, play_mm: float, start_mm: Array) -> None:
        self._half_mm = play_mm / 2
        self._at_mm = start_mm.copy()

    def follow(self, motor_mm: Array) -> Array:
        """Return where the carriage stands (3,) after the motors went to motor_mm (3,)."""
        self._at_mm = np.clip(self._at_mm, motor_mm - self._half_mm, motor_mm + self._half_mm)
        return self._at_mm
