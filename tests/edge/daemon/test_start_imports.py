"""Modules that the daemon does not load at its start, since its first contact would wait for them."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.process

NOT_NEEDED = {
    "can",
    "canopen",
    "importlib.metadata",
    "numpy.ma",
    "numpy.random",
    "onnxruntime",
    "palpate_edge.calibration.recording_match",
    "palpate_edge.cli",
    "palpate_edge.datasets.pose_dataset",
    "palpate_edge.datasets.recording",
    "palpate_edge.press_rig",
    "tempfile",
}


CAMERA = """
name = "finger-1"
[capture]
source = "v4l2"
path = "/dev/v4l/by-path/platform-usb-0:1:1.0-video-index0"
[estimator]
calibration = "finger-1.cal"
[node]
id = 0x10
[bus]
"""
PROGRAM = f"""
import sys
from pathlib import Path
import palpate_edge.daemon.daemon
from palpate_edge.daemon.config import read_config
read_config(Path(sys.argv[1]))
print(sorted({NOT_NEEDED!r} & set(sys.modules)))
"""


def test_the_daemon_loads_nothing_that_a_fingertip_with_a_camera_does_not_need(tmp_path: Path) -> None:
    config = tmp_path / "finger.toml"
    config.write_text(CAMERA, encoding="utf-8")
    command = [sys.executable, "-c", PROGRAM, str(config)]
    result = subprocess.run(command, capture_output=True, text=True, check=True)
    assert result.stdout == "[]\n"
