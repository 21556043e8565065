"""The plan of a run: where, how deep and with which slide the ball presses. The same settings give the
same plan, so that an interrupted run continues with it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import msgspec
import numpy as np

from palpate_edge.common.arrays import Array
from palpate_edge.press_rig.dome_place import outward

UNTOUCHED_EVERY = 10  # presses to one frame without contact
LEAST_DEPTH = 0.1  # of the largest depth
BLOCK = 40  # presses that are sorted for a short way; each block covers the whole dome


class PlanSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Settings that determine a plan. slide: largest slide as a fraction of the depth."""

    presses: int
    test_presses: int
    seed: int
    theta_deg: float
    depth_mm: float
    slide: float


@dataclass(frozen=True, slots=True)
class PlannedPress:
    """One frame to take. depth_mm: 0 for a frame without contact, beside the dome; slide_mm: towards the base
    and along increasing azimuth, after the press."""

    split: str
    theta_rad: float
    azimuth_rad: float
    depth_mm: float
    slide_mm: tuple[float, float]

    @property
    def outward(self) -> Array:
        """Return the outward normal (3,) in the printer's axes."""
        return outward(self.theta_rad, self.azimuth_rad)


def make_plan(settings: PlanSettings) -> tuple[PlannedPress, ...]:
    """Return the presses in their order, train and test mixed, with frames without contact between."""
    rng = np.random.default_rng([settings.seed, 11])
    count = settings.presses + settings.test_presses
    # Golden-angle spiral: even over the cap. https://doi.org/10.1007/s11004-009-9257-x
    height = 1 - (np.arange(count) + 0.5) / max(count, 1) * (1 - math.cos(math.radians(settings.theta_deg)))
    azimuth = np.arange(count) * math.pi * (3 - math.sqrt(5)) % (2 * math.pi)
    order = rng.permutation(count)
    splits = rng.permutation(["train"] * settings.presses + ["test"] * settings.test_presses)
    depths = settings.depth_mm * rng.uniform(LEAST_DEPTH, 1.0, count)
    slides = settings.slide * rng.uniform(0, 1, count) * depths
    turns = rng.uniform(0, 2 * math.pi, count)
    presses = [
        PlannedPress(
            str(splits[number]),
            math.acos(height[at]),
            float(azimuth[at]),
            float(depths[number]),
            (
                float(slides[number] * math.cos(turns[number])),
                float(slides[number] * math.sin(turns[number])),
            ),
        )
        for number, at in enumerate(order)
    ]
    short: list[PlannedPress] = []
    for start in range(0, count, BLOCK):
        short += _short_way(presses[start : start + BLOCK])
    planned: list[PlannedPress] = []
    for number, press in enumerate(short):
        if number % UNTOUCHED_EVERY == 0:
            planned.append(PlannedPress(press.split, press.theta_rad, press.azimuth_rad, 0.0, (0.0, 0.0)))
        planned.append(press)
    return tuple(planned)


def _short_way(presses: list[PlannedPress]) -> list[PlannedPress]:
    """Return the presses in an order in which each is followed by the nearest that is left."""
    left, way = list(presses), []
    at = np.array([0.0, 0.0, 1.0])
    while left:
        nearest = max(range(len(left)), key=lambda index: float(left[index].outward @ at))
        way.append(left.pop(nearest))
        at = way[-1].outward
    return way
