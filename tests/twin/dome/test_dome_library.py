"""The field library: the packaged file, its interpolation, and rejected requests."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate_edge.common.errors import ConfigError
from palpate_twin.dome import field_grid as grid
from palpate_twin.dome.library import SHIPPED, FieldLibrary, lagrange, load_library, ring_weights
from palpate_twin.dome.probe import Probe


@pytest.fixture(scope="module")
def library() -> FieldLibrary:
    return load_library()


def unit(theta_rad: np.ndarray, phi_rad: np.ndarray) -> np.ndarray:
    across = np.sin(theta_rad)
    return np.stack([across * np.cos(phi_rad), across * np.sin(phi_rad), np.cos(theta_rad)], axis=-1)


def scattered(count: int = 60) -> np.ndarray:
    rng = np.random.default_rng(7)
    return unit(np.arccos(rng.uniform(0.2, 1, count)), rng.uniform(0, 2 * np.pi, count))


def test_shipped_file_is_small_and_whole() -> None:
    assert SHIPPED.stat().st_size < 2_000_000
    with np.load(SHIPPED) as file:
        assert all(np.isfinite(file[name]).all() for name in file.files)
        presses = len(file["theta_rad"])
        assert file["displacement_mm"].shape == (presses, len(file["directions"]), 3)
        assert file["shear_mm"].shape == (presses, 2)


@pytest.mark.parametrize("row", [7, 17, 60, 140, 250, 300, 415])
def test_solved_presses_come_back(library: FieldLibrary, row: int) -> None:
    with np.load(SHIPPED) as file:
        theta, depth = float(file["theta_rad"][row]), float(file["depth_mm"][row])
        shear = (float(file["shear_mm"][row][0]), float(file["shear_mm"][row][1]))
        probe = Probe(int(file["probe"][row]))
        found = library.field(grid.ring_directions(), theta, depth, shear, probe=probe)
        assert found.displacement_mm == pytest.approx(file["displacement_mm"][row].astype(float), abs=1e-3)
        assert found.force_per_mu_mm2 == pytest.approx(file["force_per_mu_mm2"][row].astype(float), abs=1e-3)


@settings(max_examples=25, deadline=None)
@given(azimuth=st.floats(-7, 7), share=st.floats(0.0, 0.4), way=st.floats(0, 7))
def test_field_turns_with_the_contact(
    library: FieldLibrary, azimuth: float, share: float, way: float
) -> None:
    depth = 2.0
    shear = (share * depth * np.cos(way), share * depth * np.sin(way))
    cos, sin = np.cos(azimuth), np.sin(azimuth)
    turn = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
    here = library.field(scattered(), 0.6, depth, shear)
    there = library.field(scattered() @ turn.T, 0.6, depth, shear, azimuth)
    assert there.displacement_mm == pytest.approx(here.displacement_mm @ turn.T, abs=1e-9)
    assert there.force_per_mu_mm2 == pytest.approx(turn @ here.force_per_mu_mm2, abs=1e-9)


@settings(max_examples=25, deadline=None)
@given(theta=st.floats(0, 1.3), along=st.floats(-0.28, 0.28), across=st.floats(0, 0.28))
def test_mirrored_slide_gives_the_mirror_image(
    library: FieldLibrary, theta: float, along: float, across: float
) -> None:
    mirror = np.array([1.0, -1.0, 1.0])
    one = library.field(scattered(), theta, 0.5, (0.5 * along, 0.5 * across))
    other = library.field(scattered() * mirror, theta, 0.5, (0.5 * along, -0.5 * across))
    assert other.displacement_mm == pytest.approx(one.displacement_mm * mirror, abs=1e-9)
    assert other.force_per_mu_mm2 == pytest.approx(one.force_per_mu_mm2 * mirror, abs=1e-9)


def test_field_is_zero_at_no_depth_and_proportional_near_it(library: FieldLibrary) -> None:
    directions = scattered()
    assert not library.field(directions, 0.5, 0.0).displacement_mm.any()
    one, two = (library.field(directions, 0.5, depth) for depth in (0.01, 0.02))
    assert two.displacement_mm == pytest.approx(2 * one.displacement_mm)
    assert two.force_per_mu_mm2 == pytest.approx(2 * one.force_per_mu_mm2)


def test_pole_press_pushes_straight_down(library: FieldLibrary) -> None:
    found = library.field(np.array([[0.0, 0.0, 1.0]]), 0.0, 2.0)
    assert np.abs(found.force_per_mu_mm2[:2]).max() < 0.01 * -found.force_per_mu_mm2[2]
    assert found.displacement_mm[0, 2] == pytest.approx(-2.0, abs=0.1)


def test_rings_give_back_smooth_fields() -> None:
    """Return polynomials of the direction, up to the third degree, that vanish on the base plane."""
    fields = [lambda d: d[:, 2], lambda d: d[:, 2] * d[:, 0], lambda d: d[:, 2] * d[:, 0] * d[:, 1]]
    weights = ring_weights(scattered())
    for field in fields:
        assert weights @ field(grid.ring_directions()) == pytest.approx(field(scattered()), abs=1e-3)


@given(at=st.floats(0, 1), roots=st.lists(st.floats(-1, 1), min_size=3, max_size=3))
def test_lagrange_is_exact_for_cubics(at: float, roots: list[float]) -> None:
    nodes = np.array([0.0, 0.1, 0.25, 0.4, 0.8, 1.0])
    near, weights = lagrange(nodes, at, 4)
    cubic = np.poly1d(roots, r=True)
    assert weights @ cubic(nodes[near]) == pytest.approx(cubic(at), abs=1e-9)


@pytest.mark.parametrize(
    ("theta_deg", "depth_mm", "shear_mm", "reason"),
    [
        (76.0, 0.1, (0.0, 0.0), "theta = 76.0 deg is outside"),
        (0.0, 4.5, (0.0, 0.0), "depth = 4.5 mm is outside"),
        (75.0, 1.0, (0.0, 0.0), "depth = 1 mm is outside"),
        (30.0, 1.0, (0.5, 0.0), "slide = 0.5 mm at depth 1 mm is outside"),
        (30.0, 0.0, (0.1, 0.0), "slide = 0.1 mm at depth 0 mm is outside"),
        (float("nan"), 1.0, (0.0, 0.0), "theta = nan deg"),
        (30.0, float("nan"), (0.0, 0.0), "depth = nan mm"),
    ],
)
def test_outside_of_the_library_is_refused(
    library: FieldLibrary, theta_deg: float, depth_mm: float, shear_mm: tuple[float, float], reason: str
) -> None:
    with pytest.raises(ConfigError, match=reason):
        library.field(scattered(), np.radians(theta_deg), depth_mm, shear_mm)


def test_probe_and_point_that_are_not_there_are_refused(library: FieldLibrary) -> None:
    with pytest.raises(ConfigError, match="probe sphere10"):
        library.field(scattered(), 0.3, 1.0, probe=Probe.SPHERE10)
    for point in ([0.0, 0.6, -0.8], [float("nan"), 0.0, 1.0]):
        with pytest.raises(ConfigError, match="below the base"):
            library.field(np.array([point]), 0.3, 1.0)


def test_reading_and_the_command_line_start_without_the_extra() -> None:
    """Rendering from the library does not import scipy."""
    program = (
        "import sys; import palpate_twin.cli.dome; from palpate_twin.dome import library; "
        "library.load_library(); print(*{'scipy', 'matplotlib'} & set(sys.modules))"
    )
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == ""


def test_bad_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no such file: make it with"):
        load_library(tmp_path / "none.npz")
    garbled = tmp_path / "garbled.npz"
    garbled.write_bytes(SHIPPED.read_bytes()[:5000])
    with pytest.raises(ConfigError, match="is not a field library"):
        load_library(garbled)
    with np.load(SHIPPED) as file:
        arrays = {name: file[name] for name in file.files}
    np.savez(tmp_path / "less.npz", **{name: arrays[name] for name in arrays if name != "depth_mm"})
    with pytest.raises(ConfigError, match="has no array depth_mm"):
        load_library(tmp_path / "less.npz")
    np.savez(tmp_path / "short.npz", **(arrays | {"theta_rad": arrays["theta_rad"][:-1]}))
    with pytest.raises(ConfigError, match="has a different grid"):
        load_library(tmp_path / "short.npz")
