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
    """Load the module with one webcam; yield its stable name."""
    words = [f"{name}={value}" for name, value in {**WEBCAM, **options}.items()]
    subprocess.run(["modprobe", "vivid", *words], check=True)
    subprocess.run(["udevadm", "settle"], check=True)
    try:
        yield NAME
    finally:
        subprocess.run(["modprobe", "-r", "vivid"], check=True)


def v4l2_ctl(camera: Path, *words: str) -> str:
    """Return the output of v4l2-ctl for the same device."""
    command = ["v4l2-ctl", "-d", str(camera), *words]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


@pytest.fixture
def camera() -> Iterator[Path]:
    """Yield the stable name of a webcam."""
    with vivid() as name:
        yield name
