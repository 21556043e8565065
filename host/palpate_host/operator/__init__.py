"""Commands of an operator: control socket, client, session.

Belongs here: the protocol of the control socket, who may command, and the Python session. May use: common,
config.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["Hand", "OperatorClient", "OperatorSocket"]

__getattr__ = lazy_exports(
    __name__, {"session": "Hand", "client": "OperatorClient", "server": "OperatorSocket"}
)
