"""From a pose dataset to a pose calibration, and how good it is.

Belongs here: markers at rest, their displacements in every press, the regression of the labels, the
calibration file and the evaluation. May use: what calibration may use; numpy and no extra.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["calibrate_pose", "evaluate_pose", "load_pose_calibration", "save_pose_calibration"]

__getattr__ = lazy_exports(
    __name__,
    {
        "calibrate_pose": "calibrate_pose",
        "pose_evaluation": "evaluate_pose",
        "pose_calibration_file": "load_pose_calibration save_pose_calibration",
    },
)
