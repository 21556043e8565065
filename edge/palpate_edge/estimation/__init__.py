"""From numbered beads to contact position, force and slip.

Belongs here: the estimator and one method a file (paper, correction model, drift, slip), with the
calibration they read. May use: vision, geometry, kernels, common; no file, clock, socket or thread.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = [
    "Calibration",
    "CorrectionModel",
    "Estimator",
    "EstimatorHealth",
    "FrameEstimator",
    "Method",
    "VirtualPointMesh",
]

__getattr__ = lazy_exports(
    __name__,
    {
        "estimator": "Estimator",
        "frame_estimator": "EstimatorHealth FrameEstimator Method",
        "calibration": "Calibration",
        "correction_model": "CorrectionModel",
        "virtual_points": "VirtualPointMesh",
    },
)
