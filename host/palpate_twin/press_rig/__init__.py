"""A simulated press rig: printer and scale at their serial lines, with the twin's dome between them.

Belongs here: Marlin's side of the dialogue, motion of the axes, the scale, contact of ball and dome. May use:
camera, dome.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["DomeOnScale", "SimulatedPrinter", "SimulatedScale"]

__getattr__ = lazy_exports(
    __name__,
    {
        "dome_on_scale": "DomeOnScale",
        "simulated_printer": "SimulatedPrinter",
        "simulated_scale": "SimulatedScale",
    },
)
