"""USB cameras for the tests inside the virtual machine: the kernel's UVC gadget over USB/IP.

To uvcvideo and udev these are webcams, each on a port of its own. They answer what a driver asks when it
finds them and give no pictures, as the gadget's controller has no isochronous packets; cameras.py has some.
"""

from __future__ import annotations

import fcntl
import itertools
import os
import select
import socket
import struct
import subprocess
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from palpate_edge.capture.v4l2.naming import BY_PATH

PORTS = 3
CONFIGFS = Path("/sys/kernel/config")
DEVICES = Path("/sys/devices/platform")
VHCI = DEVICES / "vhci_hcd.0"
VIDEO = Path("/sys/class/video4linux")
POLL_MS = 100
STRING_LANGUAGE = "0x409"
DEVICE_ID, HIGH_SPEED = 0x10002, 3  # of USB/IP: bus 1, device 2; enum usb_device_speed

# linux/videodev2.h and linux/usb/g_uvc.h
SUBSCRIBE_EVENT, DEQUEUE_EVENT = 0x4020565A, 0x80885659
SEND_RESPONSE = 0x40405501
EVENT_BYTES, EVENT_PAYLOAD_AT = 136, 8
SETUP = 0x08000004
REQUEST = struct.Struct("<BBHHH")  # of USB 2.0, 9.3: bmRequestType, bRequest, wValue, wIndex, wLength
# The UVC class, 4.3.1.1: of a VideoStreaming interface
FROM_HOST, STREAMING_INTERFACE, PROBE, COMMIT = 0x00, 1, 1, 2
GET_LEN, GET_INFO = 0x85, 0x86
AGREED = struct.pack("<HBBI5HIIIBBBB", 1, 1, 1, 333_333, *5 * (0,), 640 * 480 * 2, 1024, *5 * (0,))

_numbers = itertools.count()


class UsbCamera:
    """A webcam that differs from others of its make only in its revision, by which a test identifies it."""

    def __init__(self, revision: str, serial: str, wait_until: Callable[..., None]) -> None:
        self._revision, self._wait_until = revision, wait_until
        name = f"{revision}-{next(_numbers)}"
        self._function, self._gadget = f"uvc.{name}", CONFIGFS / "usb_gadget" / name
        self._unplugged = threading.Event()
        self._answering: threading.Thread | None = None
        self._port = 0
        self._describe(serial)

    def _describe(self, serial: str) -> None:
        gadget = self._gadget
        function, strings = gadget / "functions" / self._function, gadget / "strings" / STRING_LANGUAGE
        stream, control = function / "streaming", function / "control"
        frame = stream / "uncompressed/yuyv/480p"
        for folder in (strings, gadget / "configs/c.1", frame, stream / "header/h", control / "header/h"):
            folder.mkdir(parents=True)
        for file, value in {
            gadget / "idVendor": "0x1d6b",
            gadget / "idProduct": "0x0102",
            gadget / "bcdDevice": f"0x{self._revision}",
            strings / "product": "webcam",
            strings / "serialnumber": serial,
            frame / "wWidth": "640",
            frame / "wHeight": "480",
            frame / "dwFrameInterval": "333333",
        }.items():
            _write(file, value)
        (stream / "header/h/yuyv").symlink_to(stream / "uncompressed/yuyv")
        for speed in ("fs", "hs", "ss"):
            (stream / "class" / speed / "h").symlink_to(stream / "header/h")
        for speed in ("fs", "ss"):
            (control / "class" / speed / "h").symlink_to(control / "header/h")
        (gadget / "configs/c.1" / self._function).symlink_to(function)

    def plug(self, port: int) -> None:
        """Plug the camera into a port; return when udev has named it."""
        self._port = port
        _write(self._gadget / "UDC", f"usbip-vudc.{port}")
        subprocess.run(["udevadm", "settle"], check=True)
        output = next(node for node in VIDEO.glob("video*") if self._is_output(node))
        device = os.open(Path("/dev") / output.name, os.O_RDWR)
        subscription = struct.pack("8I", SETUP, *7 * (0,))
        fcntl.ioctl(device, SUBSCRIBE_EVENT, subscription)  # connects it to the bus
        self._unplugged.clear()
        self._answering = threading.Thread(target=self._answer, args=(device,))
        self._answering.start()
        near, far = socket.socketpair()
        with near, far:  # the kernel keeps these descriptors
            _write(DEVICES / f"usbip-vudc.{port}/usbip_sockfd", near.fileno())
            _write(VHCI / "attach", f"{port} {far.fileno()} {DEVICE_ID + port} {HIGH_SPEED}")
        self._wait_until(port_name(port).exists)

    def _is_output(self, node: Path) -> bool:
        """Return whether the device takes the pictures of the gadget's program (it is not the camera's)."""
        name = node / "function_name"
        return name.exists() and name.read_text().strip() == self._function

    def unplug(self) -> None:
        """Unplug the camera; return when its name is removed. A camera that is not plugged in stays so."""
        if self._answering is None:
            return
        _write(VHCI / "detach", self._port)
        self._wait_until(lambda: not port_name(self._port).exists())
        self._unplugged.set()
        self._answering.join()
        self._answering = None
        _write(self._gadget / "UDC", "")

    def _answer(self, device: int) -> None:
        """Run the program in a camera: respond to requests of the host."""
        poller = select.poll()
        poller.register(device, select.POLLPRI)
        while not self._unplugged.is_set():
            if poller.poll(POLL_MS):
                event = bytearray(EVENT_BYTES)
                fcntl.ioctl(device, DEQUEUE_EVENT, event)
                answer = _answer_to(REQUEST.unpack_from(event, EVENT_PAYLOAD_AT))
                fcntl.ioctl(device, SEND_RESPONSE, answer)
        os.close(device)


