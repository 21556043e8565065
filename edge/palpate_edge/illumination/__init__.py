"""The controller of the LEDs, over I2C.

Belongs here: the register map, the client and the thread that keeps the light alive. May use: common.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["IlluminationClient", "LightController", "LightRegister"]

__getattr__ = lazy_exports(
    __name__,
    {"client": "IlluminationClient", "registers": "LightRegister", "controller_thread": "LightController"},
)
