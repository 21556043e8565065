"""Views of a hand: 3-D, contacts, forces.

Belongs here: views of a running hand or a recording. May use: recording and below. Needs the extra view.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["HandView"]

__getattr__ = lazy_exports(__name__, {"hand_view": "HandView"})
