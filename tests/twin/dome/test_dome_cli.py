"""Commands of `palpate-host simulate dome`, on meshes that are solved in seconds."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from tests.twin.dome.fresh_solutions import directions, solutions

from palpate_edge.common.atomic_write import atomic_file
from palpate_edge.common.errors import ConfigError
from palpate_twin.cli.simulate import simulate
from palpate_twin.dome import field_grid as grid
from palpate_twin.dome.convergence import converge
from palpate_twin.dome.equilibrium import ElasticDome
from palpate_twin.dome.library import load_library
from palpate_twin.dome.make_library import Domes, solve_angle, write_library
from palpate_twin.dome.mesh import Resolution, dome_mesh
from palpate_twin.dome.probe import Probe
from palpate_twin.dome.side_points import side_points

TINY = ["--mesh", "4", "3", "1"]


def test_press_prints_balanced_forces_and_draws(tmp_path: Path) -> None:
    picture = tmp_path / "press.png"
    options = [
        "--theta-deg",
        "20",
        "--depth-mm",
        "0.5",
        "--shear-mm",
        "0.1",
        "0.05",
        "--picture",
        str(picture),
    ]
    result = CliRunner().invoke(simulate, ["dome", "press", *TINY, *options], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    rows = [line.split()[-3:] for line in result.output.splitlines()[:2]]
    dome, base = np.array(rows, dtype=float)
    assert np.linalg.norm(dome) > 1
    assert dome == pytest.approx(-base, abs=2e-4)
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_press_too_deep_is_refused() -> None:
    result = CliRunner().invoke(simulate, ["dome", "press", *TINY, "--theta-deg", "80", "--depth-mm", "3"])
    assert isinstance(result.exception, ConfigError)


@pytest.mark.slow
def test_side_points_spread_alike_at_all_contact_angles() -> None:
    """As in Table 2, the ratio hardly depends on the contact angle."""
    ratios = [
        pair.ratio for pair in side_points(ElasticDome(dome_mesh(resolution=Resolution(4, 3, 1), half=True)))
    ]
    assert len(ratios) == 5
    assert min(ratios) > 1
    assert max(ratios) / min(ratios) < 1.02


def test_finer_meshes_come_closer() -> None:
    meshes = (Resolution(2, 2, 1), Resolution(4, 3, 1), Resolution(6, 5, 1))
    finest, middle, coarse = converge(0.5, 0.5, Probe.PLATE, meshes)
    assert finest.field_rms_mm == 0
    assert middle.field_rms_mm < coarse.field_rms_mm
    assert max(result.imbalance for result in (finest, middle, coarse)) < 1e-6


def test_library_rows_follow_the_grid() -> None:
    domes = Domes(30.0, 5.0, Resolution(2, 2, 1), grid.BEAD_RADIUS_MM * grid.ring_directions())
    theta_rad = np.radians(70.0)
    solved: list[None] = []
    rows = solve_angle(domes, theta_rad, Probe.PLATE, lambda: solved.append(None))
    assert len(rows) == len(solved) == grid.CASES
    deepest_mm = float(grid.largest_depth_mm(theta_rad, Probe.PLATE))
    assert [(row.depth_mm, row.shear_mm) for row in rows] == grid.cases(deepest_mm)
    for row in rows:
        away = row.shear_mm[0] == row.shear_mm[1] == 0
        assert (abs(row.force_per_mu_mm2[1]) < 1e-6) == (row.shear_mm[1] == 0)
        assert away or row.displacement_mm.any()


def test_written_library_is_read_back_and_a_failed_write_leaves_the_old_one(tmp_path: Path) -> None:
    """The solution of one contact angle is used for all, because only the file is tested here."""
    path, resolution = tmp_path / "fields.npz", Resolution(2, 2, 1)
    domes = Domes(30.0, 5.0, resolution, grid.BEAD_RADIUS_MM * grid.ring_directions())
    solved = solve_angle(domes, np.radians(70.0), Probe.SPHERE10, lambda: None)
    rows = [replace(row, theta_rad=float(theta)) for theta in np.radians(grid.THETA_DEG) for row in solved]
    write_library(path, rows, domes, resolution)
    library = load_library(path)
    assert library.probes == (Probe.SPHERE10,)
    assert library.displacement_mm[0] == pytest.approx(solved[0].displacement_mm, abs=2e-3)
    kept = path.read_bytes()
    with pytest.raises(KeyboardInterrupt), atomic_file(path, ConfigError) as file:
        file.write(b"half")
        raise KeyboardInterrupt
    assert path.read_bytes() == kept
    with pytest.raises(ConfigError, match="cannot be written"):
        write_library(tmp_path / "no" / "fields.npz", rows, domes, resolution)


def test_library_that_cannot_be_written_is_refused_before_solving(tmp_path: Path) -> None:
    result = CliRunner().invoke(simulate, ["dome", "library", "--out", str(tmp_path / "no" / "fields.npz")])
    assert isinstance(result.exception, ConfigError)


@pytest.mark.fem
@pytest.mark.parametrize("probe", load_library().probes, ids=lambda probe: probe.label)
def test_interpolation_against_fresh_solutions(probe: Probe) -> None:
    """Within twice the 95th percentiles that library.py states, of the depth (rms) and of the force."""
    of_depth, of_force = (0.016, 0.1) if probe is Probe.PLATE else (0.046, 0.24)
    for solved in solutions(probe):
        press = (solved.contact_rad, solved.depth_mm, solved.shear_mm)
        found = load_library().field(directions(), *press, probe=probe)
        error_mm = found.displacement_mm - solved.displacement_mm
        assert np.sqrt(np.mean(np.sum(error_mm**2, axis=1))) < of_depth * solved.depth_mm
        force_error = np.linalg.norm(found.force_per_mu_mm2 - solved.force_per_mu_mm2)
        assert force_error < of_force * np.linalg.norm(solved.force_per_mu_mm2)
