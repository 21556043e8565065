"""The dome's finite elements on small meshes: analytic solutions, another library, and consistency."""

from __future__ import annotations

from itertools import pairwise

import felupe
import numpy as np
import pytest

from palpate_edge.common.errors import ConfigError
from palpate_twin.dome.elasticity import Solid, bulk_per_mu
from palpate_twin.dome.equilibrium import ElasticDome
from palpate_twin.dome.friction_contact import contact
from palpate_twin.dome.mesh import Resolution, dome_mesh
from palpate_twin.dome.press import directions, press, press_path
from palpate_twin.dome.probe import Probe
from palpate_twin.dome.sampling import Sampler
from palpate_twin.dome.surface import outer_surface

TINY = Resolution(cap=4, side=3, wall=1)
THETA_RAD = np.radians(35.0)


@pytest.fixture(scope="module")
def half_dome() -> ElasticDome:
    return ElasticDome(dome_mesh(resolution=TINY, half=True))


@pytest.fixture(scope="module")
def whole_dome() -> ElasticDome:
    return ElasticDome(dome_mesh(resolution=TINY))


def test_mesh_has_the_volume_and_surface_of_a_hollow_hemisphere() -> None:
    mesh = dome_mesh(30.0, 5.0, TINY)
    element = felupe.RegionQuadraticHexahedron(felupe.Mesh(mesh.points_mm, mesh.cells, "hexahedron20"))
    assert element.dV.min() > 0
    assert element.dV.sum() == pytest.approx(2 / 3 * np.pi * (30**3 - 25**3), rel=2e-3)
    assert outer_surface(mesh).area_mm2.sum() == pytest.approx(2 * np.pi * 30**2, rel=2e-3)


@pytest.mark.parametrize(
    ("radius_mm", "wall_mm", "resolution", "half"),
    [
        (30, 31, TINY, False),
        (30, 0, TINY, False),
        (30, 5, Resolution(4, 0, 1), False),
        (30, 5, Resolution(5, 3, 1), True),
    ],
)
def test_mesh_that_cannot_be_is_refused(
    radius_mm: float, wall_mm: float, resolution: Resolution, half: bool
) -> None:
    with pytest.raises(ConfigError):
        dome_mesh(radius_mm, wall_mm, resolution, half)


@pytest.mark.parametrize(("poisson_ratio", "ratio"), [(0.0, 2 / 3), (0.25, 5 / 3), (0.49, 149 / 3)])
def test_bulk_modulus_is_that_of_linear_elasticity(poisson_ratio: float, ratio: float) -> None:
    """K = E / (3 (1 - 2 nu)) with E = 2 (1 + nu) mu, computed by hand."""
    assert bulk_per_mu(poisson_ratio) == pytest.approx(ratio)


@pytest.mark.parametrize("probe", list(Probe))
def test_traction_derivative_is_that_of_the_traction(probe: Probe) -> None:
    """Points that stick, slip and do not touch; no difference quotient spans a transition between them."""
    rng = np.random.default_rng(5)
    outward, _, _ = directions(0.4)
    points = 0.3 * rng.normal(size=(300, 3))
    anchors = points + 0.02 * rng.normal(size=points.shape)
    derivative = contact(probe, outward, points, anchors, 0.6).derivative
    step = 1e-7
    for axis in range(3):
        move = step * np.eye(3)[axis]
        ahead, behind = (contact(probe, outward, points + way * move, anchors, 0.6) for way in (1, -1))
        by_difference = (ahead.traction - behind.traction) / (2 * step)
        assert derivative[:, :, axis] == pytest.approx(by_difference, abs=1e-4)


def test_a_distant_probe_exerts_no_traction_and_sets_no_anchor() -> None:
    up, below = np.array([0.0, 0.0, 1.0]), np.array([[0.0, 0.0, -0.1]])
    touch = contact(Probe.PLATE, up, below, np.zeros((1, 3)), 0.6)
    assert not touch.traction.any()
    assert not touch.derivative.any()
    assert np.isnan(touch.anchor_mm).all()


