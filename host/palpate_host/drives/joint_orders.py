"""The order to each drive from the controller's torques, within the joint's rates and range. Pure.

TORQUE: u, changing by at most `torque_rate_Nm_s`. VELOCITY: the admittance qdot = u / B_d, limited in speed
and acceleration; outwards it is at most the rest of the range in 0.1 s. POSITION: the integral of that
velocity, at most `LEAD_RAD` ahead of the joint and within the range; the drive's own torque limit bounds the
torque.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_host.common.joint_command import DriveGoal, Follows, JointCommand
from palpate_host.config.control_config import ControlConfig
from palpate_host.config.hand_config import JointConfig

LEAD_RAD = 0.05
RANGE_TIME_S = 0.1


class JointOrders:
    """The last orders of all joints; the next ones differ from them by at most the rate limits."""

    def __init__(self, joints: Sequence[JointConfig], control: ControlConfig) -> None:
        self._control = control
        self._tick_s = 1.0 / control.tick_Hz
        self._limit_Nm = [joint.torque_limit_Nm for joint in joints]
        self._min_rad = np.array([joint.min_rad for joint in joints])
        self._max_rad = np.array([joint.max_rad for joint in joints])
        self.stop()

    def stop(self) -> None:
        """Forget the last commands: the next ones start from standstill at the joints' positions."""
        self._last = np.zeros(len(self._limit_Nm))
        self._position_rad: Array | None = None

    def moving(self, torque_Nm: Array, q_rad: Array | None) -> list[JointCommand]:
        """Return one order a joint for the torques u (nq,).

        q_rad: the joint angles (nq,), None while unknown; the orders are then torques.
        """
        control = self._control
        if control.drives_follow is Follows.TORQUE or q_rad is None:
            self._last = self._near_last(torque_Nm, control.torque_rate_Nm_s)
            return [JointCommand(DriveGoal.TORQUE, torque) for torque in self._last.tolist()]
        velocity = np.clip(
            torque_Nm / control.B_d_Nms_rad, -control.speed_limit_rad_s, control.speed_limit_rad_s
        )
        velocity = self._near_last(velocity, control.acceleration_limit_rad_s2)
        most = (self._max_rad - q_rad) / RANGE_TIME_S
        least = (self._min_rad - q_rad) / RANGE_TIME_S
        speed = control.speed_limit_rad_s
        self._last = np.clip(np.minimum(np.maximum(velocity, least), most), -speed, speed)
        if control.drives_follow is Follows.VELOCITY:
            return [
                JointCommand(DriveGoal.VELOCITY, limit, velocity_rad_s=one)
                for limit, one in zip(self._limit_Nm, self._last.tolist(), strict=True)
            ]
        last = q_rad if self._position_rad is None else self._position_rad
        near = np.clip(last + self._last * self._tick_s, q_rad - LEAD_RAD, q_rad + LEAD_RAD)
        self._position_rad = np.clip(near, self._min_rad, self._max_rad)
        return [
            JointCommand(DriveGoal.POSITION, limit, position_rad=one)
            for limit, one in zip(self._limit_Nm, self._position_rad.tolist(), strict=True)
        ]

    def _near_last(self, desired: Array, rate_per_s: float) -> Array:
        step = rate_per_s * self._tick_s
        return np.asarray(np.minimum(np.maximum(desired, self._last - step), self._last + step))
