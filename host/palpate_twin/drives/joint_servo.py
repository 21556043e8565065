"""Servo of a simulated drive: computes the torque that follows a velocity or position command.

The motor is coupled by a stiff spring and a damper to a reference that moves with the command. The distance
of the reference is limited by the torque limit: a blocked joint presses with that torque at most, and turns
back without delay.
"""

from __future__ import annotations

from palpate_host.common.joint_command import DriveGoal, JointCommand

# Design values: with Table 4's rotor (4e-4 kg m^2 behind its gear) over-damped and stable in steps of 0.5 ms.
STIFFNESS_Nm_rad = 20.0
DAMPING_Nms_rad = 0.3
FASTEST_rad_s = 3.0


class JointServo:
    """Servo of one joint; call `torque_Nm` once per step."""

    def __init__(self) -> None:
        self._reference_rad: float | None = None

    def torque_Nm(self, command: JointCommand, q_rad: float, qdot_rad_s: float, step_s: float) -> float:
        """Return the motor torque over the next step."""
        if command.goal not in (DriveGoal.VELOCITY, DriveGoal.POSITION):
            self._reference_rad = None
            return command.torque_Nm if command.goal is DriveGoal.TORQUE else 0.0
        reference = q_rad if self._reference_rad is None else self._reference_rad
        if command.goal is DriveGoal.VELOCITY:
            velocity = command.velocity_rad_s
        else:
            velocity = _within((command.position_rad - reference) / step_s, FASTEST_rad_s)
        limit_Nm = command.torque_Nm
        lead_rad = _within(reference + velocity * step_s - q_rad, limit_Nm / STIFFNESS_Nm_rad)
        self._reference_rad = q_rad + lead_rad
        torque = STIFFNESS_Nm_rad * lead_rad + DAMPING_Nms_rad * (velocity - qdot_rad_s)
        return _within(torque, limit_Nm)


def _within(value: float, limit: float) -> float:
    return max(-limit, min(limit, value))
