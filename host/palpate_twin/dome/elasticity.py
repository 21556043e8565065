"""The silicone: a nearly incompressible neo-Hookean solid on the dome's mesh.

The shear modulus is 1, so stresses and forces are per mu; Poisson's ratio gives the bulk modulus. The energy
is (J^(-2/3) tr(F^T F) - 3) / 2 + K (J - 1)^2 / 2. The elements are 20-node hexahedra with 2x2x2 integration
points, which do not lock in bending and, at this ratio of the moduli, not in volume (Zienkiewicz, Taylor and
Too, 1971).
"""

from __future__ import annotations

from itertools import product

import numpy as np
from scipy import sparse

from palpate_edge.common.arrays import Array, Indices
from palpate_twin.dome import hexahedron

POISSON_RATIO = 0.49
GAUSS_POINTS = np.array(list(product((-1.0, 1.0), repeat=3))) / np.sqrt(3.0)
EYE = np.eye(3)


def bulk_per_mu(poisson_ratio: float) -> float:
    """Return K / mu of linear elasticity."""
    return 2 * (1 + poisson_ratio) / (3 * (1 - 2 * poisson_ratio))


class Solid:
    """Internal forces and stiffness of 20-node hexahedra at a displacement. It has no state.

    points_mm (n, 3); cells (m, 20), nodes as in `mesh.HEXAHEDRON20`; relative (m,): modulus of each element
    relative to mu, 1 if not given.
    """

    def __init__(
        self,
        points_mm: Array,
        cells: Indices,
        poisson_ratio: float = POISSON_RATIO,
        relative: Array | None = None,
    ) -> None:
        self._bulk = bulk_per_mu(poisson_ratio)
        self._cells = cells
        self._size = 3 * len(points_mm)
        by_natural = hexahedron.slope(GAUSS_POINTS)
        jacobian = np.einsum("mai,qaj->mqij", points_mm[cells], by_natural)
        self._volume = np.linalg.det(jacobian)  # (m, q), each Gauss weight is 1; times the relative modulus
        if relative is not None:
            self._volume *= relative[:, None]
        self._slope = np.einsum("qaj,mqjk->mqak", by_natural, np.linalg.inv(jacobian))  # dN/dX, 1/mm
        unknowns = (3 * cells[:, :, None] + np.arange(3)).reshape(len(cells), -1)
        self._rows = np.repeat(unknowns, unknowns.shape[1], axis=1).ravel()
        self._columns = np.tile(unknowns, (1, unknowns.shape[1])).ravel()
        self._unknowns = unknowns.ravel()

    def forces(self, displacement_mm: Array) -> Array:
        """Return the nodal forces (3 n,) that hold a displacement (n, 3) in mm, per mu, in mm^2."""
        stress = self._stress(_Strain(self._gradient(displacement_mm)))
        nodal = np.einsum("mqij,mqaj,mq->mai", stress, self._slope, self._volume, optimize=True)
        return np.asarray(np.bincount(self._unknowns, nodal.ravel(), self._size), dtype=np.float64)

    def stiffness(self, displacement_mm: Array) -> sparse.csr_matrix:
        """Return the derivative (3 n, 3 n) of :meth:`forces` at a displacement (n, 3), per mu, in mm."""
        tangent = self._tangent(_Strain(self._gradient(displacement_mm)))
        weighted = tangent * self._volume[:, :, None, None, None, None]
        half = np.einsum("mqijkl,mqbl->mqijbk", weighted, self._slope, optimize=True)
        element = np.einsum("mqaj,mqijbk->maibk", self._slope, half, optimize=True)
        entries = (element.ravel(), (self._rows, self._columns))
        return sparse.csr_matrix(entries, shape=(self._size, self._size))

    def _gradient(self, displacement_mm: Array) -> Array:
        """Return the deformation gradients F (m, q, 3, 3)."""
        moved = displacement_mm[self._cells]
        return np.asarray(EYE + np.einsum("mai,mqaj->mqij", moved, self._slope, optimize=True))

    def _stress(self, strain: _Strain) -> Array:
        """Return the first Piola-Kirchhoff stress (m, q, 3, 3), per mu."""
        F, G, J = strain.F, strain.G, strain.J
        return _scaled(F - _scaled(G, strain.square / 3), strain.isochoric) + _scaled(
            G, self._bulk * (J - 1) * J
        )

    def _tangent(self, strain: _Strain) -> Array:
        """Return the derivative (m, q, 3, 3, 3, 3) of the stress by F, per mu."""
        F, G, J = strain.F, strain.G, strain.J
        GG = np.einsum("mqij,mqkl->mqijkl", G, G)
        crossed = np.einsum("mqil,mqkj->mqijkl", G, G)
        FG = np.einsum("mqij,mqkl->mqijkl", F, G)
        identity = np.einsum("ik,jl->ijkl", EYE, EYE)
        mixed = FG + FG.transpose(0, 1, 4, 5, 2, 3)
        shear = _scaled(
            identity - 2 / 3 * mixed + _scaled(2 / 9 * GG + crossed / 3, strain.square), strain.isochoric
        )
        return shear + self._bulk * (_scaled(GG, (2 * J - 1) * J) - _scaled(crossed, (J - 1) * J))


class _Strain:
    """Deformation gradient F (m, q, 3, 3) with J = det F, G = F^-T, tr(F^T F) and J^(-2/3).

    J^(-2/3) of an inverted element is NaN, which propagates to forces and stiffness.
    """

    def __init__(self, F: Array) -> None:
        self.F = F
        self.J = np.linalg.det(F)
        whole = self.J > 0
        self.G = np.swapaxes(np.linalg.inv(np.where(whole[..., None, None], F, EYE)), -1, -2)
        self.square = (F**2).sum(axis=(-2, -1))
        self.isochoric = np.where(whole, self.J, np.nan) ** (-2 / 3)


def _scaled(tensor: Array, factor: Array) -> Array:
    """Return tensor (m, q, ...) times factor (m, q)."""
    return np.asarray(tensor * factor.reshape(factor.shape + (1,) * (tensor.ndim - 2)))
