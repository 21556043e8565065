"""Stability of the joints' damping, -B dq/dt of Eq. (10), at the hand's tick.

The damping acts through the bus: the velocity of one tick is answered by a torque that acts from the next
tick on and is held for its length T. With the inertia M of links and rotors and the viscous friction d of
the joints, both from [twin] of hand.toml, the velocities v of a free hand are

    v[k+1] = F v[k] - G B v[k-1],    F = exp(-M^-1 d T),    G = d^-1 (1 - F),

which is stable while every eigenvalue of this step is inside the unit circle. A held object adds inertia, so
such a hand is stable at slightly slower ticks as well.
"""

from __future__ import annotations

import math

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_edge.common.errors import ConfigError
from palpate_host.common.joint_command import Follows
from palpate_host.config.control_config import ControlLaw
from palpate_host.config.hand_config import HandConfig
from palpate_host.control.kinematics import HandKinematics
from palpate_host.control.turning_stability import ADVISED_MARGIN

FASTEST_TICK_HZ = 1000
LEAST_FRICTION_NMS_RAD = 1e-6
"""Friction below which it counts as this, for G to exist."""


def check_damping(config: HandConfig, hand: HandKinematics) -> None:
    """Raise ConfigError, with the tick rate that fits, when the pose law's joints oscillate at tick_Hz."""
    if config.control.law is not ControlLaw.POSE:
        return
    slowest_Hz = slowest_tick_Hz(config, hand)
    if slowest_Hz is None or config.control.tick_Hz >= slowest_Hz:
        return
    advised_Hz = math.ceil(ADVISED_MARGIN * slowest_Hz)
    raise ConfigError(
        f"control.tick_Hz = {config.control.tick_Hz:g} is too slow for the joints' damping B_Nms_rad: they"
        f" oscillate, and the object is lost: set control.tick_Hz to {advised_Hz} at least, or reduce"
        " B_Nms_rad"
    )


def slowest_tick_Hz(config: HandConfig, hand: HandKinematics) -> int | None:
    """Return the slowest stable tick rate, FASTEST_TICK_HZ at most, with the joints in mid-range.

    None where the inertia of the drives is not known, and for drives that follow velocity or position, which
    have loops of their own.
    """
    twin, control = config.twin, config.control
    if twin is None or twin.armature_kgm2 == 0.0 or control.drives_follow is not Follows.TORQUE:
        return None
    middle = np.array([(joint.min_rad + joint.max_rad) / 2 for joint in config.joints])
    inertia = hand.inertia_kgm2(middle) + twin.armature_kgm2 * np.eye(len(middle))
    damping = np.array([joint.B_Nms_rad for joint in config.joints])
    too_slow, stable = 0, FASTEST_TICK_HZ
    while stable - too_slow > 1:
        tick_Hz = (too_slow + stable) // 2
        if is_stable(inertia, damping, twin.joint_friction_Nms_rad, 1.0 / tick_Hz):
            stable = tick_Hz
        else:
            too_slow = tick_Hz
    return stable


def is_stable(inertia_kgm2: Array, B_Nms_rad: Array, friction_Nms_rad: float, tick_s: float) -> bool:
    """Return whether the sampled damping B (nq,) is stable with an inertia (nq, nq) and this friction."""
    friction = max(friction_Nms_rad, LEAST_FRICTION_NMS_RAD)
    moments, axes = np.linalg.eigh(inertia_kgm2)
    decay = np.exp(-friction * tick_s / moments)
    F, G = (axes * decay) @ axes.T, (axes * ((1.0 - decay) / friction)) @ axes.T
    n = len(moments)
    step = np.block([[F, -G * B_Nms_rad], [np.eye(n), np.zeros((n, n))]])
    return bool(np.abs(np.linalg.eigvals(step)).max() < 1.0)
