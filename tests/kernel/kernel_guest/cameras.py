"""Cameras for the tests inside the virtual machine: vivid, the kernel's virtual V4L2 driver."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from palpate_edge.capture.v4l2.naming import BY_PATH

WEBCAM = {"node_types": 1, "num_inputs": 1, "input_types": 0}
NAME = BY_PATH / "platform-vivid.0-video-index0"


@contextmanager
def vivid(**options: int) -> Iterator[Path]:
    """The module loaded with one webcam; gives its stable name."""
    words = [f"{name}={value}" for name, value in {**WEBCAM, **options}.items()]
    subprocess.run(["modprobe", "vivid", *words], check=True)
    subprocess.run(["udevadm", "settle"], check=True)
    try:
        yield NAME
    finally:
        subprocess.run(["modprobe", "-r", "vivid"], check=True)


def v4l2_ctl(camera: Path, *words: str) -> str:
    """A stranger's view of the same device."""
    command = ["v4l2-ctl", "-d", str(camera), *words]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


@pytest.fixture
def camera() -> Iterator[Path]:
    """A webcam by its stable name."""
    with vivid() as name:
        yield name
