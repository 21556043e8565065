"""The paper's experiments and figures on the twin.

Belongs here: trials, Figs. 17 and 20, pushes, the whole chain in lock step. May use: closed_loop and below.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["Trial", "make_engine", "run_loop", "run_trial"]

__getattr__ = lazy_exports(__name__, {"trial": "Trial run_trial make_engine", "loop": "run_loop"})
