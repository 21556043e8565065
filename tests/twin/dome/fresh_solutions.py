"""Presses between the points of the library's grid, solved by finite elements, to test the interpolation.

Solving takes two minutes per probe, so the solutions are stored in fresh_solutions.npz with a digest of the
solver's code. If the code has changed, the tests solve again.
`python -m tests.twin.dome.fresh_solutions` writes the file.
"""

from __future__ import annotations

import ast
import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_twin.dome import field_grid, library
from palpate_twin.dome.library import load_library
from palpate_twin.dome.make_library import Domes
from palpate_twin.dome.mesh import Resolution
from palpate_twin.dome.press import press_path
from palpate_twin.dome.probe import Probe

KEPT = Path(__file__).with_suffix(".npz")
CASES = ((12.0, 0.45, (0.1, 0.15)), (33.0, 0.85, (-0.2, 0.2)), (57.0, 0.6, (0.25, 0.0)))
"""Contact angle in deg, fraction of the largest depth, slide as a fraction of the depth."""
SOLVER = (
    *("elasticity", "equilibrium", "field_grid", "friction_contact", "hexahedron", "make_library"),
    *("mesh", "press", "probe", "sampling", "surface"),
)


@dataclass(frozen=True)
class Solution:
    """One press: displacement_mm (d, 3) of BEAD_RADIUS_MM * directions(), force_per_mu_mm2 (3,)."""

    contact_rad: float
    depth_mm: float
    shear_mm: tuple[float, float]
    displacement_mm: Array
    force_per_mu_mm2: Array


def directions() -> Array:
    """Return unit vectors (80, 3) in F that differ from the library's."""
    rng = np.random.default_rng(11)
    theta, phi = np.arccos(rng.uniform(0.2, 1, 80)), rng.uniform(0, 2 * np.pi, 80)
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=1)


def solutions(probe: Probe) -> list[Solution]:
    """Return the solutions of CASES: the stored ones, or new ones if the solver's code has changed."""
    with np.load(KEPT) as file:
        if str(file["digest"]) == _digest():
            fields = file[f"{probe.label} displacement_mm"], file[f"{probe.label} force_per_mu_mm2"]
            return [Solution(*press, *one) for press, *one in zip(_presses(probe), *fields, strict=True)]
    return solve(probe)


def solve(probe: Probe) -> list[Solution]:
    """Solve CASES in their order."""
    with np.load(library.SHIPPED) as file:
        resolution = Resolution(*(int(count) for count in file["resolution"]))
    domes = Domes(30.0, 5.0, resolution, field_grid.BEAD_RADIUS_MM * directions())
    solved = []
    for contact_rad, depth_mm, shear_mm in _presses(probe):
        *_, pressed = press_path(domes.half, contact_rad, [(depth_mm, (0.0, 0.0))], probe)
        *_, slid = press_path(domes.whole, contact_rad, [(depth_mm, shear_mm)], probe, domes.unfold(pressed))
        field_mm = domes.sample_whole(slid.displacement_mm)
        solved.append(Solution(contact_rad, depth_mm, shear_mm, field_mm, slid.force_per_mu_mm2))
    return solved


def _presses(probe: Probe) -> list[tuple[float, float, tuple[float, float]]]:
    presses = []
    for theta_deg, depth_share, slide in CASES:
        contact_rad = float(np.radians(theta_deg))
        depth_mm = depth_share * float(field_grid.largest_depth_mm(contact_rad, probe))
        presses.append((contact_rad, depth_mm, (slide[0] * depth_mm, slide[1] * depth_mm)))
    return presses


def _digest() -> str:
    """Return a digest of the solver's code (imports and docstrings aside), of the mesh and of the cases."""
    content = repr(CASES).encode() + directions().tobytes()
    folder = Path(library.__file__).parent
    content += b"".join(
        _code((folder / f"{name}.py").read_text(encoding="utf-8")).encode() for name in SOLVER
    )
    with np.load(library.SHIPPED) as file:
        content += file["resolution"].tobytes()
    return hashlib.sha256(content).hexdigest()


def _code(source: str) -> str:
    """Return what a module does, free of comments, layout, imports and docstrings."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)):
            node.body = [part for part in node.body if not _says_nothing(part)]
    return ast.dump(tree)


def _says_nothing(part: ast.stmt) -> bool:
    is_text = isinstance(part, ast.Expr) and isinstance(part.value, ast.Constant)
    return is_text or isinstance(part, (ast.Import, ast.ImportFrom))


def main() -> None:
    kept = {}
    for probe in load_library().probes:
        solved = solve(probe)
        kept[f"{probe.label} displacement_mm"] = np.array([one.displacement_mm for one in solved])
        kept[f"{probe.label} force_per_mu_mm2"] = np.array([one.force_per_mu_mm2 for one in solved])
    np.savez_compressed(KEPT, digest=_digest(), **kept)


if __name__ == "__main__":
    main()
