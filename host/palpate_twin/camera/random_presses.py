"""Random presses: independent ones for a dataset, and continuous ones of a moving contact."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from palpate_twin.camera.deformation import DeformableDome, ProbePress
from palpate_twin.dome.probe import Probe

MOST_THETA_DEG = 72.0
DEPTH_SHARES = (0.02, 0.95)  # range of depth, as a fraction of the library's largest depth
MOST_SLIDE = 0.4  # largest slide, as a fraction of the depth
CYCLE_S = 2.4  # period of a moving contact: no contact, press, hold and roll, release
REST, DOWN, HOLD = 0.2, 0.5, 0.8  # ends of the first three phases, as fractions of the period
TILT_SIGMA_DEG, MOST_TILT_DEG = 4.0, 10.0  # of a sensor that a hand presses against a scale
LEAST_SLIDE = 0.1  # largest slide of such a press, as a fraction of the depth
ROLL_DEG = 10.0  # largest movement of the contact in the hold phase


def random_press(
    dome: DeformableDome, probes: Sequence[Probe], rng: np.random.Generator, *, twisted: bool = False
) -> ProbePress:
    """Return a random press up to MOST_THETA_DEG, uniform over the sphere, of random depth and slide.

    twisted: with a random twist as well. Slide and twist share the friction: the more the probe slides, the
    less it twists.
    """
    theta = float(np.arccos(rng.uniform(np.cos(np.radians(MOST_THETA_DEG)), 1.0)))
    probe = probes[int(rng.integers(len(probes)))]
    azimuth = float(rng.uniform(0, 2 * np.pi))
    depth_mm = float(rng.uniform(*DEPTH_SHARES)) * dome.largest_depth_mm(theta, probe)
    slide_mm, direction = float(rng.uniform(0, MOST_SLIDE)) * depth_mm, float(rng.uniform(0, 2 * np.pi))
    shear_mm = (slide_mm * float(np.cos(direction)), slide_mm * float(np.sin(direction)))
    press = ProbePress(theta, azimuth, depth_mm, shear_mm, probe)
    if not twisted:
        return press
    free = np.sqrt(1 - (slide_mm / (MOST_SLIDE * depth_mm)) ** 2)
    largest_rad = float(free) * dome.largest_twist_rad(depth_mm, probe)
    return replace(press, twist_rad=float(rng.uniform(-1, 1)) * largest_rad)


def weighed_press(dome: DeformableDome, rng: np.random.Generator) -> ProbePress:
    """Return a press of a plate near the apex, as of a sensor that a hand presses against a scale."""
    theta = min(
        float(np.radians(TILT_SIGMA_DEG)) * abs(float(rng.standard_normal())), np.radians(MOST_TILT_DEG)
    )
    azimuth, direction = rng.uniform(0, 2 * np.pi, 2).tolist()
    depth_mm = float(rng.uniform(*DEPTH_SHARES)) * dome.largest_depth_mm(theta, Probe.PLATE)
    slide_mm = float(rng.uniform(0, LEAST_SLIDE)) * depth_mm
    shear_mm = (slide_mm * float(np.cos(direction)), slide_mm * float(np.sin(direction)))
    return ProbePress(theta, azimuth, depth_mm, shear_mm, Probe.PLATE)


def moving_press(
    dome: DeformableDome, probes: Sequence[Probe], time_s: float, seed: int, *, twisted: bool = False
) -> ProbePress | None:
    """Return the press at a time, None without contact; each cycle has another position."""
    cycle, phase = divmod(time_s / CYCLE_S, 1.0)
    rng = np.random.default_rng([seed, int(cycle)])
    target = random_press(dome, probes, rng, twisted=twisted)
    roll = np.radians(ROLL_DEG) * rng.uniform(-1, 1, 2)
    if phase < REST:
        return None
    progress = float(np.clip((phase - DOWN) / (HOLD - DOWN), 0, 1))  # of the hold phase
    rise = (phase - REST) / (DOWN - REST) if phase < DOWN else (1 - phase) / (1 - HOLD)
    part = _smooth(min(rise, 1.0))
    theta = float(np.clip(target.theta_rad + progress * roll[0], 0, np.radians(MOST_THETA_DEG)))
    azimuth = target.azimuth_rad + progress * roll[1] / max(np.sin(target.theta_rad), 0.2)
    depth_mm = part * min(target.depth_mm, dome.largest_depth_mm(theta, target.probe))
    slide = part * progress * depth_mm / max(target.depth_mm, 1e-9)
    along, across = target.shear_mm
    if depth_mm <= 0:
        return None
    twist_rad = progress * target.twist_rad
    if twisted:
        largest_rad = dome.largest_twist_rad(depth_mm, target.probe)
        twist_rad = float(np.clip(twist_rad, -largest_rad, largest_rad))
    return ProbePress(theta, azimuth, depth_mm, (slide * along, slide * across), target.probe, twist_rad)


def _smooth(part: float) -> float:
    """Return the smoothstep of 0 to 1, with zero slope at both ends."""
    return part * part * (3 - 2 * part)
