"""Pose of a flat object from the markers of a sensor that is known by its pictures alone.

Belongs here: the calibration of such a sensor, the pairing of markers in single frames, and the pose
estimator. May use: what estimation may use.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["PoseCalibration", "PoseEstimator"]

__getattr__ = lazy_exports(
    __name__, {"pose_calibration": "PoseCalibration", "pose_estimator": "PoseEstimator"}
)
