"""The set-up of a fingertip: what is connected to the board, and the configuration that uses it.

Belongs here: the search for cameras, buses and light controllers, the proposed exposure, the text of a
finger.toml. May use: daemon, capture, illumination, vision, common.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["FoundCamera", "SetupChoices", "finger_toml", "propose_exposure_us"]

__getattr__ = lazy_exports(
    __name__,
    {
        "exposure": "propose_exposure_us",
        "finger_file": "SetupChoices finger_toml",
        "found": "FoundCamera",
    },
)
