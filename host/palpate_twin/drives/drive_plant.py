"""Plant of a simulated drive: rotor and gear, friction, joint limits, and a load in place of the object.

The load is a damped spring about the grasp pose. With the joint angle q, the motor torque tau and the grasp
pose q_g:

    J q'' = tau - b q' - k (q - q_g) - c q'

Gravity is not modelled.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

LONGEST_STEP_US = 500
LONGEST_ADVANCE_US = 1_000_000
"""Longest time simulated at once; a process that was stopped for longer skips the rest."""


@dataclass(frozen=True, slots=True)
class JointParameters:
    """Parameters of one joint. The motor is Table 4's AZM24AK: 9.2e-7 kg m^2, 20:1, 0.095 N m.

    The paper gives no friction and load: friction has the size of Table 3's, the load is an assumption.
    min_rad, max_rad: mechanical stops.
    """

    rotor_inertia_kgm2: float = 9.2e-7
    gear_ratio: float = 20.0
    holding_torque_Nm: float = 0.095
    friction_Nms_rad: float = 0.05
    load_stiffness_Nm_rad: float = 4.0
    load_damping_Nms_rad: float = 0.05
    grasp_rad: float = 0.0
    min_rad: float = -math.pi
    max_rad: float = math.pi

    @property
    def inertia_kgm2(self) -> float:
        """Inertia of the rotor on the joint side of the gear."""
        return self.rotor_inertia_kgm2 * self.gear_ratio**2

    @property
    def rated_torque_Nm(self) -> float:
        """Holding torque on the joint side of the gear: 1.9 N m for Table 4's motor."""
        return self.holding_torque_Nm * self.gear_ratio


class JointPlant:
    """State of one joint; it starts at rest in the grasp pose."""

    def __init__(self, parameters: JointParameters) -> None:
        self.parameters = parameters
        self.position_rad = parameters.grasp_rad
        self.velocity_rad_s = 0.0

    def advance(self, duration_us: int, torque_Nm: float) -> None:
        """Advance under a constant motor torque."""
        duration_us = min(duration_us, LONGEST_ADVANCE_US)
        if duration_us <= 0:
            return
        steps = math.ceil(duration_us / LONGEST_STEP_US)
        self._advance_in(steps, duration_us / steps * 1e-6, torque_Nm)

    def _advance_in(self, steps: int, step_s: float, torque_Nm: float) -> None:
        """Make semi-implicit Euler steps: first the velocity, with implicit damping, then the position."""
        p = self.parameters
        inertia_kgm2, stiffness_Nm_rad, grasp_rad = p.inertia_kgm2, -p.load_stiffness_Nm_rad, p.grasp_rad
        damped_kgm2 = inertia_kgm2 + step_s * (p.friction_Nms_rad + p.load_damping_Nms_rad)
        position_rad, velocity_rad_s = self.position_rad, self.velocity_rad_s
        for _ in range(steps):
            spring_Nm = stiffness_Nm_rad * (position_rad - grasp_rad)
            impulse = inertia_kgm2 * velocity_rad_s + step_s * (torque_Nm + spring_Nm)
            velocity_rad_s = impulse / damped_kgm2
            position_rad += step_s * velocity_rad_s
            if not p.min_rad <= position_rad <= p.max_rad:
                position_rad, velocity_rad_s = min(max(position_rad, p.min_rad), p.max_rad), 0.0
        self.position_rad, self.velocity_rad_s = position_rad, velocity_rad_s
