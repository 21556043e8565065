"""make demo: processes, turns, figures, report.

Belongs here: the run of the demo and its report. May use: paper and below.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["run", "write_report"]

__getattr__ = lazy_exports(__name__, {"orchestrator": "run", "report": "write_report"})
