"""Whether an AZ axis is too hot: the hotter of drive and motor against the axis' limit. Pure."""

from __future__ import annotations

from dataclasses import dataclass

COOLED_K = 5.0
"""An axis that was too hot is so until it is this far below its limit."""


@dataclass(frozen=True, slots=True)
class AzTemperatures:
    """What an axis measures in its drive and at its motor."""

    driver_degC: float
    motor_degC: float


class TemperatureLimit:
    """Exceeded above `limit_degC`, until both have cooled."""

    def __init__(self, limit_degC: float) -> None:
        self.is_exceeded = False
        self._limit_degC = limit_degC

    def take(self, temperatures: AzTemperatures) -> None:
        """The newest measurement counts."""
        hottest_degC = max(temperatures.driver_degC, temperatures.motor_degC)
        self.is_exceeded = hottest_degC > self._limit_degC - (COOLED_K if self.is_exceeded else 0.0)
