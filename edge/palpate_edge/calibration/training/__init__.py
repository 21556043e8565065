"""Training of the correction model.

Belongs here: samples, kernel ridge regression, its uncertainty, the dome model and the ONNX export. May
use: what calibration may use.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["DomeModel", "fit", "load_dome_model"]

__getattr__ = lazy_exports(__name__, {"dome_model": "DomeModel load_dome_model", "kernel_ridge": "fit"})
