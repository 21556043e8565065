"""The twist library: the packaged file, its interpolation, and rejected requests."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from palpate_edge.common.errors import ConfigError
from palpate_twin.dome import field_grid as grid
from palpate_twin.dome.library import FieldLibrary, load_library
from palpate_twin.dome.make_library import Domes
from palpate_twin.dome.make_twists import solve_twists, write_twists
from palpate_twin.dome.mesh import Resolution
from palpate_twin.dome.press import press_path, twist_path
from palpate_twin.dome.probe import Probe
from palpate_twin.dome.twist_library import SHIPPED, TWIST_SHARES, TWISTED, contact_radius_mm, load_twists

MIRROR = np.array([1.0, -1.0, 1.0])
EVERYWHERE = grid.ring_directions()


@pytest.fixture(scope="module")
def library() -> FieldLibrary:
    return load_library()


def twist_rad(depth_mm: float, share: float, probe: Probe) -> float:
    return float(share * depth_mm / contact_radius_mm(probe, depth_mm, 30.0))


@pytest.mark.parametrize(("probe", "angle", "level", "size"), [(0, 0, 2, 2), (0, 9, 0, 1), (1, 5, 1, 0)])
def test_solved_twists_come_back(
    library: FieldLibrary, probe: int, angle: int, level: int, size: int
) -> None:
    kind, theta_rad = Probe(probe), float(np.radians(grid.THETA_DEG[angle]))
    depth_mm = float(grid.DEPTH_SHARES[TWISTED[level]] * library.largest_depth_mm(theta_rad, kind))
    turn_rad = twist_rad(depth_mm, TWIST_SHARES[size], kind)
    plain = library.solved(theta_rad, depth_mm, (0.0, 0.0), kind)
    twisted = library.solved(theta_rad, depth_mm, (0.0, 0.0), kind, turn_rad)
    at = (probe, angle, level, size)
    with np.load(SHIPPED) as file:
        added = file["displacement_mm"][at].astype(np.float64)
        assert twisted.displacement_mm - plain.displacement_mm == pytest.approx(added, abs=1e-5)
        assert twisted.torsion_per_mu_mm3 == pytest.approx(float(file["torsion_per_mu_mm3"][at]), rel=1e-4)


def test_opposite_twists_are_mirror_images_and_grow_with_the_angle(library: FieldLibrary) -> None:
    theta_rad, depth_mm, shear_mm = 0.6, 2.0, (0.1, 0.3)
    half, whole = (twist_rad(depth_mm, share, Probe.PLATE) for share in (0.1, 0.2))
    one = library.field(EVERYWHERE, theta_rad, depth_mm, shear_mm, twist_rad=whole)
    other = library.field(EVERYWHERE * MIRROR, theta_rad, depth_mm, (0.1, -0.3), twist_rad=-whole)
    assert other.displacement_mm == pytest.approx(one.displacement_mm * MIRROR, abs=1e-9)
    assert other.force_per_mu_mm2 == pytest.approx(one.force_per_mu_mm2 * MIRROR, abs=1e-9)
    assert one.torsion_per_mu_mm3 is not None
    assert other.torsion_per_mu_mm3 == pytest.approx(-one.torsion_per_mu_mm3)
    less = library.field(EVERYWHERE, theta_rad, depth_mm, shear_mm, twist_rad=half).torsion_per_mu_mm3
    assert less is not None
    assert 0 < less < one.torsion_per_mu_mm3


def test_a_press_straight_in_has_no_torsion(library: FieldLibrary) -> None:
    assert library.field(EVERYWHERE, 0.6, 2.0).torsion_per_mu_mm3 == 0.0
    assert library.field(EVERYWHERE, 0.6, 0.0).torsion_per_mu_mm3 == 0.0


def test_outside_of_the_library_is_refused(library: FieldLibrary, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="where the probe slides"):
        library.field(EVERYWHERE, 0.6, 2.0, twist_rad=1.0)
    with pytest.raises(ConfigError, match=r"twist = 0\.57 deg at depth 0 mm"):
        library.field(EVERYWHERE, 0.6, 0.0, twist_rad=0.01)
    with pytest.raises(ConfigError, match="has no twists of probe plate"):
        load_library(twists=None).field(EVERYWHERE, 0.6, 2.0, twist_rad=0.01)
    with pytest.raises(ConfigError, match="no such file: make it again with"):
        load_twists(tmp_path / "none.npz")
    (tmp_path / "bad.npz").write_bytes(SHIPPED.read_bytes()[:4000])
    with pytest.raises(ConfigError, match="is not a twist library"):
        load_twists(tmp_path / "bad.npz")


@pytest.mark.fem
@pytest.mark.slow
def test_interpolation_against_a_fresh_solution(library: FieldLibrary, tmp_path: Path) -> None:
    """Between all points of the grid, on the same mesh, where the probe slides and twists at once."""
    domes = Domes(30.0, 5.0, Resolution(6, 4, 1), grid.BEAD_RADIUS_MM * EVERYWHERE)
    theta_rad, probe = float(np.radians(33.0)), Probe.PLATE
    depth_mm = 0.6 * library.largest_depth_mm(theta_rad, probe)
    shear_mm, turn_rad = (0.2 * depth_mm, 0.2 * depth_mm), twist_rad(depth_mm, 0.3, probe)
    (pressed,) = press_path(domes.half, theta_rad, [(depth_mm, (0.0, 0.0))], probe)
    start = solved = domes.unfold(pressed)
    for part in (0.25, 0.5, 0.75, 1.0):
        stop = (depth_mm, (part * shear_mm[0], part * shear_mm[1]))
        (slid,) = press_path(domes.whole, theta_rad, [stop], probe, solved)
        (solved,) = twist_path(domes.whole, slid, [part * turn_rad])
    added = domes.sample_whole(solved.displacement_mm - start.displacement_mm)
    moved = library.solved(theta_rad, depth_mm, shear_mm, probe, turn_rad)
    straight = library.solved(theta_rad, depth_mm, (0.0, 0.0), probe)
    miss = moved.displacement_mm - straight.displacement_mm - added
    assert np.sqrt((miss**2).mean() / (added**2).mean()) < 0.3
    assert moved.torsion_per_mu_mm3 == pytest.approx(solved.torsion_per_mu_mm3, rel=0.1)
    rows = [solve_twists(domes, 0.0, probe, lambda: None)] * len(grid.THETA_DEG)
    write_twists(tmp_path / "twists.npz", [probe], rows, domes, Resolution(6, 4, 1))
    again, kept = (
        load_twists(path).twist(0.0, 4.0, 0.5, 1.0, probe) for path in (tmp_path / "twists.npz", SHIPPED)
    )
    assert again.torsion_per_mu_mm3 == pytest.approx(kept.torsion_per_mu_mm3, rel=1e-3)
