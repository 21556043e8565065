"""Base class of the plug-in's teleoperators: an action is the object's orientation, without feedback."""

from __future__ import annotations

from typing import Any

from lerobot.teleoperators import Teleoperator

from lerobot_robot_palpate.hand import ORIENTATION


class ObjectTeleoperator(Teleoperator):
    """Base of a teleoperator of the object's orientation that needs no calibration and feels nothing."""

    @property
    def action_features(self) -> dict[str, Any]:
        """Roll, pitch and yaw of the object in degrees, as of PalpateHand."""
        return dict.fromkeys(ORIENTATION, float)

    @property
    def feedback_features(self) -> dict[str, Any]:
        return {}

    @property
    def is_calibrated(self) -> bool:
        return True

    def calibrate(self) -> None:
        """Do nothing."""

    def configure(self) -> None:
        """Do nothing."""

    def send_feedback(self, feedback: dict[str, Any]) -> None:
        """Do nothing."""
