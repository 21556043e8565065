"""From a press dataset to a calibration file, and how good it is.

Belongs here: measuring, fitting, the calibration file, evaluation and training. May use: datasets,
estimation, vision, geometry, common.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["evaluate_dataset", "load_calibration", "save_calibration"]

__getattr__ = lazy_exports(
    __name__, {"calibration_file": "load_calibration save_calibration", "evaluation": "evaluate_dataset"}
)