def _write(file: Path, value: object) -> None:
    """Write to the kernel in one piece and once; a buffered file would write again when it is closed."""
    with file.open("wb", buffering=0) as kernel:
        kernel.write(f"{value}\n".encode())


def _answer_to(request: tuple[int, int, int, int, int]) -> bytes:
    """Return a uvc_request_data: the length of the data, or -1 for a stall, and the data."""
    request_type, code, value, index, length = request
    if request_type & 0x80 == FROM_HOST:
        return struct.pack("<i60x", length)
    if index & 0xFF != STREAMING_INTERFACE or value >> 8 not in (PROBE, COMMIT):
        return struct.pack("<i60x", -1)
    data = {GET_LEN: struct.pack("<H", len(AGREED)), GET_INFO: b"\x03"}.get(code, AGREED)[:length]
    return struct.pack("<i60s", len(data), data)


def port_name(port: int) -> Path:
    """Return udev's name of the camera in a port."""
    return BY_PATH / f"platform-vhci_hcd.0-usb-0:{port + 1}:1.0-video-index0"


def revision(node: Path) -> str:
    """Return the identity of the camera behind a device, as udev read it from the camera."""
    command = ["udevadm", "info", "--query=property", f"--name={node}"]
    properties = subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()
    return next(line.partition("=")[2] for line in properties if line.startswith("ID_REVISION="))


@pytest.fixture
def usb_cameras(wait_until: Callable[..., None]) -> Iterator[Callable[[str, str], UsbCamera]]:
    """Create a camera with a revision and a serial number, not plugged in yet."""
    for module in (("libcomposite",), ("usbip-vudc", f"num={PORTS}"), ("vhci-hcd",)):
        subprocess.run(["modprobe", *module], check=True)
    made: list[UsbCamera] = []

    def make(revision: str, serial: str) -> UsbCamera:
        made.append(UsbCamera(revision, serial, wait_until))
        return made[-1]

    yield make
    for one in made:
        one.unplug()
