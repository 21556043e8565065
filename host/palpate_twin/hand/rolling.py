"""Engine one: the paper's hand and object, Eqs. (4)-(8), with tips that roll and never slip.

M, C and g of hand and object come from MuJoCo; contact is the paper's. In the velocities v of joints and
object Eqs. (4)-(6) are one equation,

    M v' + C v + g + Jn^T f + Jt^T lambda + dT/dv = u,        Jt v = 0,

where row i of Jn is C_iY^T times the velocity of tip i's skin relative to the object at the contact x_i, so
that Jn v is the rate of the indentation Delta r_i, and Jt has the rows along C_iX and C_iZ: X_iq, X_ix,
X_iw and Z_iq, ... of the paper side by side. C_iY points into the object.

A step takes the velocity first (semi-implicit Euler) with all damping (B, xi, b) implicit, which the light
links of Table 3 need, and puts the new velocity exactly on the rolling constraint; so the constraint cannot
drift away, and what turning within a step leaves of it is summed in `slip_m`. A joint at an end of its range
stands in the same way, until something pulls it back.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import mujoco
import numpy as np
import numpy.typing as npt

from palpate_edge.common.arrays import Array
from palpate_twin.hand.engine import BRAKE_KGM2, STEP_S, LostGraspError, TipTouch
from palpate_twin.hand.prism import is_on_face, nearest_face
from palpate_twin.hand.twin_model import TwinModel


@dataclass(slots=True)
class Account:
    """Energies since the start: the work of the torques u; what B, xi, b and the ends of the ranges took."""

    work_J: float = 0.0
    dissipated_J: float = 0.0


class RollingHand:
    """Hand and object; `step` moves them on. The state is MuJoCo's data, contact is computed here."""

    def __init__(self, twin: TwinModel, step_s: float = STEP_S) -> None:
        """Starts at the twin's start pose, each tip on the face of the object that it is in front of."""
        self.twin, self.step_s = twin, step_s
        self.data = twin.start()
        self.normal_force_N = np.zeros(3)
        self.friction_force_N = np.zeros((3, 2))
        self.account = Account()
        self.slip_m = np.zeros(3)
        self._braked = twin.v_address[:0]
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
        self._jac_p, self._jac_r = np.zeros((3, 3, nv)), np.zeros((3, 3, nv))
        self._weight_N = twin.prism.mass_kg * twin.model.opt.gravity  # what the support takes

    @property
    def q_rad(self) -> Array:
        return np.asarray(self.data.qpos[self.twin.q_address])

    @property
    def qdot_rad_s(self) -> Array:
        return np.asarray(self.data.qvel[self.twin.v_address])

    @property
    def object_rotation(self) -> Array:
        return np.array(self.data.xmat[self.twin.object_body].reshape(3, 3))

    @property
    def object_position_m(self) -> Array:
        return np.array(self.data.xpos[self.twin.object_body])

    def brake(self, is_braked: npt.NDArray[np.bool_]) -> None:
        twin = self.twin
        self._braked = twin.v_address[is_braked]
        twin.model.dof_armature[twin.v_address] = twin.twin.armature_kgm2 + BRAKE_KGM2 * is_braked

    def take_support_away(self) -> None:
        self._weight_N = np.zeros(3)

    def touches(self) -> tuple[TipTouch | None, ...]:
        """Forces are those of the last step."""
        R, x = self.object_rotation, self.object_position_m
        C, contact, indentation = self._indentation()
        for number, (face, point) in enumerate(zip(self._faces, contact, strict=True), 1):
            if not is_on_face(self.twin.prism, face, R.T @ (point - x)):
                raise LostGraspError(
                    f"tip {number} has rolled off its face of the object at {self.time_s:.2f} s:"
                    " turn less, or give the object larger faces"
                )
        return tuple(
            TipTouch(contact[i], float(self.normal_force_N[i]), -self.friction_force_N[i] @ C[i, ::2])
            if indentation[i] > 0.0
            else None
            for i in range(3)
        )

    def tip_distances_m(self) -> Array:
        """(3,) from each tip's centre to its face: r less the indentation."""
        return self.twin.tip_radius_m - self._indentation()[2]

    def step(self, torque_Nm: Array) -> None:
        """Move on by one step under the joint torques u (nq,)."""
        twin, data, h = self.twin, self.data, self.step_s
        data.qvel[self._braked] = 0.0
        model, v = twin.model, data.qvel.copy()
        Jn, Jt, Jw, indentation = self._contacts()
        force = self._applied(torque_Nm)
        M = self._M
        k, xi, b = twin.twin.tip.k_N_m2, twin.twin.tip.xi_Ns_m, twin.twin.tip.b_Nms
        touching, ends = indentation > 0.0, self._ends()
        while True:
            normal, elastic = Jn[touching], k * indentation[touching] ** 2  # Eq. (8)
            held = np.concatenate((Jt[touching.repeat(2)], ends))
            rates = np.concatenate((math.sqrt(xi) * normal, math.sqrt(b) * Jw[touching]))
            D = rates.T @ rates  # Eqs. (8), (7)
            D.ravel()[:: len(D) + 1] += self._damping
            new_v, impulse = _solve(M + h * D, M @ v + h * (force - normal.T @ elastic), held)
            rolling, stopping = impulse[: 2 * len(normal)], impulse[2 * len(normal) :]
            f = elastic + xi * (normal @ new_v)
            if (f >= 0.0).all() and (stopping >= 0.0).all():
                break
            touching[np.flatnonzero(touching)[f < 0.0]] = False  # a skin that retracts does not pull
            ends = ends[stopping >= 0.0]  # nor does the end of a range
        self.normal_force_N = np.zeros(3)
        self.normal_force_N[touching] = f
        self.friction_force_N = np.zeros((3, 2))
        self.friction_force_N[touching] = rolling.reshape(-1, 2) / h
        middle = 0.5 * (v + new_v)
        self.account.work_J += h * float(torque_Nm @ middle[twin.v_address])
        self.account.dissipated_J += h * float(new_v @ D @ middle) + float(stopping @ ends @ middle)
        sliding = (Jt @ v).reshape(3, 2)
        self.slip_m += h * np.hypot(sliding[:, 0], sliding[:, 1]) * touching
        data.qvel[:] = new_v
        mujoco.mj_integratePos(model, data.qpos, new_v, h)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        self.time_s += h

    def energy_J(self) -> float:
        """Kinetic, elastic (k Delta r^3 / 3) and gravity's; its change is work - dissipated."""
        twin, data = self.twin, self.data
        mujoco.mj_energyPos(twin.model, data)
        mujoco.mj_makeM(twin.model, data)
        mujoco.mj_fullM(twin.model, data, self._M)
        indentation = np.maximum(0.0, self._indentation()[2])
        elastic = twin.twin.tip.k_N_m2 / 3.0 * float(np.sum(indentation**3))
        weight = float(self._weight_N @ self.object_position_m)  # gravcomp: the object has none
        return 0.5 * float(data.qvel @ self._M @ data.qvel) + elastic + float(data.energy[0]) + weight

    def _centres(self) -> Array:
        return np.asarray(self.data.site_xpos[list(self.twin.tip_sites)])

    def _indentation(self) -> tuple[Array, Array, Array]:
        """C (3, 3, 3) in the hand's frame, the contacts x_i (3, 3), Delta r_i (3,)."""
        R, x = self.object_rotation, self.object_position_m
        C = self._C @ R.T
        centre = self._centres()
        gap = -np.vecdot(centre - x, C[:, 1]) - self._distance_m
        return C, centre + gap[:, None] * C[:, 1], self.twin.tip_radius_m - gap

    def _contacts(self) -> tuple[Array, Array, Array, Array]:
        """Jn (3, nv), Jt (6, nv), Jw (3, nv) of the twist about C_Y, and Delta r (3,)."""
        model, data = self.twin.model, self.data
        C, contact, indentation = self._indentation()
        R, Jp, Jr = self.object_rotation, self._jac_p, self._jac_r
        for i, body in enumerate(self._tip_bodies):
            mujoco.mj_jac(model, data, Jp[i], Jr[i], contact[i], body)
        Jc, normal = C @ Jp, C[:, 1]
        # The object's skin moves with v + w x arm, so the relative velocity has -v and arm x w.
        arm_cross = ((contact - self.object_position_m) @ _CROSS).reshape(3, 3, 3)
        Jc[:, :, self._lin] = -C
        Jc[:, :, self._rot] = C @ arm_cross @ R
        Jw = np.matmul(normal[:, None], Jr)[:, 0]
        Jw[:, self._rot] = -normal @ R
        return Jc[:, 1], Jc[:, ::2].reshape(6, -1), Jw, indentation

    def _ends(self) -> Array:
        """(n, nv), a row for each joint at an end of its range: the row times v is its speed outwards."""
        q_rad, (low, high) = self.q_rad, self._range_rad
        joints = ((q_rad <= low) | (q_rad >= high)).nonzero()[0]
        ends = np.zeros((len(joints), self.twin.model.nv))
        ends[np.arange(len(joints)), self.twin.v_address[joints]] = np.where(q_rad >= high, 1.0, -1.0)[joints]
        return ends

    def _applied(self, torque_Nm: Array) -> Array:
        """u - C v - g (nv,), and M as a whole matrix in self._M."""
        twin, data = self.twin, self.data
        mujoco.mj_makeM(twin.model, data)
        mujoco.mj_fullM(twin.model, data, self._M)
        mujoco.mj_comVel(twin.model, data)
        mujoco.mj_rne(twin.model, data, 0, self._bias)
        force = -self._bias
        force[self._lin] -= self._weight_N
        force[twin.v_address] += torque_Nm
        return force


# (3, 9), a row each for x, y and z of a vector a: what it puts into the matrix that makes a x b of b.
_CROSS = np.cross(np.eye(3)[:, None], np.eye(3)).transpose(0, 2, 1).reshape(3, 9)


def _solve(A: Array, b: Array, J: Array) -> tuple[Array, Array]:
    """v and mu with A v + J^T mu = b and J v = 0."""
    n, m = len(b), len(J)
    K = np.zeros((n + m, n + m))
    K[:n, :n], K[:n, n:], K[n:, :n] = A, J.T, J
    solution = np.linalg.solve(K, np.concatenate((b, np.zeros(m))))
    return np.asarray(solution[:n]), np.asarray(solution[n:])
