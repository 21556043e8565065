"""The console of a hand: its page in the browser, fed by the control socket and the bus.

Belongs here: the hand drawn from its status, figures of the bus, the page's commands, recordings
and files, and the view in the terminal. May use: recording and below, palpate_bus and palpate_edge.web.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["HandFeed", "HandScene", "SceneMaker", "serve_hand"]

__getattr__ = lazy_exports(
    __name__, {"hand_feed": "HandFeed", "hand_scene": "HandScene SceneMaker", "serve": "serve_hand"}
)
