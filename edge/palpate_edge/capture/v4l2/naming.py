"""Stable names of cameras, to distinguish several cameras of one make.

``/dev/videoN`` is numbered in the order of detection; ``/dev/v4l/by-path`` identifies the port, the USB
serial number the camera itself.
"""

from __future__ import annotations

from pathlib import Path

from palpate_edge.common.errors import CameraLostError, CaptureError

BY_PATH = Path("/dev/v4l/by-path")
SYSFS = Path("/sys/class/video4linux")


def find_camera(
    path: str, usb_serial: str, *, sysfs: Path = SYSFS, by_path: Path = BY_PATH, dev: Path = Path("/dev")
) -> Path:
    """Return the device node of the camera with this path, or with this USB serial number when `path` is
    empty.

    Raises CameraLostError when there is none, CaptureError when several have the serial number.
    """
    if path:
        if not Path(path).exists():
            raise CameraLostError(f"no camera at {path}: plug it in{_offer(by_path)}")
        return Path(path)
    nodes = [dev / node.name for node in _entries(sysfs, "video*") if _is_image_node(node, usb_serial)]
    if not nodes:
        raise CameraLostError(f"no camera has the serial number {usb_serial!r}: plug it in{_offer(by_path)}")
    if len(nodes) > 1:
        found = ", ".join(_stable_name(node, by_path) for node in nodes)
        raise CaptureError(
            f"{len(nodes)} cameras have the serial number {usb_serial!r}: {found}: "
            "set capture.path to one of these instead"
        )
    return nodes[0]


def is_stable_name(path: str) -> bool:
    """Return False for a name that another camera may have after the next boot.

    A name in ``by-id`` is made of make and serial number; many makes give all their cameras the same number.
    """
    return not Path(path).name.startswith("video") and Path(path).parent.name != "by-id"


def _is_image_node(node: Path, usb_serial: str) -> bool:
    """Return whether a node gives images (index 0; others give metadata) and its USB device has this
    number."""
    return _text(node / "index") == "0" and _text(node / "device" / ".." / "serial") == usb_serial


def _text(file: Path) -> str | None:
    try:
        return file.read_text().strip()
    except OSError:  # not a USB camera
        return None


def _stable_name(node: Path, by_path: Path) -> str:
    names = [link for link in _entries(by_path, "*") if link.resolve() == node.resolve()]
    return str(names[0] if names else node)


def _offer(by_path: Path) -> str:
    there = ", ".join(str(link) for link in _entries(by_path, "*-index0"))
    return f"; present cameras: {there}" if there else ""


def _entries(folder: Path, pattern: str) -> list[Path]:
    """Return the sorted entries of a folder; none where it is missing, or removed meanwhile with the last
    camera."""
    try:
        return sorted(folder.glob(pattern))
    except FileNotFoundError:
        return []
