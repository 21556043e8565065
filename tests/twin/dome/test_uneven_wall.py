"""The change that an uneven wall makes to a press, against full solutions with the same wall."""

from __future__ import annotations

import numpy as np
import pytest

from palpate_twin.dome.equilibrium import ElasticDome
from palpate_twin.dome.mesh import Resolution, dome_mesh
from palpate_twin.dome.press import press
from palpate_twin.dome.probe import Probe
from palpate_twin.dome.sampling import Sampler
from palpate_twin.dome.uneven_wall import UnevenWall, random_stiffness

RADIUS_MM, WALL_MM, COARSE = 30.0, 5.0, Resolution(2, 3, 1)
THETA_RAD, DEPTH_MM = 0.5, 1.0


def points_mm():
    theta, phi = np.meshgrid(np.radians([15, 35, 55]), np.radians(np.arange(0, 360, 60)), indexing="ij")
    across = np.sin(theta)
    return 26.5 * np.stack([across * np.cos(phi), across * np.sin(phi), np.cos(theta)], axis=-1).reshape(
        -1, 3
    )


def stiff_towards_x(at):
    """The same at y and -y, so that half a dome suffices for the full solution."""
    return np.exp(0.3 * at[:, 0])


def solved(stiffness):
    """Displacement of the points and force of the full solution, large displacements and friction."""
    mesh = dome_mesh(RADIUS_MM, WALL_MM, COARSE, half=True)
    centre = mesh.points_mm[mesh.cells].mean(axis=1)
    relative = stiffness(centre / np.linalg.norm(centre, axis=1, keepdims=True))
    found = press(ElasticDome(mesh, relative=relative), THETA_RAD, DEPTH_MM, Probe.SPHERE10)
    return Sampler(mesh, points_mm())(found.displacement_mm), found.force_per_mu_mm2


@pytest.mark.long
def test_it_is_the_change_of_the_full_solution():
    even_mm, even = solved(lambda at: np.ones(len(at)))
    uneven_mm, uneven = solved(stiff_towards_x)
    change = UnevenWall(stiff_towards_x, points_mm(), RADIUS_MM, WALL_MM, COARSE).change(
        THETA_RAD, 0.0, DEPTH_MM, (0.0, 0.0), Probe.SPHERE10
    )
    force = (uneven - even) / np.linalg.norm(even)
    assert np.linalg.norm(force) > 0.1
    np.testing.assert_allclose(change.force, force, atol=0.02)
    field = (uneven_mm - even_mm) / np.sqrt((even_mm**2).sum(axis=1).mean())
    assert ((change.displacement - field) ** 2).sum() < 0.1 * (field**2).sum()


@pytest.mark.long
def test_the_change_turns_with_the_press():
    """A wall that is the same all around changes a press at any azimuth alike; a shallow press is changed."""
    wall = UnevenWall(lambda at: 1 + 0.3 * at[:, 2], points_mm(), RADIUS_MM, WALL_MM, COARSE)
    first, second = (
        wall.change(THETA_RAD, azimuth, 0.02, (0.004, 0.0), Probe.PLATE) for azimuth in (0.0, np.pi / 2)
    )
    np.testing.assert_allclose(second.force, first.force[[1, 0, 2]] * [-1, 1, 1], atol=1e-6)
    assert np.linalg.norm(first.force) > 0.05


def test_a_random_stiffness_has_the_deviation_it_is_asked_for():
    at = np.random.default_rng(0).standard_normal((2000, 3))
    at /= np.linalg.norm(at, axis=1, keepdims=True)
    spread = [np.log(random_stiffness(0.15, seed)(at)) for seed in range(30)]
    assert np.sqrt(np.mean(np.square(spread))) == pytest.approx(0.15, rel=0.2)
    assert (random_stiffness(0.0, 3)(at) == 1.0).all()