def distorted_block(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return a unit cube of 2x2x2 20-node hexahedra with a displaced inner corner and straight edges."""
    mesh = felupe.Cube(n=3)
    inside = ((mesh.points > 0) & (mesh.points < 1)).all(axis=1)
    mesh.points[inside] += rng.uniform(-0.1, 0.1, (inside.sum(), 3))
    quadratic = mesh.add_midpoints_edges()
    return quadratic.points, quadratic.cells


@pytest.mark.parametrize("stretch", [0.8, 1.25])
def test_patch_block_in_uniaxial_stretch_bears_the_analytic_force(stretch: float) -> None:
    """With free sides, finite K and transverse stretch t, J = s t^2, the transverse Cauchy stress is zero:
    mu J^(-5/3) (t^2 - (s^2 + 2 t^2)/3) + K (J - 1) = 0, and the force is the nominal stress along s.
    """
    from scipy.optimize import brentq

    points, cells = distorted_block(np.random.default_rng(1))
    bulk = bulk_per_mu(0.49)

    def cauchy(of: float, across: float) -> float:
        volume = stretch * across**2
        mean = (stretch**2 + 2 * across**2) / 3
        return float(volume ** (-5 / 3) * (of**2 - mean) + bulk * (volume - 1))

    across = brentq(lambda t: cauchy(t, t), 0.5, 1.5, xtol=1e-14)
    forces = Solid(points, cells).forces(points * (np.array([stretch, across, across]) - 1)).reshape(-1, 3)
    inside = ((points > 1e-9) & (points < 1 - 1e-9)).all(axis=1)
    end = points[:, 0] > 1 - 1e-9
    assert np.abs(forces[inside]).max() < 1e-12
    assert forces[end, 0].sum() == pytest.approx(cauchy(stretch, across) * across**2, rel=1e-10)
    side = (points[:, 1] > 1 - 1e-9) & ~end & (points[:, 0] > 1e-9)
    assert np.abs(forces[side, 1]).max() < 1e-12


def test_forces_and_stiffness_are_those_of_felupe() -> None:
    """Compare with an independent finite element library: same mesh, material and integration points."""
    points, cells = distorted_block(np.random.default_rng(4))
    displacement = 0.03 * np.random.default_rng(5).normal(size=points.shape)
    region = felupe.RegionQuadraticHexahedron(
        felupe.Mesh(points, cells, "hexahedron20"), quadrature=felupe.GaussLegendre(order=1, dim=3)
    )
    field = felupe.FieldContainer([felupe.Field(region, dim=3, values=displacement)])
    body = felupe.SolidBody(felupe.NeoHooke(mu=1.0, bulk=bulk_per_mu(0.49)), field)
    solid = Solid(points, cells)
    expected = np.asarray(body.assemble.vector(field).toarray()).ravel()
    assert solid.forces(displacement) == pytest.approx(expected, abs=1e-12)
    stiffness = body.assemble.matrix(field).toarray()
    assert solid.stiffness(displacement).toarray() == pytest.approx(stiffness, abs=1e-10)


def test_stiffness_is_the_derivative_of_the_forces() -> None:
    points, cells = distorted_block(np.random.default_rng(2))
    solid = Solid(points, cells)
    rng = np.random.default_rng(3)
    at, way = 0.02 * rng.normal(size=points.shape), rng.normal(size=points.shape)
    step = 1e-6
    by_difference = (solid.forces(at + step * way) - solid.forces(at - step * way)) / (2 * step)
    assert solid.stiffness(at) @ way.ravel() == pytest.approx(by_difference, rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("probe", list(Probe))
def test_contact_and_base_reaction_agree(half_dome: ElasticDome, probe: Probe) -> None:
    pressed = press(half_dome, THETA_RAD, 1.0, probe, (0.3, 0.0))
    size = np.linalg.norm(pressed.force_per_mu_mm2)
    assert size > 1
    assert np.linalg.norm(pressed.force_per_mu_mm2 + pressed.base_per_mu_mm2) < 1e-6 * size


def test_half_dome_and_whole_dome_agree(half_dome: ElasticDome, whole_dome: ElasticDome) -> None:
    points = 26.5 * np.array([[0.5, 0.3, 0.81], [0.5, -0.3, 0.81], [-0.6, 0.0, 0.8]])
    fields, forces = [], []
    for dome in (half_dome, whole_dome):
        pressed = press(dome, THETA_RAD, 0.75, shear_mm=(0.2, 0.0))
        fields.append(Sampler(dome.mesh, points)(pressed.displacement_mm))
        forces.append(pressed.force_per_mu_mm2)
    assert forces[1] == pytest.approx(forces[0], abs=1e-6)
    assert fields[1] == pytest.approx(fields[0], abs=1e-7)
    assert fields[1][1] == pytest.approx(fields[1][0] * [1, -1, 1], abs=1e-7)


def test_opposite_azimuthal_slides_are_mirror_images(whole_dome: ElasticDome) -> None:
    one, other = (press(whole_dome, THETA_RAD, 0.5, shear_mm=(0.0, side)) for side in (0.2, -0.2))
    assert one.force_per_mu_mm2[1] > 0.1
    assert other.force_per_mu_mm2 == pytest.approx(one.force_per_mu_mm2 * [1, -1, 1], abs=1e-6)
    mirrored = whole_dome.mesh.points_mm * [1, -1, 1]
    nearest = np.array([np.argmin(((whole_dome.mesh.points_mm - p) ** 2).sum(axis=1)) for p in mirrored])
    assert other.displacement_mm[nearest] == pytest.approx(one.displacement_mm * [1, -1, 1], abs=1e-6)


def test_force_grows_with_depth_and_faster_than_it(half_dome: ElasticDome) -> None:
    """Near the base, where the wall does not buckle inwards, the force over depth is monotone and convex."""
    theta = np.radians(60.0)
    outward, _, _ = directions(theta)
    stops = [(depth, (0.0, 0.0)) for depth in (0.5, 1.0, 1.5, 2.0)]
    force = [0.0, *(-p.force_per_mu_mm2 @ outward for p in press_path(half_dome, theta, stops))]
    growth = np.diff(force)
    assert (growth > 0).all()
    assert all(later > earlier for earlier, later in pairwise(growth))


def test_press_goes_in_first_and_then_slides(half_dome: ElasticDome) -> None:
    """Friction depends on the path: a slide after the press gives more force than a straight oblique path."""
    _, meridional, _ = directions(0.0)
    shear = (0.05, 0.0)
    *_, two_stops = press_path(half_dome, 0.0, [(0.5, (0.0, 0.0)), (0.5, shear)])
    *_, slanted = press_path(half_dome, 0.0, [(0.5, shear)])
    pressed = press(half_dome, 0.0, 0.5, shear_mm=shear)
    assert pressed.force_per_mu_mm2 == pytest.approx(two_stops.force_per_mu_mm2, abs=1e-9)
    assert pressed.force_per_mu_mm2 @ meridional > 1.1 * slanted.force_per_mu_mm2 @ meridional


def test_slide_beyond_stick_bears_coulombs_share(half_dome: ElasticDome) -> None:
    outward, meridional, _ = directions(0.0)
    pressed = press(half_dome, 0.0, 0.5, shear_mm=(1.0, 0.0))
    normal = -pressed.force_per_mu_mm2 @ outward
    # A few points at the edge come into contact within the last step and do not yet hold.
    assert pressed.force_per_mu_mm2 @ meridional == pytest.approx(half_dome.friction * normal, rel=0.05)
    assert pressed.force_per_mu_mm2 @ meridional <= half_dome.friction * normal * (1 + 1e-9)


def test_thick_dome_under_the_plate_follows_hertz() -> None:
    """A nearly solid hemisphere under a plate without friction follows Hertz.

    F = 4/3 E* R^(1/2) d^(3/2), E* = E / (1 - nu^2), E = 2 (1 + nu) mu. The fixed base makes it a few per cent
    stiffer than a half space.
    """
    nu, radius_mm, depth_mm = 0.49, 30.0, 0.5
    dome = ElasticDome(dome_mesh(radius_mm, 28.0, Resolution(8, 3, 3), half=True), nu, friction=0.0)
    force = -press(dome, 0.0, depth_mm).force_per_mu_mm2[2]
    hertz = 4 / 3 * 2 * (1 + nu) / (1 - nu**2) * radius_mm**0.5 * depth_mm**1.5
    assert force == pytest.approx(hertz, rel=0.1)


@pytest.mark.parametrize(
    ("theta_rad", "depth_mm", "shear_mm"),
    [
        (-0.1, 1.0, (0, 0)),
        (1.6, 0.1, (0, 0)),
        (1.2, 2.5, (0, 0)),
        (0.5, -1.0, (0, 0)),
        (0.5, 1.0, (0.0, 0.1)),
    ],
)
def test_press_that_cannot_be_is_refused(
    half_dome: ElasticDome, theta_rad: float, depth_mm: float, shear_mm: tuple[float, float]
) -> None:
    with pytest.raises(ConfigError) as refusal:
        press(half_dome, theta_rad, depth_mm, shear_mm=shear_mm)
    assert "\n" not in str(refusal.value)


def test_sampler_gives_a_linear_field_and_refuses_points_outside(whole_dome: ElasticDome) -> None:
    gradient = np.random.default_rng(4).normal(size=(3, 3))
    theta, phi = np.radians([0.0, 20, 47, 80]), np.radians([0.0, 10, 130, 250])
    points = 26.5 * np.stack(
        [np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=1
    )
    field = Sampler(whole_dome.mesh, points)(whole_dome.mesh.points_mm @ gradient)
    assert field == pytest.approx(points @ gradient, abs=1e-8)
    with pytest.raises(ConfigError, match="is outside of the dome"):
        Sampler(whole_dome.mesh, np.array([[0.0, 0.0, 20.0]]))
