"""Twists of the probe about the contact normal, against closed-form contact mechanics.

A sphere pressed on a block that is large beside the contact: Reissner and Sagoci's torsion of a half-space,
Hertz's contact, and full sliding under his pressure (Lubkin 1951).
"""

from __future__ import annotations

from dataclasses import replace

import felupe
import numpy as np
import pytest

from palpate_edge.common.errors import ConfigError
from palpate_twin.dome import friction_contact
from palpate_twin.dome.equilibrium import STICK, ElasticDome
from palpate_twin.dome.mesh import OUTER_FACE, DomeMesh, Resolution, dome_mesh
from palpate_twin.dome.press import PressedDome, press, press_path, twist_path
from palpate_twin.dome.probe import Probe

TINY = Resolution(cap=4, side=3, wall=1)
HALF_WIDTH_MM, HEIGHT_MM = 12.0, 12.0
DEPTH_MM, RADIUS_MM = 0.5, 10.0
GRADING = 3.5  # the elements at the middle of the top face are the smallest
REDUCED_MODULUS = 2 / (1 - 0.49)  # E / (1 - nu^2) per shear modulus
FRICTION = 0.3


def block() -> DomeMesh:
    """Return a block with its top face at z = HEIGHT_MM, where the fingertip's pole would be."""
    cube = felupe.Cube(a=(-1, -1, 0), b=(1, 1, 1), n=(9, 9, 6))
    points = cube.points.copy()
    for axis in (0, 1):
        points[:, axis] = HALF_WIDTH_MM * np.sinh(GRADING * points[:, axis]) / np.sinh(GRADING)
    points[:, 2] = HEIGHT_MM * (1 - np.sinh(GRADING * (1 - points[:, 2])) / np.sinh(GRADING))
    mesh = felupe.Mesh(points, cube.cells, "hexahedron").add_midpoints_edges()
    faces = mesh.cells[:, OUTER_FACE]
    top = (mesh.points[faces, 2] > HEIGHT_MM - 1e-9).all(axis=1)
    base = np.flatnonzero(mesh.points[:, 2] < 1e-9)
    return DomeMesh(
        mesh.points, mesh.cells, faces[top], base, np.zeros(0, dtype=np.intp), HEIGHT_MM, HEIGHT_MM
    )


def pressed_block(friction: float) -> tuple[ElasticDome, PressedDome, float, float]:
    """Return the pressed block, its normal force per mu, and Hertz's contact radius for that force."""
    dome = ElasticDome(block(), friction=friction)
    pressed = press(dome, 0.0, DEPTH_MM, Probe.SPHERE10)
    normal = float(-pressed.force_per_mu_mm2[2])
    return dome, pressed, normal, float((0.75 * normal * RADIUS_MM / REDUCED_MODULUS) ** (1 / 3))


@pytest.fixture
def stiff_contact(monkeypatch: pytest.MonkeyPatch) -> None:
    """Raise the penalties, which are for the fingertip: they would yield too much in this small contact."""
    monkeypatch.setattr(friction_contact, "TANGENT_PENALTY", 400.0)
    monkeypatch.setattr(friction_contact, "NORMAL_PENALTY", 400.0)


@pytest.mark.fem
@pytest.mark.slow
@pytest.mark.usefixtures("stiff_contact")
def test_a_bonded_contact_has_the_torque_of_reissner_and_sagoci() -> None:
    """T = 16/3 G a^3 angle, linear in the angle. The contact is resolved by a few elements only."""
    dome, pressed, _, radius_mm = pressed_block(STICK)
    small, large = twist_path(dome, pressed, [0.002, 0.008])
    assert large.torsion_per_mu_mm3 == pytest.approx(4 * small.torsion_per_mu_mm3, rel=1e-3)
    assert small.torsion_per_mu_mm3 == pytest.approx(16 / 3 * radius_mm**3 * 0.002, rel=0.12)


@pytest.mark.fem
@pytest.mark.slow
@pytest.mark.usefixtures("stiff_contact")
def test_a_sliding_contact_has_the_torque_of_hertzs_pressure() -> None:
    """T = 3 pi / 16 friction N a when all of it slides; before that it grows ever more slowly."""
    dome, pressed, normal, radius_mm = pressed_block(FRICTION)
    full = 3 * np.pi / 16 * FRICTION * normal * radius_mm
    twisted = list(twist_path(dome, pressed, [0.01, 0.02, 0.1, 0.2, 0.3]))
    torsion = [twist.torsion_per_mu_mm3 for twist in twisted]
    assert 0 < torsion[1] - torsion[0] < torsion[0]
    assert torsion[-1] == pytest.approx(full, rel=0.06)
    assert torsion[-1] == pytest.approx(torsion[-2], rel=0.01)
    assert np.linalg.norm(twisted[-1].force_per_mu_mm2 + twisted[-1].base_per_mu_mm2) < 1e-6 * normal


@pytest.fixture(scope="module")
def touched() -> tuple[ElasticDome, PressedDome]:
    dome = ElasticDome(dome_mesh(resolution=TINY))
    return dome, press(dome, np.radians(35.0), 1.0)


def test_opposite_twists_are_mirror_images(touched: tuple[ElasticDome, PressedDome]) -> None:
    one, other = (next(twist_path(*touched, [angle])) for angle in (0.02, -0.02))
    assert one.torsion_per_mu_mm3 > 0.1
    assert other.torsion_per_mu_mm3 == pytest.approx(-one.torsion_per_mu_mm3, rel=1e-6)
    assert other.force_per_mu_mm2 == pytest.approx(one.force_per_mu_mm2 * [1, -1, 1], abs=1e-6)


def test_a_probe_twisted_back_and_moved_on_keeps_its_twist(touched: tuple[ElasticDome, PressedDome]) -> None:
    """A small twist sticks, so that the way back undoes it; a further press keeps the twist."""
    dome, start = touched
    there, back = twist_path(dome, start, [1e-4, 0.0])
    assert back.torsion_per_mu_mm3 == pytest.approx(
        start.torsion_per_mu_mm3, abs=0.02 * there.torsion_per_mu_mm3
    )
    (deeper,) = press_path(dome, start.theta_rad, [(1.05, (0.0, 0.0))], start.probe, there)
    assert deeper.twist_rad == there.twist_rad


def test_a_twist_of_a_half_dome_or_of_a_dome_too_far_is_refused(
    touched: tuple[ElasticDome, PressedDome],
) -> None:
    _, start = touched
    half = ElasticDome(dome_mesh(resolution=TINY, half=True))
    with pytest.raises(ConfigError, match="needs a mesh of the whole dome"):
        next(twist_path(half, replace(start), [0.1]))
