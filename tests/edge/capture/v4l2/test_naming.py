"""Cameras by name, on a /sys and a /dev/v4l/by-path like the kernel's."""

from __future__ import annotations

from pathlib import Path

import pytest

from palpate_edge.capture.v4l2.naming import find_camera, is_stable_name
from palpate_edge.common.errors import CameraLostError, CaptureError


class Machine:
    """USB cameras: each a device with a serial number and nodes for images and for metadata."""

    def __init__(self, root):
        self.root, self.nodes = root, 0
        for name in ("sys/class/video4linux", "dev/v4l/by-path", "usb"):
            (root / name).mkdir(parents=True)

    def plug(self, port, serial):
        device = self.root / "usb" / port
        interface = device / f"{port}:1.0"
        interface.mkdir(parents=True)
        if serial is not None:
            (device / "serial").write_text(serial + "\n")
        for index in (0, 1):
            node = self.root / "sys/class/video4linux" / f"video{self.nodes}"
            node.mkdir()
            (node / "index").write_text(f"{index}\n")
            (node / "device").symlink_to(interface)
            file = self.root / "dev" / f"video{self.nodes}"
            file.touch()
            (self.root / "dev/v4l/by-path" / f"platform-usb-{port}-video-index{index}").symlink_to(file)
            self.nodes += 1

    def find(self, path="", serial=""):
        return find_camera(
            path,
            serial,
            sysfs=self.root / "sys/class/video4linux",
            by_path=self.root / "dev/v4l/by-path",
            dev=self.root / "dev",
        )


@pytest.fixture
def machine(tmp_path):
    return Machine(tmp_path)


def test_three_alike_are_told_apart_by_their_serial_numbers(machine):
    for port, serial in (("1-1", "A7"), ("1-2", "B7"), ("1-3", "C7")):
        machine.plug(port, serial)
    found = [machine.find(serial=serial).name for serial in ("A7", "B7", "C7")]
    assert found == ["video0", "video2", "video4"]  # never the nodes of metadata


def test_the_order_of_plugging_does_not_matter(machine):
    machine.plug("1-3", "C7")
    machine.plug("1-1", "A7")
    assert machine.find(serial="A7").name == "video2"


def test_two_of_one_serial_number_are_refused_and_both_named(machine):
    machine.plug("1-1", "0001")
    machine.plug("1-2", "0001")
    with pytest.raises(
        CaptureError, match=r"2 cameras .*usb-1-1-video-index0.*usb-1-2-video-index0"
    ) as error:
        machine.find(serial="0001")
    assert not isinstance(error.value, CameraLostError)  # waiting would not help


def test_one_that_is_not_there_may_come_and_the_others_are_offered(machine):
    machine.plug("1-1", None)
    with pytest.raises(CameraLostError, match=r"'B7'.*usb-1-1-video-index0"):
        machine.find(serial="B7")
    with pytest.raises(CameraLostError, match="no camera at /dev/v4l/by-path/nowhere"):
        machine.find(path="/dev/v4l/by-path/nowhere")


def test_a_path_is_taken_as_it_is(machine):
    machine.plug("1-1", "A7")
    path = machine.root / "dev/v4l/by-path/platform-usb-1-1-video-index0"
    assert machine.find(path=str(path)) == path


def test_numbers_of_nodes_are_no_stable_names():
    assert not is_stable_name("/dev/video0")
    assert not is_stable_name("/dev/v4l/by-id/usb-Webcam_Vendor_01.00.00-video-index0")
    assert is_stable_name("/dev/v4l/by-path/platform-usb-1-1-video-index0")


class Vanishing(type(Path())):
    """A folder that is removed between a look at it and reading it, as udev does with the last camera."""

    def glob(self, _pattern):
        raise FileNotFoundError(2, "No such file or directory", str(self))


def test_a_folder_that_vanishes_meanwhile_is_no_crash(tmp_path):
    with pytest.raises(CameraLostError, match=r"plug it in$"):
        find_camera(str(tmp_path / "none"), "", by_path=Vanishing(tmp_path))
    with pytest.raises(CameraLostError, match="serial number '7'"):
        find_camera("", "7", sysfs=Vanishing(tmp_path), by_path=tmp_path)
