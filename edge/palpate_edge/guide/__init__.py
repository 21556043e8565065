"""Guided calibration: the steps from a camera to a calibration file, for a person with a kitchen scale.

Belongs here: what each step measures, its verdict in words, the order of the steps, and the files that keep
what was done. May use: setup, daemon, calibration, datasets, estimation, vision, common.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["CalibrationGuide", "GuideFiles", "GuideRunner", "GuideView", "configured_files"]

__getattr__ = lazy_exports(
    __name__,
    {
        "calibration_guide": "CalibrationGuide",
        "guide_files": "GuideFiles configured_files",
        "guide_runner": "GuideRunner",
        "guide_view": "GuideView",
    },
)
