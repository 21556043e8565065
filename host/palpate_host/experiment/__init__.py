"""Comparison of both control laws as in Fig. 20: protocol, trials, report.

Belongs here: the definition of an experiment, a trial on a real hand, and the report. May use: recording,
groundtruth and below.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["ExperimentConfig", "TrialResult"]

__getattr__ = lazy_exports(__name__, {"protocol": "ExperimentConfig", "result": "TrialResult"})
