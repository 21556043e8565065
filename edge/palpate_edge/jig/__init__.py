"""A printed jig: a cap over the dome whose holes guide a rod with a weight, for presses at known places.

Belongs here: the plan of the holes, the OpenSCAD source, the table of holes. May use: datasets, common.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["Hole", "JigSize", "plan_holes", "scad_text"]

__getattr__ = lazy_exports(__name__, {"jig_plan": "Hole JigSize plan_holes", "jig_scad": "scad_text"})
