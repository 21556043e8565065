"""The servo of a simulated drive: the torque by which its motor follows a velocity or a position. Pure.

A stiff spring and a damper to a reference that moves with the order, never further away than the torque limit
reaches: a blocked joint presses with that torque and no more, and lets go at once when told to turn back.
"""

from __future__ import annotations

from palpate_host.common.joint_command import DriveGoal, JointCommand

# Chosen: with the 4e-4 kg m^2 of Table 4's rotor behind its gear over-damped and stable in steps of 0.5 ms.
STIFFNESS_Nm_rad = 20.0
DAMPING_Nms_rad = 0.3
FASTEST_rad_s = 3.0


class JointServo:
    """One joint's reference; `torque_Nm` once a step."""

    def __init__(self) -> None:
        self._reference_rad: float | None = None

    def torque_Nm(self, command: JointCommand, q_rad: float, qdot_rad_s: float, step_s: float) -> float:
        """What the motor gives over the next step."""
        if command.goal not in (DriveGoal.VELOCITY, DriveGoal.POSITION):
            self._reference_rad = None
            return command.torque_Nm if command.goal is DriveGoal.TORQUE else 0.0
        reference = q_rad if self._reference_rad is None else self._reference_rad
        if command.goal is DriveGoal.VELOCITY:
            velocity = command.velocity_rad_s
        else:
            velocity = _within((command.position_rad - reference) / step_s, FASTEST_rad_s)
        cap_Nm = command.torque_Nm
        lead_rad = _within(reference + velocity * step_s - q_rad, cap_Nm / STIFFNESS_Nm_rad)
        self._reference_rad = q_rad + lead_rad
        torque = STIFFNESS_Nm_rad * lead_rad + DAMPING_Nms_rad * (velocity - qdot_rad_s)
        return _within(torque, cap_Nm)


def _within(value: float, limit: float) -> float:
    return max(-limit, min(limit, value))
