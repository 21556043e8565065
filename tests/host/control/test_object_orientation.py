"""The estimate of M from contacts of which some are lost, false, biased or frozen."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from palpate_host.control.object_orientation import LEFT_OUT_US, NO_SINGLE_OBJECT, ObjectOrientation
from palpate_host.control.virtual_frame import contact_frame

FRAME_US = 33_333
THREE = np.array([[np.cos(a), np.sin(a), 0.1] for a in (0.2, 2.3, 4.4)])
THREE /= np.linalg.norm(THREE, axis=1, keepdims=True)
FOUR = np.array([[np.cos(a), np.sin(a), 0.3] for a in (0.0, 1.6, 3.1, 4.8)])
FOUR /= np.linalg.norm(FOUR, axis=1, keepdims=True)


def turn(degrees, axis=(0.0, 0.0, 1.0)):
    return Rotation.from_rotvec(np.radians(degrees) * np.array(axis)).as_matrix()


def apart_deg(a, b):
    return np.degrees(Rotation.from_matrix(a.T @ b).magnitude())


class Contacts:
    """Frames of all fingers, 30 a second, of an object that turns in R_vir."""

    def __init__(self, normals=THREE):
        self.normals = normals
        self.orientation = ObjectOrientation(len(normals), 3, 0.0)
        self.start = contact_frame(normals)
        self.now_us = 0

    def frames(self, count, turned=None, false=None):
        """Give `count` frames of every finger. turned: rotation since the start; false: finger -> its normal,
        or None for a frame without contact."""
        turned = np.eye(3) if turned is None else turned
        for _ in range(count):
            self.now_us += FRAME_US
            for finger, normal in enumerate(self.normals @ turned.T):
                given = (false or {}).get(finger, normal)
                if given is None:
                    self.orientation.without_contact(finger, self.now_us)
                else:
                    self.orientation.add(finger, given, self.now_us)
        return self

    def off_deg(self, turned):
        """The angle between M and the true one, R_vir^T R_c = turned R_c(0)."""
        return apart_deg(self.orientation.M, turned @ self.start)


@pytest.fixture(params=[THREE, FOUR], ids=["three", "four"])
def contacts(request):
    return Contacts(request.param).frames(3)


def test_the_first_contacts_give_eq_16(contacts):
    np.testing.assert_allclose(contacts.orientation.M, contacts.start, atol=1e-12)
    assert contacts.orientation.is_following


def test_an_object_that_turns_is_followed(contacts):
    contacts.frames(1, turn(3.0)).frames(1, turn(6.0, (0.6, 0.0, 0.8)))
    assert contacts.off_deg(turn(6.0, (0.6, 0.0, 0.8))) < 1e-6


def test_a_frame_without_contact_keeps_the_references(contacts):
    """The turn that happens meanwhile is seen afterwards: nothing was taken as a new reference."""
    contacts.frames(1, turn(2.0), {1: None}).frames(3, turn(3.0))
    assert contacts.orientation.is_following
    assert contacts.off_deg(turn(3.0)) < 1e-6


def test_a_finger_long_without_contact_takes_a_new_reference_that_agrees_with_m(contacts):
    contacts.frames(6, false={1: None})
    assert not contacts.orientation.is_following
    elsewhere = contacts.normals[1] @ turn(20.0).T
    before = contacts.orientation.M
    contacts.frames(3, false={1: elsewhere})
    assert contacts.orientation.is_following
    np.testing.assert_allclose(contacts.orientation.M, before, atol=1e-12)
    contacts.frames(1, turn(3.0), {1: turn(3.0) @ elsewhere})
    assert contacts.off_deg(turn(3.0)) < 1e-6


@pytest.mark.parametrize("finger", range(3))
@pytest.mark.parametrize("axis", [(0.0, 0.0, 1.0), (0.0, 0.8, 0.6)])
def test_a_wild_normal_is_not_believed(finger, axis):
    contacts = Contacts().frames(3)
    contacts.frames(1, false={finger: turn(30.0, axis) @ contacts.normals[finger]})
    assert contacts.off_deg(np.eye(3)) < 1e-6
    assert contacts.orientation.left_out == ()
    assert contacts.orientation.residual_deg > 10.0


def test_a_biased_finger_is_named_after_300_ms_and_left_out(contacts):
    for frame in range(12):
        turned = turn(0.3 * frame)
        contacts.frames(1, turned, {2: turn(10.0) @ turned @ contacts.normals[2]})
        expected = (2,) if frame * FRAME_US >= LEFT_OUT_US else ()
        assert contacts.orientation.left_out == expected
    assert contacts.orientation.is_following
    assert contacts.off_deg(turned) < 1e-6
    contacts.frames(1, turned)
    assert contacts.orientation.left_out == ()


def test_a_drifting_finger_is_left_out_and_its_pull_is_undone(contacts):
    for frame in range(60):
        contacts.frames(1, false={0: turn(0.2 * frame) @ contacts.normals[0]})
    assert contacts.orientation.left_out == (0,)
    assert contacts.off_deg(np.eye(3)) < 1e-6


def test_fingers_that_jump_together_are_believed(contacts):
    """An object that is turned by a push between two frames: no normal is near its prediction, one rotation
    fits all."""
    contacts.frames(2, turn(12.0, (0.0, 0.6, 0.8)))
    assert contacts.off_deg(turn(12.0, (0.0, 0.6, 0.8))) < 1e-6
    assert contacts.orientation.left_out == ()


def test_contacts_of_no_single_object_are_a_problem_after_300_ms():
    contacts = Contacts().frames(3)
    false = {1: turn(15.0) @ THREE[1], 2: turn(-15.0) @ THREE[2]}
    contacts.frames(9, false=false)
    assert contacts.orientation.problem == ""
    contacts.frames(2, false=false)
    assert contacts.orientation.problem == NO_SINGLE_OBJECT
    assert not contacts.orientation.is_following
    assert contacts.off_deg(np.eye(3)) < 1e-6
    contacts.frames(1)
    assert contacts.orientation.problem == ""
    assert contacts.orientation.is_following


def test_parallel_normals_are_a_problem_until_they_differ():
    orientation = ObjectOrientation(3, 1, 0.0)
    for finger in range(3):
        orientation.add(finger, np.array([1.0, 0.0, 0.0]), 1000)
    assert "parallel" in orientation.problem
    for finger, normal in enumerate(THREE):
        orientation.add(finger, normal, 2000)
    assert orientation.is_following


def test_the_finger_whose_contact_stands_still_is_the_wrong_one():
    """A tilt of one finger alone misleads: three normals have one surplus measurement, so each of them may be
    the wrong one."""
    contacts = Contacts()
    frozen = np.cross(THREE[1], (0.0, 0.0, 1.0))
    for frame in range(60):
        contacts.now_us += FRAME_US
        turned = turn(0.2 * max(0, frame - 10), frozen)
        for finger, normal in enumerate(THREE @ turned.T):
            is_frozen = finger == 1 and frame > 10
            position = (0.0, 0.0, 30.0) if is_frozen else (0.01 * frame, 0.0, 30.0)
            contacts.orientation.add(finger, THREE[1] if is_frozen else normal, contacts.now_us, position)
    assert contacts.orientation.left_out == (1,)
    assert contacts.off_deg(turned) < 1e-6
