"""Newton's method for the dome in contact with a probe at one place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from palpate_edge.common.arrays import Array
from palpate_twin.dome.elasticity import POISSON_RATIO, Solid
from palpate_twin.dome.friction_contact import FRICTION, ProbeContact, contact, no_anchor
from palpate_twin.dome.mesh import DomeMesh
from palpate_twin.dome.probe import ProbePose
from palpate_twin.dome.surface import Surface, outer_surface

TOLERANCE = 1e-8  # largest out-of-balance nodal force, in parts of the contact force (plus 1 mm^2 mu)
MOST_ITERATIONS = 20
SHORTENINGS = 5  # tries of a Newton step, each half as long, until it lowers the residual
STICK = 1e6  # a coefficient of friction that nothing overcomes
LARGEST_UPDATE_MM = 1.0  # a longer Newton step is cut: it would turn elements inside out


@dataclass(frozen=True, slots=True)
class State:
    """displacement_mm (n, 3) of the nodes; anchor_mm (q, 3): where the surface holds on to the probe."""

    displacement_mm: Array
    anchor_mm: Array


@dataclass(frozen=True, slots=True)
class Equilibrium:
    """A state in balance; contact_force and base_force (3,), both on the meshed part, per mu, mm^2."""

    state: State
    contact: ProbeContact
    contact_force: Array
    base_force: Array
    iterations: int


@dataclass(frozen=True, slots=True)
class _Forces:
    """Nodal forces (3 n,): pushed by the contact, internal of the solid; residual on the free components."""

    contact: ProbeContact
    pushed: Array
    internal: Array
    residual: Array


class ElasticDome:
    """The dome ready for pressing: mesh, silicone, outer surface and friction. Holds no state of a press."""

    def __init__(
        self, mesh: DomeMesh, poisson_ratio: float = POISSON_RATIO, friction: float = FRICTION
    ) -> None:
        self.mesh = mesh
        self.friction = friction
        self.poisson_ratio = poisson_ratio
        self.surface: Surface = outer_surface(mesh)
        self._solid = Solid(mesh.points_mm, mesh.cells, poisson_ratio)
        fixed = np.zeros((len(mesh.points_mm), 3), dtype=bool)
        fixed[mesh.rim] = True
        fixed[mesh.mirror, 1] = True
        self._free = np.flatnonzero(~fixed.ravel())

    @property
    def unknowns(self) -> int:
        """Displacement components that nothing fixes."""
        return len(self._free)

    def at_rest(self) -> State:
        """Nothing touches."""
        return State(np.zeros_like(self.mesh.points_mm), no_anchor(len(self.surface.area_mm2)))

    def balance(self, state: State, pose: ProbePose) -> Equilibrium | None:
        """The equilibrium with the probe at a pose, from a state near it; None where Newton's method does not
        get there: the way from the last pose was too long.
        """
        # A sliding point has no stiffness along the plate, so the first step takes all to stick.
        moved = state.displacement_mm
        moved = moved + self._newton_step(moved, self._forces(moved, state, pose, STICK))
        at = self._forces(moved, state, pose, self.friction)
        for iteration in range(1, MOST_ITERATIONS):
            if not np.isfinite(at.residual).all():
                return None
            force = at.pushed.reshape(-1, 3).sum(axis=0)
            if np.abs(at.residual).max() <= TOLERANCE * (1 + np.linalg.norm(force)):
                reached = State(moved, at.contact.anchor_mm)
                return Equilibrium(reached, at.contact, force, self._reaction(at), iteration)
            update, size = self._newton_step(moved, at), np.linalg.norm(at.residual)
            for shortening in range(SHORTENINGS):
                ahead = moved + update / 2**shortening
                at = self._forces(ahead, state, pose, self.friction)
                if np.linalg.norm(at.residual) < size:
                    break
            moved = ahead
        return None

    def _forces(self, displacement: Array, state: State, pose: ProbePose, friction: float) -> _Forces:
        """Internal and contact forces on the nodes at a displacement, with the anchors of the last state."""
        surface = self.surface
        points = surface.points_mm + (surface.to_points @ displacement.ravel()).reshape(-1, 3)
        touch = contact(pose.probe, pose.outward, points - pose.at_mm, state.anchor_mm, friction)
        pushed = surface.to_points.T @ (surface.area_mm2[:, None] * touch.traction).ravel()
        internal = self._solid.forces(displacement)
        return _Forces(touch, pushed, internal, (internal - pushed)[self._free])

    def _newton_step(self, displacement: Array, at: _Forces) -> Array:
        surface, touch = self.surface, at.contact
        blocks = surface.area_mm2[:, None, None] * touch.derivative
        near = np.flatnonzero(touch.pressure > 0)
        rows = (3 * near[:, None] + np.arange(3)).ravel()
        to_near = surface.to_points[rows]
        block = sparse.bsr_matrix(
            (blocks[near], np.arange(len(near)), np.arange(len(near) + 1)), shape=(len(rows), len(rows))
        )
        stiffness = self._solid.stiffness(displacement) - to_near.T @ block @ to_near
        free = stiffness.tocsr()[self._free][:, self._free].tocsc()
        # Nearly symmetric and diagonally strong: pivots stay on the diagonal, so the ordering holds.
        factors = splu(
            free, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.01, options={"SymmetricMode": True}
        )
        update = np.zeros(displacement.size)
        update[self._free] = -factors.solve(at.residual)
        update *= min(1.0, LARGEST_UPDATE_MM / (np.abs(update).max() + 1e-300))
        return update.reshape(displacement.shape)

    def _reaction(self, at: _Forces) -> Array:
        """Force of the base on the dome: what the fixed rim holds, (3,)."""
        return np.asarray((at.internal - at.pushed).reshape(-1, 3)[self.mesh.rim].sum(axis=0))
