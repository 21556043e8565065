"""The silicone: a nearly incompressible neo-Hookean solid on the dome's mesh, assembled by FElupe.

The shear modulus is 1, so that stresses and forces are per mu; Poisson's ratio gives the bulk modulus.
20-node hexahedra with 2x2x2 integration points: the element that neither locks in bending nor, at this ratio
of the moduli, in volume (Zienkiewicz, Taylor and Too, 1971).
"""

from __future__ import annotations

import felupe
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

POISSON_RATIO = 0.49


def bulk_per_mu(poisson_ratio: float) -> float:
    """K / mu of linear elasticity."""
    return 2 * (1 + poisson_ratio) / (3 * (1 - 2 * poisson_ratio))


class Solid:
    """Internal forces and stiffness of 20-node hexahedra at a displacement; keeps no state between calls.

    points_mm (n, 3); cells (m, 20), FElupe's order.
    """

    def __init__(self, points_mm: Array, cells: Indices, poisson_ratio: float = POISSON_RATIO) -> None:
        mesh = felupe.Mesh(points_mm, cells, "hexahedron20")
        reduced = felupe.GaussLegendre(order=1, dim=3)
        region = felupe.RegionQuadraticHexahedron(mesh, quadrature=reduced)
        self._field = felupe.FieldContainer([felupe.Field(region, dim=3)])
        material = felupe.NeoHooke(mu=1.0, bulk=bulk_per_mu(poisson_ratio))
        self._body = felupe.SolidBody(material, self._field)

    def forces(self, displacement_mm: Array) -> Array:
        """(n, 3) mm -> nodal forces (3 n,) that hold it, per mu, mm^2."""
        self._field[0].values[:] = displacement_mm
        with np.errstate(invalid="ignore"):  # an element turned inside out gives nan, which the caller sees
            return np.asarray(self._body.assemble.vector(self._field).toarray()).ravel()

    def stiffness(self, displacement_mm: Array) -> sparse.csr_matrix:
        """(n, 3) mm -> derivative of :meth:`forces`, (3 n, 3 n), per mu, mm."""
        self._field[0].values[:] = displacement_mm
        return sparse.csr_matrix(self._body.assemble.matrix(self._field))
