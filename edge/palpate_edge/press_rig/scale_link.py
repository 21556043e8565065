"""A scale that prints one reading a line: the last number of each line counts.

This suits the example sketches of the HX711 libraries ("Reading: 12.3 g", "12.3") and USB serial scales that
send continuously ("ST,GS,+  12.3 g").
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from palpate_edge.common.errors import RigError

LONGEST_LINE = 200
_NUMBER = re.compile(r"[-+]?\s*\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")


@dataclass(frozen=True, slots=True)
class ScaleReading:
    """One reading of the scale: when it was received, and the force on the scale, positive downwards."""

    at_us: int
    force_N: float


class ScaleLink:
    """One scale. garbled: lines without a number since the start."""

    def __init__(self, unit_N: float, silence_s: float) -> None:
        self.garbled = 0
        self._unit_N = unit_N
        self._silence_us = round(1e6 * silence_s)
        self._heard_us: int | None = None
        self._received = b""
        self._is_whole = False  # the first line may have begun before the port was opened

    def receive(self, now_us: int, data: bytes) -> list[ScaleReading]:
        """Take the scale's bytes; return the readings of the lines that are complete."""
        self._heard_us = now_us if self._heard_us is None else self._heard_us
        *lines, self._received = (self._received + data).replace(b"\r", b"\n").split(b"\n")
        self._received = self._received[-LONGEST_LINE:]
        if lines and not self._is_whole:
            lines, self._is_whole = lines[1:], True
        readings = []
        for line in filter(None, lines):
            numbers = _NUMBER.findall(line.decode("ascii", "replace"))
            force_N = self._unit_N * float(numbers[-1].replace(" ", "")) if numbers else math.nan
            if math.isfinite(force_N):
                readings.append(ScaleReading(now_us, force_N))
                self._heard_us = now_us
            else:
                self.garbled += 1
        return readings

    def check(self, now_us: int) -> None:
        """Raises RigError when the scale gives no reading."""
        if self._heard_us is not None and now_us - self._heard_us > self._silence_us:
            garbled = f" ({self.garbled} lines without a number)" if self.garbled else ""
            raise RigError(
                f"the scale gave no reading for {self._silence_us / 1e6:g} s{garbled}: check power, cable, "
                "scale.port and scale.baud"
            )
