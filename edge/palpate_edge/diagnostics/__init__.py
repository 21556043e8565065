"""Pictures and reports of a pipeline, for people.

Belongs here: figures of each step, tracks over a video, estimates of a whole recording as CSV. May use:
every room but cli.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["Steps", "estimate_recording", "take_steps"]

__getattr__ = lazy_exports(__name__, {"batch": "estimate_recording", "pipeline_steps": "Steps take_steps"})
