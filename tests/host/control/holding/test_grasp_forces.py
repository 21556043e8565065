"""Contact forces of the pose law against the grasp matrix's pseudo-inverse and scans over grip and share."""

import numpy as np
import pytest

from palpate_host.control.holding.grasp_forces import (
    LEAST_MARGIN,
    forces_within_cones,
    internal_forces,
    internal_ratio,
    wrench_forces_N,
)
from palpate_host.control.holding.virtual_object import grip_of

FRICTION = 0.4


def random_grip(rng, fingers):
    """Fingers around an object of about 40 mm, with normals some 5 degrees off the radial direction."""
    angle = 2 * np.pi * np.arange(fingers) / fingers + rng.normal(0, 0.1, fingers)
    normal = np.column_stack((np.cos(angle), np.sin(angle), np.zeros(fingers))) + rng.normal(
        0, 0.1, (fingers, 3)
    )
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    centre = 0.07 * normal + rng.normal(0, 0.003, (fingers, 3))
    return grip_of(centre, normal, np.full((fingers, 1), 0.03))


def grasp_matrix(grip):
    """(6, 3 n): force and torque about the contacts' centroid."""
    blocks = [
        np.vstack((np.eye(3), np.cross(np.eye(3), arm).T @ np.diag([-1, -1, -1]))) for arm in grip.arm_m
    ]
    return np.hstack(blocks)


@pytest.mark.parametrize("fingers", [3, 4, 5])
@pytest.mark.parametrize("seed", range(5))
def test_the_closed_forms_are_the_pseudo_inverse_and_its_projector(fingers, seed):
    rng = np.random.default_rng(seed)
    grip = random_grip(rng, fingers)
    G = grasp_matrix(grip)
    force, torque = rng.normal(0, 2, 3), rng.normal(0, 0.1, 3)
    f = rng.normal(size=(fingers, 3))
    np.testing.assert_allclose(  # the matrix itself, by cross products
        G @ f.ravel(), np.concatenate((f.sum(0), np.cross(grip.arm_m, f).sum(0))), atol=1e-12
    )
    smallest = np.linalg.pinv(G) @ np.concatenate((force, torque))
    np.testing.assert_allclose(wrench_forces_N(grip, force, torque).ravel(), smallest, atol=1e-9)
    inner = internal_forces(grip)
    np.testing.assert_allclose(G @ inner.ravel(), 0.0, atol=1e-12)
    nearest = (np.eye(3 * fingers) - np.linalg.pinv(G) @ G) @ -grip.normal.ravel()
    np.testing.assert_allclose(inner.ravel() / np.linalg.norm(inner), nearest / np.linalg.norm(nearest))
    assert -np.vecdot(inner, grip.normal).mean() == pytest.approx(1.0)


def slack(grip, force):
    """Return friction times normal force less tangential force of each contact, with the friction in use."""
    inner = internal_forces(grip)
    inner_n = -np.vecdot(inner, grip.normal)
    used = np.linalg.norm(inner + inner_n[:, None] * grip.normal, axis=1) / inner_n
    np.testing.assert_allclose([internal_ratio(grip, i) for i in range(len(used))], used, atol=1e-7)
    normal = -np.vecdot(force, grip.normal)
    tangential = np.linalg.norm(force + normal[..., None] * grip.normal, axis=-1)
    return np.maximum(FRICTION, used + LEAST_MARGIN) * normal - tangential


@pytest.mark.parametrize("seed", range(30))
def test_the_grip_is_the_smallest_that_holds_and_the_share_the_largest(seed):
    rng = np.random.default_rng(seed)
    grip = random_grip(rng, 3 + seed % 2)
    force, torque = rng.normal(0, 2, 3), rng.normal(0, 0.08, 3)
    asked, inner = wrench_forces_N(grip, force, torque), internal_forces(grip)
    found = forces_within_cones(grip, force, torque, [FRICTION] * len(grip.arm_m), 0.0, 10.0)
    grips = np.linspace(0, 12, 2401)

    def holds(share):
        forces = share * asked + grips[:, None, None] * inner
        normal = -np.vecdot(forces, grip.normal)
        return (slack(grip, forces) >= 0).all(axis=1) & (normal <= 10.0).all(axis=1)

    if holds(1.0).any():
        assert found.share == 1.0
        assert found.grip_N == pytest.approx(grips[holds(1.0)].min(), abs=0.006)
    else:
        best = max(share for share in np.linspace(0, 1, 401) if holds(share).any())
        assert found.share == pytest.approx(best, abs=0.004)
        assert found.normal_N.max() == pytest.approx(10.0)
    np.testing.assert_allclose(found.force_N, found.share * asked + found.grip_N * inner)
    np.testing.assert_allclose(found.normal_N, -np.vecdot(found.force_N, grip.normal), atol=1e-12)


def test_a_grip_that_is_enough_stays_as_it_is():
    grip = random_grip(np.random.default_rng(1), 3)
    found = forces_within_cones(
        grip, np.array([0.0, 0.0, 0.1]), np.zeros(3), [FRICTION] * len(grip.arm_m), 3.0, 10.0
    )
    assert (found.grip_N, found.share) == (3.0, 1.0)


def test_the_smallest_grip_gives_way_to_the_limit_of_a_contact():
    """9 N onto one of three contacts: the grip of 8 N would press that one with more than 10 N."""
    grip = random_grip(np.random.default_rng(1), 3)
    force = -9.0 * grip.normal[0]
    found = forces_within_cones(grip, force, np.zeros(3), [0.8] * 3, 8.0, 10.0)
    assert found.share == 1.0
    assert found.grip_N < 8.0
    assert found.normal_N.max() == pytest.approx(10.0)
