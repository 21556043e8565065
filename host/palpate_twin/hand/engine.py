"""Interface of the two physics engines of hand and object."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import mujoco
import numpy as np
import numpy.typing as npt

from palpate_edge.common.arrays import Array
from palpate_edge.common.errors import PalpateError
from palpate_twin.hand.disturbance import Load, Schedule
from palpate_twin.hand.twin_model import TwinModel

STEP_S = 5e-4
BRAKE_KGM2 = 1e6
"""Inertia of a braked joint, which makes it a rigid wall for contacts; the solver would ignore damping."""


class LostGraspError(PalpateError):
    """A tip has left its face of the object or lost contact."""


@dataclass(frozen=True, slots=True)
class EngineContact:
    """Contact of one tip with the object, in the hand frame.

    point_m: (3,) contact point x_i; friction_N: (3,) tangential force on the tip.
    """

    point_m: Array
    normal_force_N: float
    friction_N: Array


class Engine(Protocol):
    """Dynamics of hand and object under joint torques."""

    twin: TwinModel
    data: mujoco.MjData
    step_s: float
    slip_m: Array
    """(n,) sliding distance of each tip on the object since the start."""

    @property
    def time_s(self) -> float:
        """Simulated time since the start."""
        ...

    @property
    def q_rad(self) -> Array:
        """(nq,) joint angles in the order of hand.toml."""
        ...

    @property
    def qdot_rad_s(self) -> Array:
        """(nq,) joint velocities."""
        ...

    @property
    def object_rotation(self) -> Array:
        """(3, 3), columns are the object's axes in the hand frame."""
        ...

    @property
    def object_position_m(self) -> Array:
        """(3,) centre of mass in the hand frame."""
        ...

    def step(self, torque_Nm: Array) -> None:
        """Advance by step_s under the joint torques u (nq,)."""
        ...

    def brake(self, is_braked: npt.NDArray[np.bool_]) -> None:
        """Brake the selected joints (nq,), which then ignore their torque, and release the others."""
        ...

    def remove_support(self) -> None:
        """Let the object's weight act, which Eq. (5) omits."""
        ...

    def tip_contacts(self) -> tuple[EngineContact | None, ...]:
        """Return each tip's contact, None without one. Raises LostGraspError if a tip has left its face."""
        ...


class EngineState:
    """State that both engines keep in MuJoCo's data: joint angles, joint velocities, brakes and loads."""

    def __init__(self, twin: TwinModel, step_s: float) -> None:
        self.twin, self.step_s = twin, step_s
        self.data = twin.start()
        self.slip_m = np.zeros(len(twin.tip_geoms))
        self._braked = twin.v_address[:0]
        self._schedule = Schedule(twin.twin.disturbances, step_s)
        self._load: Load | None = None

    @property
    def q_rad(self) -> Array:
        return np.asarray(self.data.qpos[self.twin.q_address])

    @property
    def qdot_rad_s(self) -> Array:
        return np.asarray(self.data.qvel[self.twin.v_address])

    def _advance_load(self, time_s: float) -> Load | None:
        """Return the load on the object in the step that begins now; the model gets an added mass.

        The added mass is not in MuJoCo's inverse weights, so the contacts' softness does not depend on it.
        """
        load = self._schedule.next_load(time_s)
        if load is not None:
            self._load = load
            mass_kg = self.twin.prism.mass_kg + load.added_mass_kg
            model, grasped, first = self.twin.model, self.twin.object_body, self.twin.object_v
            model.body_mass[grasped] = model.body_subtreemass[grasped] = mass_kg
            model.dof_M0[first : first + 3] = mass_kg  # MuJoCo's mass matrix of a single free body
        return self._load

    def brake(self, is_braked: npt.NDArray[np.bool_]) -> None:
        twin = self.twin
        self._braked = twin.v_address[is_braked]
        twin.model.dof_armature[twin.v_address] = twin.twin.armature_kgm2 + BRAKE_KGM2 * is_braked
