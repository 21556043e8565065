"""The press rig: a 3-D printer that presses the dome with a ball while a scale weighs.

Belongs here: plan, collision checks, dialogue with printer and scale, labels. May use: daemon, calibration,
datasets, geometry, common.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["RigConfig", "RigCore", "RigJournal"]

__getattr__ = lazy_exports(
    __name__, {"rig_config": "RigConfig", "rig_core": "RigCore", "journal": "RigJournal"}
)
