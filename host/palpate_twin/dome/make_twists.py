"""Solve all twists of the twist library and write its file.

The file (.npz), for p probes, a contact angles of THETA_DEG, l depths of TWISTED, t twists of TWIST_SHARES:
  probe (p,)                              numbers of :class:`Probe`
  theta_rad (a,)
  displacement_mm (p, a, l, t, d, 3)      float16: with the twist less without it, on the bead sphere, in F
  force_per_mu_mm2 (p, a, l, t, 3)        the same difference of the force on the dome
  torsion_per_mu_mm3 (p, a, l, t)         about the inward normal through the point of first touch
  slide_torsion (p, a, l, s)              the same of the s slides of SHEAR_SHARES towards +y, without twist
  dome (2,), resolution (3,)              outer radius and wall, mm; elements as in :mod:`make_library`
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_edge.common.atomic_write import atomic_file
from palpate_edge.common.errors import ConfigError
from palpate_twin.dome import field_grid as grid
from palpate_twin.dome.make_library import Domes
from palpate_twin.dome.mesh import Resolution
from palpate_twin.dome.press import NO_SHEAR, press_path, twist_path
from palpate_twin.dome.probe import Probe
from palpate_twin.dome.twist_library import TWIST_SHARES, TWISTED, contact_radius_mm


@dataclass(frozen=True, slots=True)
class AngleTwists:
    """Twists of one probe at one contact angle; shapes as in the file, without its first two axes."""

    displacement_mm: Array
    force_per_mu_mm2: Array
    torsion_per_mu_mm3: Array
    slide_torsion: Array


def solve_twists(
    domes: Domes, theta_rad: float, probe: Probe, after_depth: Callable[[], None]
) -> AngleTwists:
    """Solve all twists and slides of one contact angle; `after_depth` is called after each depth."""
    radius_mm = domes.half.mesh.outer_radius_mm
    deepest_mm = float(grid.largest_depth_mm(theta_rad, probe, radius_mm))
    depths_mm = [float(share * deepest_mm) for share in grid.DEPTH_SHARES[list(TWISTED)]]
    moved, forces, torsions, of_slides = [], [], [], []
    stops = [(depth, NO_SHEAR) for depth in depths_mm]
    for depth_mm, half in zip(depths_mm, press_path(domes.half, theta_rad, stops, probe), strict=True):
        start = domes.unfold(half)
        arc_mm = depth_mm * TWIST_SHARES
        twists_rad = (arc_mm / contact_radius_mm(probe, depth_mm, radius_mm)).tolist()
        twisted = list(twist_path(domes.whole, start, twists_rad))
        moved.append([domes.sample_whole(t.displacement_mm - start.displacement_mm) for t in twisted])
        forces.append([t.force_per_mu_mm2 - start.force_per_mu_mm2 for t in twisted])
        torsions.append([t.torsion_per_mu_mm3 for t in twisted])
        slides = [(depth_mm, (0.0, float(share * depth_mm))) for share in grid.SHEAR_SHARES]
        slid = press_path(domes.whole, theta_rad, slides, probe, start)
        of_slides.append([pressed.torsion_per_mu_mm3 for pressed in slid])
        after_depth()
    return AngleTwists(*(np.array(part) for part in (moved, forces, torsions, of_slides)))


def write_twists(
    path: Path, probes: Sequence[Probe], rows: list[AngleTwists], domes: Domes, resolution: Resolution
) -> None:
    """Write the rows, by probe and then by contact angle; an existing file is replaced.

    Raises ConfigError if the folder is not writable.
    """
    mesh = domes.half.mesh

    def table(name: str, kind: type[np.floating]) -> Array:
        values = np.array([getattr(row, name) for row in rows], dtype=kind)
        return values.reshape(len(probes), len(grid.THETA_DEG), *values.shape[1:])

    with atomic_file(path, ConfigError) as file:
        np.savez_compressed(
            file,
            probe=np.array(probes, dtype=np.uint8),
            theta_rad=np.radians(grid.THETA_DEG).astype(np.float32),
            displacement_mm=table("displacement_mm", np.float16),
            force_per_mu_mm2=table("force_per_mu_mm2", np.float32),
            torsion_per_mu_mm3=table("torsion_per_mu_mm3", np.float32),
            slide_torsion=table("slide_torsion", np.float32),
            dome=np.array([mesh.outer_radius_mm, mesh.wall_mm], dtype=np.float32),
            resolution=np.array([resolution.cap, resolution.side, resolution.wall], dtype=np.uint8),
        )
