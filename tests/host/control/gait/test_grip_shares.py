"""Shares of a grip, on grasps whose friction is known from geometry."""

import numpy as np
import pytest

from palpate_host.control.gait.grip_shares import SHARES, best_shares, needed_friction
from palpate_host.control.holding.grasp_forces import internal_forces, wrench_forces_N
from palpate_host.control.holding.virtual_object import grip_of

CROSS = np.array([[1.0, 0, 0], [0, 1.0, 0], [-1.0, 0, 0], [0, -1.0, 0]])


def test_opposite_contacts_need_no_friction():
    assert needed_friction(0.04 * CROSS, CROSS, np.ones(4)) == pytest.approx(0.0, abs=1e-12)


def test_a_turned_ring_of_contacts_needs_the_tangent_of_its_angle():
    """Four contacts 10 mm beside the middle of faces 40 mm away: forces through the centre, 10/40."""
    tangent = np.array([[0, 1.0, 0], [-1.0, 0, 0], [0, -1.0, 0], [1.0, 0, 0]])
    assert needed_friction(0.04 * CROSS + 0.01 * tangent, CROSS, np.ones(4)) == pytest.approx(0.25)


def test_without_one_finger_the_pair_holds_and_the_third_presses_less():
    """The third finger's force s is held by friction of the pair: a smaller share needs less of it."""
    held = np.array([True, True, True, False])
    equal = needed_friction(0.04 * CROSS, CROSS, np.array([1.0, 1.0, 1.0, 0.0]))
    assert equal == pytest.approx(1.0 / 3.0)
    share, needed = best_shares([(0.04 * CROSS, CROSS)], list(held), enough=0.2)
    assert share[3] == 0.0
    assert share[1] in SHARES
    assert needed <= 0.2 < equal


def test_a_pair_alone_cannot_hold():
    parallel = np.array([[1.0, 0, 0], [1.0, 0.0, 0.0], [-1.0, 0, 0]])
    contacts = 0.04 * parallel + np.array([[0, 0.02, 0], [0, -0.02, 0], [0, 0.1, 0]])
    assert needed_friction(contacts, parallel, np.array([1.0, 1.0, 1.0])) > 0.4


@pytest.mark.parametrize("seed", range(5))
def test_forces_with_shares_keep_the_wrench_and_leave_a_lifted_finger_free(seed):
    """Against the pseudo-inverse with weights, G^+ = W G^T (G W G^T)^-1, W of the squared shares."""
    rng = np.random.default_rng(seed)
    normal = CROSS + rng.normal(0.0, 0.1, (4, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    share = np.array([1.0, 0.4, 0.7, 0.0])
    grip = grip_of(0.04 * normal, normal, np.zeros((4, 1)), share)
    force, torque = rng.normal(0.0, 2.0, 3), rng.normal(0.0, 0.05, 3)
    found = wrench_forces_N(grip, force, torque)
    G = np.vstack((np.tile(np.eye(3), 4), np.hstack([np.cross(arm, np.eye(3)).T for arm in grip.arm_m])))
    W = np.diag(np.repeat(share**2, 3))
    expected = W @ G.T @ np.linalg.solve(G @ W @ G.T, np.concatenate((force, torque)))
    np.testing.assert_allclose(found.ravel(), expected, atol=1e-9)
    inner = internal_forces(grip)
    np.testing.assert_allclose(
        np.concatenate((inner.sum(0), np.cross(grip.arm_m, inner).sum(0))), 0.0, atol=1e-12
    )
    assert -np.vecdot(inner, normal).sum() == pytest.approx(share.sum())
    np.testing.assert_array_equal(found[3], 0.0)
    np.testing.assert_array_equal(inner[3], 0.0)
