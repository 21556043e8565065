"""palpate_edge: touch on a fingertip's board; camera frames in, contact position and force out, over CAN.

The exported names are what a program needs to estimate contacts from its own frames. They are imported when
first used: `import palpate_edge` loads neither NumPy nor OpenCV.
"""

from typing import TYPE_CHECKING

from palpate_edge.common.lazy_exports import lazy_exports

if TYPE_CHECKING:
    from palpate_edge.calibration.calibration_file import load_calibration
    from palpate_edge.common.contact import Contact
    from palpate_edge.common.errors import PalpateError
    from palpate_edge.common.frame import Frame
    from palpate_edge.estimation.calibration import Calibration
    from palpate_edge.estimation.estimator import Estimator
    from palpate_edge.estimation.frame_estimator import EstimatorHealth, Method
else:
    __getattr__ = lazy_exports(
        __name__,
        {
            "calibration.calibration_file": "load_calibration",
            "common.contact": "Contact",
            "common.errors": "PalpateError",
            "common.frame": "Frame",
            "estimation.calibration": "Calibration",
            "estimation.estimator": "Estimator",
            "estimation.frame_estimator": "EstimatorHealth Method",
        },
    )

__all__ = [
    "Calibration",
    "Contact",
    "Estimator",
    "EstimatorHealth",
    "Frame",
    "Method",
    "PalpateError",
    "load_calibration",
]
__version__ = "0.1.0"
