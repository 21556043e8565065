"""Newton's method for the equilibrium of the dome in contact with a probe."""

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

TOLERANCE = 1e-8  # largest residual nodal force, as a fraction of the contact force (plus 1 mm^2 mu)
MOST_ITERATIONS = 20
SHORTENINGS = 5  # largest number of halvings of a Newton step that does not lower the residual
STICK = 1e6  # coefficient of friction that prevents all sliding
LARGEST_UPDATE_MM = 1.0  # longer Newton steps are shortened because they would invert elements


@dataclass(frozen=True, slots=True)
class State:
    """State of the dome.

    displacement_mm: (n, 3) of the nodes; anchor_mm: (q, 3) anchors in the coordinates of the untwisted probe.
    """

    displacement_mm: Array
    anchor_mm: Array


@dataclass(frozen=True, slots=True)
class Equilibrium:
    """A state of equilibrium; contact_force and base_force (3,) act on the meshed part, per mu, in mm^2."""

    state: State
    contact: ProbeContact
    contact_force: Array
    base_force: Array
    iterations: int


@dataclass(frozen=True, slots=True)
class _Forces:
    """Nodal forces (3 n,) of contact and solid, and the residual on the free components."""

    contact: ProbeContact
    external: Array
    internal: Array
    residual: Array


class ElasticDome:
    """Mechanical model of the dome: mesh, silicone, outer surface and friction. It has no state."""

    def __init__(
        self,
        mesh: DomeMesh,
        poisson_ratio: float = POISSON_RATIO,
        friction: float = FRICTION,
        relative: Array | None = None,
    ) -> None:
        """relative (m,): modulus of each element relative to mu, 1 if not given."""
        self.mesh = mesh
        self.friction = friction
        self.poisson_ratio = poisson_ratio
        self.surface: Surface = outer_surface(mesh)
        self._solid = Solid(mesh.points_mm, mesh.cells, poisson_ratio, relative)
        fixed = np.zeros((len(mesh.points_mm), 3), dtype=bool)
        fixed[mesh.base] = True
        fixed[mesh.mirror, 1] = True
        self._free = np.flatnonzero(~fixed.ravel())

    @property
    def unknowns(self) -> int:
        """Number of free displacement components."""
        return len(self._free)

    def at_rest(self) -> State:
        """Return the undeformed state without contact."""
        return State(np.zeros_like(self.mesh.points_mm), no_anchor(len(self.surface.area_mm2)))

    def balance(self, state: State, pose: ProbePose) -> Equilibrium | None:
        """Return the equilibrium for a probe pose, starting from a nearby state.

        None if Newton's method does not converge, because the step from the last pose is too long.
        """
        # Sliding points have no stiffness along the plate, so all points stick in the first step.
        moved = state.displacement_mm
        moved = moved + self._newton_step(moved, self._forces(moved, state, pose, STICK))
        at = self._forces(moved, state, pose, self.friction)
        for iteration in range(1, MOST_ITERATIONS):
            if not np.isfinite(at.residual).all():
                return None
            force = at.external.reshape(-1, 3).sum(axis=0)
            if np.abs(at.residual).max() <= TOLERANCE * (1 + np.linalg.norm(force)):
                reached = State(moved, at.contact.anchor_mm @ pose.turn)
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
        """Return internal and contact forces at a displacement, with the anchors of the last state."""
        surface = self.surface
        points = surface.points_mm + (surface.to_points @ displacement.ravel()).reshape(-1, 3)
        anchor_mm = state.anchor_mm @ pose.turn.T
        tractions = contact(pose.probe, pose.outward, points - pose.at_mm, anchor_mm, friction)
        external = surface.to_points.T @ (surface.area_mm2[:, None] * tractions.traction).ravel()
        internal = self._solid.forces(displacement)
        return _Forces(tractions, external, internal, (internal - external)[self._free])

    def _newton_step(self, displacement: Array, at: _Forces) -> Array:
        surface, tractions = self.surface, at.contact
        blocks = surface.area_mm2[:, None, None] * tractions.derivative
        near = np.flatnonzero(tractions.pressure > 0)
        rows = (3 * near[:, None] + np.arange(3)).ravel()
        to_near = surface.to_points[rows]
        block = sparse.bsr_matrix(
            (blocks[near], np.arange(len(near)), np.arange(len(near) + 1)), shape=(len(rows), len(rows))
        )
        stiffness = self._solid.stiffness(displacement) - to_near.T @ block @ to_near
        free = stiffness.tocsr()[self._free][:, self._free].tocsc()
        # Nearly symmetric and diagonally dominant: pivots stay on the diagonal, so the ordering holds.
        factors = splu(
            free, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.01, options={"SymmetricMode": True}
        )
        update = np.zeros(displacement.size)
        update[self._free] = -factors.solve(at.residual)
        update *= min(1.0, LARGEST_UPDATE_MM / (np.abs(update).max() + 1e-300))
        return update.reshape(displacement.shape)

    def _reaction(self, at: _Forces) -> Array:
        """Return the force (3,) of the base on the dome, which acts on the fixed base nodes."""
        return np.asarray((at.internal - at.external).reshape(-1, 3)[self.mesh.base].sum(axis=0))
