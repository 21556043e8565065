"""Engine ``eqs``: the paper's hand and object, Eqs. (4)-(8), with tips that roll and never slip.

M, C and g of hand and object come from MuJoCo, the contact model from the paper. For the velocities v of
joints and object, Eqs. (4)-(6) are one equation,

    M v' + C v + g + Jn^T f + Jt^T lambda + dT/dv = u,        Jt v = 0,

where row i of Jn is C_iY^T times the velocity of tip i's skin relative to the object at the contact x_i, so
that Jn v is the rate of the indentation Delta r_i, and Jt has the rows along C_iX and C_iZ: X_iq, X_ix,
X_iw and Z_iq, ... of the paper side by side. C_iY points into the object.

A step updates the velocity first (semi-implicit Euler). All damping (B, xi, b) is implicit, which the light
links of Table 3 require. The new velocity satisfies the rolling constraint exactly, so the constraint does
not drift; its residual from the rotation within a step is summed in `slip_m`. A joint at its limit is
constrained in the same way until a torque moves it back.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import mujoco
import numpy as np

from palpate_edge.common.arrays import Array
from palpate_edge.common.errors import ConfigError
from palpate_twin.hand.engine import STEP_S, EngineContact, EngineState, LostGraspError
from palpate_twin.hand.prism import is_on_face, nearest_face
from palpate_twin.hand.twin_model import TwinModel


@dataclass(slots=True)
class Account:
    """Energies since the start: work of the torques u and of the load's force and torque; energy dissipated
    by B, xi, b and the joint limits."""

    work_J: float = 0.0
    dissipated_J: float = 0.0


class RollingHand(EngineState):
    """Engine with rolling contacts; the state is MuJoCo's data, contacts are computed here."""

    def __init__(self, twin: TwinModel, step_s: float = STEP_S) -> None:
        """Start at the twin's start pose; each tip gets the face of the object in front of which it is.

        Raises ConfigError for a disturbance that changes the friction, which rolling contacts do not have.
        """
        if any(one.friction is not None for one in twin.twin.disturbances):
            raise ConfigError(
                "twin.disturbances.friction: the engine eqs has no friction; use the engine mujoco, or leave"
                " friction out"
            )
        super().__init__(twin, step_s)
        self._tips = tips = len(twin.tip_geoms)
        self.normal_force_N = np.zeros(tips)
        self.friction_force_N = np.zeros((tips, 2))
        self.account = Account()
        self.time_s = 0.0
        nv = twin.model.nv
        self._lin = slice(twin.object_v, twin.object_v + 3)
        self._rot = slice(twin.object_v + 3, twin.object_v + 6)
        R, x = self.object_rotation, self.object_position_m
        self._faces = [
            twin.prism.faces[nearest_face(twin.prism, R.T @ (centre - x))] for centre in self._centres()
        ]
        # C_X, C_Y, C_Z of each tip's face in the object's frame, rows; right-handed, C_Y into the object.
        self._C = np.array([[f.tangent, -f.normal, [0.0, 0.0, 1.0]] for f in self._faces])
        self._distance_m = np.array([face.distance_m for face in self._faces])
        self._tip_bodies = [int(twin.model.site_bodyid[site]) for site in twin.tip_sites]
        self._range_rad = twin.range_rad.T.copy()
        self._damping = np.zeros(nv)
        self._damping[twin.v_address] = twin.damping_Nms_rad
        self._M = np.zeros((nv, nv))
        self._bias = np.zeros(nv)
        self._jac_p, self._jac_r = np.zeros((tips, 3, nv)), np.zeros((tips, 3, nv))
        self._weight_N = twin.prism.mass_kg * twin.model.opt.gravity  # carried by the support

    @property
    def object_rotation(self) -> Array:
        return np.array(self.data.xmat[self.twin.object_body].reshape(3, 3))

    @property
    def object_position_m(self) -> Array:
        return np.array(self.data.xpos[self.twin.object_body])

    def remove_support(self) -> None:
        self._weight_N = np.zeros(3)

    def tip_contacts(self) -> tuple[EngineContact | None, ...]:
        """Return the contacts with the forces of the last step."""
        R, x = self.object_rotation, self.object_position_m
        C, contact, indentation = self._indentation()
        for number, (face, point) in enumerate(zip(self._faces, contact, strict=True), 1):
            if not is_on_face(self.twin.prism, face, R.T @ (point - x)):
                raise LostGraspError(
                    f"tip {number} rolled off its face of the object at {self.time_s:.2f} s:"
                    " reduce the turn, or give the object larger faces"
                )
        return tuple(
            EngineContact(contact[i], float(self.normal_force_N[i]), -self.friction_force_N[i] @ C[i, ::2])
            if indentation[i] > 0.0
            else None
            for i in range(self._tips)
        )

    def tip_distances_m(self) -> Array:
        """Return the distance (n,) from each tip's centre to its face: r minus the indentation."""
        return self.twin.tip_radius_m - self._indentation()[2]

    def step(self, torque_Nm: Array) -> None:
        """Advance by one step under the joint torques u (nq,)."""
        twin, data, h = self.twin, self.data, self.step_s
        data.qvel[self._braked] = 0.0
        model, v = twin.model, data.qvel.copy()
        wrench = self._disturb()
        Jn, Jt, Jw, indentation = self._contacts()
        force = self._applied(torque_Nm) + wrench
        M = self._M
        k, xi, b = twin.twin.tip.k_N_m2, twin.twin.tip.xi_Ns_m, twin.twin.tip.b_Nms
        touching, ends = indentation > 0.0, self._ends()
        while True:
            normal, elastic = Jn[touching], k * indentation[touching] ** 2  # Eq. (8)
            constraints = np.concatenate((Jt[touching.repeat(2)], ends))
            rates = np.concatenate((math.sqrt(xi) * normal, math.sqrt(b) * Jw[touching]))
            D = rates.T @ rates  # Eqs. (8), (7)
            D.ravel()[:: len(D) + 1] += self._damping
            new_v, impulse = _solve(M + h * D, M @ v + h * (force - normal.T @ elastic), constraints)
            rolling, stopping = impulse[: 2 * len(normal)], impulse[2 * len(normal) :]
            f = elastic + xi * (normal @ new_v)
            if (f >= 0.0).all() and (stopping >= 0.0).all():
                break
            touching[np.flatnonzero(touching)[f < 0.0]] = False  # contacts do not pull
            ends = ends[stopping >= 0.0]  # neither do joint limits
        self.normal_force_N = np.zeros(self._tips)
        self.normal_force_N[touching] = f
        self.friction_force_N = np.zeros((self._tips, 2))
        self.friction_force_N[touching] = rolling.reshape(-1, 2) / h
        middle = 0.5 * (v + new_v)
        self.account.work_J += h * float(torque_Nm @ middle[twin.v_address] + wrench @ middle)
        self.account.dissipated_J += h * float(new_v @ D @ middle) + float(stopping @ ends @ middle)
        sliding = (Jt @ v).reshape(-1, 2)
        self.slip_m += h * np.hypot(sliding[:, 0], sliding[:, 1]) * touching
        data.qvel[:] = new_v
        mujoco.mj_integratePos(model, data.qpos, new_v, h)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        self.time_s += h

    def energy_J(self) -> float:
        """Return kinetic, elastic (k Delta r^3 / 3) and potential energy; its change is work - dissipated."""
        twin, data = self.twin, self.data
        mujoco.mj_energyPos(twin.model, data)
        mujoco.mj_makeM(twin.model, data)
        mujoco.mj_fullM(twin.model, data, self._M)
        indentation = np.maximum(0.0, self._indentation()[2])
        elastic = twin.twin.tip.k_N_m2 / 3.0 * float(np.sum(indentation**3))
        weight = float(
            self._weight_N @ self.object_position_m
        )  # MuJoCo's energy omits it because of gravcomp
        return 0.5 * float(data.qvel @ self._M @ data.qvel) + elastic + float(data.energy[0]) + weight

    def _centres(self) -> Array:
        return np.asarray(self.data.site_xpos[list(self.twin.tip_sites)])

    def _indentation(self) -> tuple[Array, Array, Array]:
        """Return C (n, 3, 3) in the hand frame, the contact points x_i (n, 3) and Delta r_i (n,)."""
        R, x = self.object_rotation, self.object_position_m
        C = self._C @ R.T
        centre = self._centres()
        gap = -np.vecdot(centre - x, C[:, 1]) - self._distance_m
        return C, centre + gap[:, None] * C[:, 1], self.twin.tip_radius_m - gap

    def _contacts(self) -> tuple[Array, Array, Array, Array]:
        """Return Jn (n, nv), Jt (2 n, nv), Jw (n, nv) of the twist about C_Y, and Delta r (n,)."""
        model, data = self.twin.model, self.data
        C, contact, indentation = self._indentation()
        R, Jp, Jr = self.object_rotation, self._jac_p, self._jac_r
        for i, body in enumerate(self._tip_bodies):
            mujoco.mj_jac(model, data, Jp[i], Jr[i], contact[i], body)
        Jc, normal = C @ Jp, C[:, 1]
        # The object's surface moves with v + w x arm, so the relative velocity has -v and arm x w.
        arm_cross = ((contact - self.object_position_m) @ _CROSS).reshape(-1, 3, 3)
        Jc[:, :, self._lin] = -C
        Jc[:, :, self._rot] = C @ arm_cross @ R
        Jw = np.matmul(normal[:, None], Jr)[:, 0]
        Jw[:, self._rot] = -normal @ R
        return Jc[:, 1], Jc[:, ::2].reshape(2 * self._tips, -1), Jw, indentation

    def _ends(self) -> Array:
        """Return (n, nv), one row per joint at its limit: the row times v is the outward velocity."""
        q_rad, (low, high) = self.q_rad, self._range_rad
        joints = ((q_rad <= low) | (q_rad >= high)).nonzero()[0]
        ends = np.zeros((len(joints), self.twin.model.nv))
        ends[np.arange(len(joints)), self.twin.v_address[joints]] = np.where(q_rad >= high, 1.0, -1.0)[joints]
        return ends

    def _disturb(self) -> Array:
        """Return the load's force and torque on the object (nv,); its added mass goes into the model."""
        before = self._load
        load = self._advance_load(self.time_s)
        wrench = np.zeros(self.twin.model.nv)
        if load is None:
            return wrench
        if load is not before:
            mujoco.mj_comPos(self.twin.model, self.data)  # the inertias of this step
        wrench[self._lin] = load.force_N
        wrench[self._rot] = load.torque_Nm @ self.object_rotation
        return wrench

    def _applied(self, torque_Nm: Array) -> Array:
        """Return u - C v - g (nv,), and set self._M to the full matrix M."""
        twin, data = self.twin, self.data
        mujoco.mj_makeM(twin.model, data)
        mujoco.mj_fullM(twin.model, data, self._M)
        mujoco.mj_comVel(twin.model, data)
        mujoco.mj_rne(twin.model, data, 0, self._bias)
        force = -self._bias
        force[self._lin] -= self._weight_N
        force[twin.v_address] += torque_Nm
        return force


# (3, 9): maps a vector a to its cross-product matrix, flattened, with [a]x b = a x b.
_CROSS = np.cross(np.eye(3)[:, None], np.eye(3)).transpose(0, 2, 1).reshape(3, 9)


def _solve(A: Array, b: Array, J: Array) -> tuple[Array, Array]:
    """Solve A v + J^T mu = b and J v = 0 for v and mu."""
    n, m = len(b), len(J)
    K = np.zeros((n + m, n + m))
    K[:n, :n], K[:n, n:], K[n:, :n] = A, J.T, J
    solution = np.linalg.solve(K, np.concatenate((b, np.zeros(m))))
    return np.asarray(solution[:n]), np.asarray(solution[n:])
