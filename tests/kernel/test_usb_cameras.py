"""Three USB cameras of one make are distinguished, independent of the numbers the kernel gives them."""

from __future__ import annotations

import pytest

from kernel_guest.usb_cameras import port_name, revision
from palpate_edge.capture.v4l2.naming import BY_PATH, find_camera, is_stable_name
from palpate_edge.common.errors import CameraLostError, CaptureError

pytestmark = pytest.mark.vm

REVISIONS = ["0001", "0002", "0003"]
ORDERS = [(0, 1, 2), (2, 0, 1)]


def test_a_port_keeps_its_camera_in_whatever_order_they_start(usb_cameras):
    names = [port_name(port) for port in range(3)]
    cameras = [usb_cameras(one, "01.00.00") for one in REVISIONS]
    numbers, shared = [], []
    for order in ORDERS:
        for port in order:
            cameras[port].plug(port)
        found = [find_camera(str(name), "") for name in names]
        assert [revision(node) for node in found] == REVISIONS
        numbers.append([node.resolve().name for node in found])
        shared += (BY_PATH.parent / "by-id").glob("*-video-index0")
        for camera in cameras:
            camera.unplug()
    assert numbers[0] != numbers[1]
    assert len(shared) == len(ORDERS), "one name for all three cameras"
    assert not is_stable_name(str(shared[0]))
    with pytest.raises(CameraLostError, match="plug it in"):
        find_camera(str(names[0]), "")


def test_a_camera_is_found_by_its_serial_number_in_whatever_port_it_is(usb_cameras):
    serials = ["A7", "B7", "C7"]
    cameras = [usb_cameras(*one) for one in zip(REVISIONS, serials, strict=True)]
    for ports in ORDERS:
        for camera, port in zip(cameras, ports, strict=True):
            camera.plug(port)
        assert [revision(find_camera("", serial)) for serial in serials] == REVISIONS
        for camera in cameras:
            camera.unplug()


def test_a_serial_number_that_two_have_is_refused_and_their_ports_are_named(usb_cameras):
    for port in (0, 1):
        usb_cameras(REVISIONS[port], "01.00.00").plug(port)
    named = f"2 cameras have .*: {port_name(0)}, {port_name(1)}: set capture.path"
    with pytest.raises(CaptureError, match=named):
        find_camera("", "01.00.00")
