"""States of a hold in the status, as warnings and as a fault: load, grip, workspace."""

import numpy as np
import pytest
from tests.host.control.test_slip_reflex import Hold, wide  # noqa: F401 - the fixture

from palpate_host.control.hold_report import hold_fault, hold_status

WEIGHT_UNKNOWN = "weight unknown: the load on the object is being learned"


def displaced(hold, by_m, turned=None):
    """Put the estimate elsewhere, as an object that was pulled away."""
    found = hold.control.pose_law.object
    found.place_m = found.place_m + np.array(by_m)
    if turned is not None:
        found.R = turned @ found.R


def test_the_load_is_known_after_it_needs_no_stiffness_and_unknown_when_another_pulls(wide):  # noqa: F811
    hold = Hold(wide)
    assert hold.warning == WEIGHT_UNKNOWN
    for _ in range(31):
        hold.tick()
    assert hold.warning == ""
    assert hold_status(hold.control).is_load_known
    displaced(hold, (0.0, 0.0, -0.005))
    hold.tick()
    assert hold.warning == WEIGHT_UNKNOWN
    displaced(hold, (0.0, 0.0, 0.005))
    for _ in range(31):
        hold.tick()
    assert hold.warning == ""


def test_the_status_has_pose_radii_and_load(wide):  # noqa: F811
    hold = Hold(wide)
    start = hold_status(hold.control)
    displaced(hold, (0.0, 0.0, -0.010))
    for _ in range(50):
        hold.tick()
    status = hold_status(hold.control)
    assert status.place_mm == pytest.approx(np.add(start.place_mm, (0.0, 0.0, -10.0)), abs=1e-3)
    assert status.place95_mm > start.place95_mm
    assert (start.place_error_mm, status.place_error_mm) == pytest.approx((0.0, 10.0), abs=1e-3)
    assert status.load_N[2] > 1.0  # what pulled it down is carried
    assert 0.1 < status.orientation95_deg < 2.0
    hold.control.pose_law.drop()
    status = hold_status(hold.control)
    assert (status.place_mm, status.load_N, status.grip_N, status.is_load_known) == (None, None, None, False)
    assert status.place_error_mm is None


def test_a_load_beyond_the_largest_grip_is_named(wide):  # noqa: F811
    hold = Hold(wide, most_grip_N=3.2)
    displaced(hold, (0.0, 0.0, -0.015))
    hold.tick()
    hold.tick()
    assert "grip at its limit: the load needs more than most_grip_N = 3.2" in hold.warning


@pytest.mark.parametrize("axis", range(3))
def test_an_object_beyond_the_workspace_is_named_and_far_beyond_a_fault(wide, axis):  # noqa: F811
    hold = Hold(wide)
    displaced(hold, 0.025 * np.eye(3)[axis])
    assert "the object is beyond the workspace, pose_law.reach_mm = 20" in hold.warning
    assert hold_fault(hold.control, hold.config) == ""
    displaced(hold, 0.016 * np.eye(3)[axis])
    assert hold_fault(hold.control, hold.config).startswith("the object is far beyond the workspace")
    hold.control.pose_law.drop()
    assert hold_fault(hold.control, hold.config) == ""
