"""A regression problem whose truth is known: contacts seen through a smooth map with noise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from palpate_edge.calibration.training.samples import Samples
from palpate_edge.common.arrays import Array

FIELD_WIDTH = 24
STIFFNESS_N_MM = 0.8


@dataclass(frozen=True)
class Problem:
    """field = depth x waves of the direction, plus noise that grows with the hidden share; the force is
    STIFFNESS_N_MM times the depth along the inward normal."""

    waves: Array
    phase: Array
    noise_mm: float = 0.02
    noise_a_hidden_share: float = 8.0

    def samples(self, count: int, seed: int, most_hidden: float = 0.0, stiffness: float = 1.0) -> Samples:
        """`count` presses, each seen once."""
        rng = np.random.default_rng(seed)
        theta, phi = np.arccos(rng.uniform(0.3, 1, count)), rng.uniform(-np.pi, np.pi, count)
        sin = np.sin(theta)
        directions = np.stack([sin * np.cos(phi), sin * np.sin(phi), np.cos(theta)], axis=1)
        depth_mm = rng.uniform(0.3, 2.5, count)
        hidden = rng.uniform(0, most_hidden, count) if most_hidden else np.zeros(count)
        fields = depth_mm[:, None] * np.sin(directions @ self.waves + self.phase)
        spread_mm = self.noise_mm * (1 + self.noise_a_hidden_share * hidden)
        fields = fields + spread_mm[:, None] * rng.standard_normal(fields.shape)
        return Samples(
            fields=fields,
            directions=directions,
            forces_N=-stiffness * STIFFNESS_N_MM * depth_mm[:, None] * directions,
            hidden=hidden,
            faintness=np.ones(count),
            press=np.arange(count),
            plain=np.ones(count, dtype=np.bool_),
        )


@pytest.fixture(scope="session")
def problem() -> Problem:
    rng = np.random.default_rng(5)
    return Problem(1.5 * rng.standard_normal((3, FIELD_WIDTH)), rng.uniform(-np.pi, np.pi, FIELD_WIDTH))


@pytest.fixture(scope="session")
def one_line() -> Callable[[pytest.ExceptionInfo[Exception]], str]:
    """A refusal's text, which must be one line."""

    def text(error: pytest.ExceptionInfo[Exception]) -> str:
        assert "\n" not in str(error.value)
        return str(error.value)

    return text
