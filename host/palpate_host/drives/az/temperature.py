"""The temperature limit of an AZ axis: it applies to the hotter of drive and motor. Pure."""

from __future__ import annotations

from dataclasses import dataclass

COOLED_K = 5.0
"""Hysteresis: an axis that was too hot stays so until it is this far below its limit."""


@dataclass(frozen=True, slots=True)
class AzTemperatures:
    """The temperatures that an axis measures."""

    driver_degC: float
    motor_degC: float


class TemperatureLimit:
    """A limit with hysteresis: exceeded above `limit_degC`, until drive and motor have cooled."""

    def __init__(self, limit_degC: float) -> None:
        self.is_exceeded = False
        self._limit_degC = limit_degC

    def take(self, temperatures: AzTemperatures) -> None:
        """Update `is_exceeded` with a measurement."""
        hottest_degC = max(temperatures.driver_degC, temperatures.motor_degC)
        self.is_exceeded = hottest_degC > self._limit_degC - (COOLED_K if self.is_exceeded else 0.0)
