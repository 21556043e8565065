"""A scale with an HX711 at its serial line: a line with grams for each conversion."""

from __future__ import annotations

import numpy as np

PERIOD_US = 12_500  # 80 conversions a second
NOISE_N = 0.005
GRAM_N = 0.00980665


class SimulatedScale:
    """One scale. base_N: weight of what stands on it. is_silent: it sends nothing. extra_N: of a hand that
    leans on it."""

    def __init__(self, seed: int, base_N: float = 1.2, noise_N: float = NOISE_N) -> None:
        self.is_silent = False
        self.extra_N = 0.0
        self._rng = np.random.default_rng([seed, 12])
        self._base_N, self._noise_N = base_N, noise_N
        self._next_us: int | None = None

    def advance(self, now_us: int, pressed_N: float) -> bytes:
        """Return the lines that are due under a further load."""
        self._next_us = now_us if self._next_us is None else self._next_us
        lines = b""
        while self._next_us <= now_us:
            self._next_us += PERIOD_US
            load_N = self._base_N + pressed_N + self.extra_N + self._noise_N * self._rng.standard_normal()
            lines += f"{load_N / GRAM_N:.2f}\r\n".encode()
        return b"" if self.is_silent else lines
