"""What both engines of the hand and its object offer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import mujoco
import numpy as np
import numpy.typing as npt

from palpate_edge.common.arrays import Array
from palpate_edge.common.errors import PalpateError
from palpate_twin.hand.twin_model import TwinModel

STEP_S = 5e-4
BRAKE_KGM2 = 1e6
"""Inertia of a joint that stands: contacts then meet a wall, as damping would not let the solver know."""


class LostGraspError(PalpateError):
    """A tip has left its face of the object or let go."""


@dataclass(frozen=True, slots=True)
class TipTouch:
    """One tip on the object. point_m: x_i (3,) and friction_N (3,), the tangential force on the tip, in the
    hand's frame."""

    point_m: Array
    normal_force_N: float
    friction_N: Array


class Engine(Protocol):
    """Hand and object, moved on step by step under joint torques."""

    twin: TwinModel
    data: mujoco.MjData
    step_s: float
    slip_m: Array
    """(3,) path of each tip's skin against the object since the start."""

    @property
    def time_s(self) -> float:
        """Since the start."""
        ...

    @property
    def q_rad(self) -> Array:
        """(nq,) joint angles in hand.toml's order."""
        ...

    @property
    def qdot_rad_s(self) -> Array:
        """(nq,)."""
        ...

    @property
    def object_rotation(self) -> Array:
        """(3, 3), columns are the object's axes in the hand's frame."""
        ...

    @property
    def object_position_m(self) -> Array:
        """(3,) centre of mass in the hand's frame."""
        ...

    def step(self, torque_Nm: Array) -> None:
        """Move on by step_s under the torques u (nq,)."""
        ...

    def brake(self, is_braked: npt.NDArray[np.bool_]) -> None:
        """Which joints (nq,) stand from now on, whatever their torque; the others are free."""
        ...

    def take_support_away(self) -> None:
        """From now on the object has its weight, which Eq. (5) leaves out."""
        ...

    def touches(self) -> tuple[TipTouch | None, ...]:
        """Each tip's contact, None where it touches nothing. LostGraspError when a tip has left its face."""
        ...
