"""The laws that move the object: virtual frames, torques, kinematics.

Belongs here: Eqs. (9) to (16) and the hand's model; pure functions of their inputs. May use: config,
common.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["Gains", "HandKinematics", "HandPose", "Manipulation", "joint_torque_Nm"]

__getattr__ = lazy_exports(
    __name__,
    {
        "kinematics": "HandKinematics HandPose",
        "manipulation": "Manipulation",
        "gains": "Gains",
        "control_law": "joint_torque_Nm",
    },
)
