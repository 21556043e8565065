"""Random presses: independent ones for a dataset, and continuous ones of a moving contact."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_edge.geometry.angles import rotation_about_z
from palpate_edge.jig.jig_plan import Hole
from palpate_host.common.easing import eased
from palpate_twin.camera.deformation import DeformableDome, ProbePress
from palpate_twin.dome.probe import Probe

MOST_THETA_DEG = 72.0
DEPTH_SHARES = (0.02, 0.95)  # range of depth, as a fraction of the library's largest depth
MOST_SLIDE = 0.4  # largest slide, as a fraction of the depth
CYCLE_S = 2.4  # period of a moving contact: no contact, press, hold and roll, release
REST, DOWN, HOLD = 0.2, 0.5, 0.8  # ends of the first three phases, as fractions of the period
TILT_SIGMA_DEG, MOST_TILT_DEG = 4.0, 10.0  # of a sensor that a hand presses against a scale
LEAST_SLIDE = 0.1  # largest slide of such a press, as a fraction of the depth
HOLE_SIGMA_MM, HOLE_SIGMA_DEG = 0.1, 0.5  # of each printed hole, and degrees of the jig about the dome's axis
UPRIGHT_SIGMA_DEG = 3.0  # of a rod that a hand holds upright by eye
MOST_CARRIED = 0.03  # of a rod's weight, by friction in a hole that was reamed
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


def printed_axes(holes: Sequence[Hole], outer_radius_mm: float, rng: np.random.Generator) -> Array:
    """Return the axes (n, 3) that the holes of a printed jig have, as unit vectors from the dome's centre.

    Each is off by HOLE_SIGMA_MM and HOLE_SIGMA_DEG, and the jig is turned on the housing by HOLE_SIGMA_DEG.
    """
    angle_rad = np.radians(HOLE_SIGMA_DEG)
    sigma = float(np.hypot(angle_rad, HOLE_SIGMA_MM / outer_radius_mm))
    axes = np.array([hole.outward for hole in holes]) + sigma * rng.standard_normal((len(holes), 3))
    axes @= rotation_about_z(float(angle_rad * rng.standard_normal())).T
    return np.asarray(axes / np.linalg.norm(axes, axis=1, keepdims=True))


def rod_press(dome: DeformableDome, axis: Array, rng: np.random.Generator) -> tuple[ProbePress, float]:
    """Return a press of a rod along an axis (3,), and the share of the rod's weight that reaches the dome.

    The rod stands upright within UPRIGHT_SIGMA_DEG; friction in the hole carries up to MOST_CARRIED of the
    weight and lets the tip slide by up to LEAST_SLIDE of the depth.
    """
    theta, azimuth = float(np.arccos(axis[2])), float(np.arctan2(axis[1], axis[0]))
    depth_mm = float(rng.uniform(*DEPTH_SHARES)) * dome.largest_depth_mm(theta, Probe.SPHERE5)
    slide_mm, direction = float(rng.uniform(0, LEAST_SLIDE)) * depth_mm, float(rng.uniform(0, 2 * np.pi))
    shear_mm = (slide_mm * float(np.cos(direction)), slide_mm * float(np.sin(direction)))
    upright = float(np.cos(np.radians(UPRIGHT_SIGMA_DEG) * rng.standard_normal()))
    share = upright * (1 - float(rng.uniform(0, MOST_CARRIED)))
    return ProbePress(theta, azimuth, depth_mm, shear_mm, Probe.SPHERE5), share


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
    part = eased(min(rise, 1.0))
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
